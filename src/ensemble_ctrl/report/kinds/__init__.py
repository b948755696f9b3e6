"""Kinds of pictures of a plan, one file each: a function that takes what it shows and Axes, and returns the Axes."""
