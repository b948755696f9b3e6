"""Bodies, zones, terrain, signals, several starts and errors of the model, judged by paths and geometry of its own.

``python -m tests.campaign.features.run --cases 300``
"""
