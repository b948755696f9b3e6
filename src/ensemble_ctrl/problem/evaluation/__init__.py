"""What sampled members do under given controls: clearances, robustness, arrivals, and which parts of a task fail."""
