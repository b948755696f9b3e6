"""The closest that any member came to one obstacle."""

from __future__ import annotations

from dataclasses import replace

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.fleet import Member


@dataclass(frozen=True)
class Clearance:
    """The closest that any member came to one obstacle.

    Attributes
    ----------
    obstacle : str
        Its name.
    distance : float
        Metres from the robot's edge (its centre minus the radius) to the obstacle; negative inside.
    time : float
        Seconds.
    parameters : dict of str to float
        Whose parameters these were.
    inside : int
        Members that were inside at some sampled time.
    """

    obstacle: str
    distance: float
    time: float
    parameters: Member
    inside: int

    def merge(self, other: Clearance) -> Clearance:
        """The closer of both; of equal ones the earlier, then that of the smaller parameters."""
        nearest = min(self, other, key=lambda one: (one.distance, one.time, *one.parameters.values()))
        return replace(nearest, inside=self.inside + other.inside)
