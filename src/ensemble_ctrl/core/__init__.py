"""What everything else is built on: errors, plain values, strict JSON, read-only data, and how files are written."""
