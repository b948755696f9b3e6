"""Searches over ranges of a fleet's parameters: how wide a range may be, and how few parts cover it.

Each range is a problem of its own, and has a plan if that is certified for every member in it.
"""

from ensemble_ctrl.planning.ranges.cover import Cover
from ensemble_ctrl.planning.ranges.oracle import Found, Oracle, Tell
from ensemble_ctrl.planning.ranges.parts import furthest, part, places, robots, widened
from ensemble_ctrl.planning.ranges.scaled import Scaled
from ensemble_ctrl.planning.ranges.search import largest

__all__ = ["Cover", "Found", "Oracle", "Scaled", "Tell", "furthest", "largest", "part", "places", "robots", "widened"]
