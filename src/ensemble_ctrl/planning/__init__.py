"""Searches for plans: once (`planner`), for the least time, without constraints, and again and again (`online`)."""
