"""Weights and shares that several programs use, each with one meaning."""

from __future__ import annotations

SLACK_WEIGHT = 10.0
"""Weight of a metre of slack: above the multipliers seen, so that slack is used only where it must be."""
STATE_SLACK_WEIGHT = 30.0
"""The same where slack is in the unit of any state: one value for both made plans up to 3 % dearer."""
LEVEL_WEIGHT = 1e-3
"""Weight that pulls idle levels up to their bounds, so that none drifts away unbounded."""
RATE_SPARE = 1e-2
"""Share of the rate bounds that programs leave to spare."""
