"""A campaign against the proof: random and hostile plans, judged by an oracle that shares no line with the package."""
