"""What users call: `plan`, `compare`, `widest`, and the `Plan` they hold."""
