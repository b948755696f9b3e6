"""Whole on-line loops with robots that do their worst within the stated bounds, judged by arcs and geometry of its own.

``python -m tests.campaign.loops.run --loops 2000 --jobs 2``
"""
