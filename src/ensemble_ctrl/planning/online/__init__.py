"""Plans while time goes on: measure, learn, plan again from there, apply the first steps, repeat."""
