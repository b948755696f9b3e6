"""Areas of a map with a rule: keep out of them, or drive no faster than a limit in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.constraints.stl.formula import Always, And, Formula, Or
from ensemble_ctrl.constraints.stl.leaves import Avoid, Predicate
from ensemble_ctrl.constraints.stl.rewrite import conjuncts
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import number, shown

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

SPEED = "v"
"""The signal that a limit is on."""


@dataclass(frozen=True, eq=False)
class Zone:
    """An area with a rule that holds at all times.

    Parameters
    ----------
    pieces : tuple of Obstacle
        Convex pieces of the area, their edges included; one may be given alone.
    speed : float or None
        Largest speed of a robot, forwards or backwards, while any part of its body (a disc of the fleet's radius) is in
        the area, m/s; None for an area that robots keep out of.

    Raises
    ------
    ProblemError
        For no pieces, other things than Obstacles, and a limit that is not above 0.

    Notes
    -----
    The speed is the member's own: its factor times the commanded one (`ensemble_ctrl.systems.arcs`).
    """

    pieces: tuple[Obstacle, ...]
    speed: float | None = None

    def __post_init__(self) -> None:
        given: Any = self.pieces
        pieces = (given,) if isinstance(given, Obstacle) or not isinstance(given, Sequence) else tuple(given)
        wrong = [piece for piece in pieces if not isinstance(piece, Obstacle)]
        if not pieces or wrong:
            raise ProblemError(
                f"zone.pieces: expected one or more Obstacles, got {shown(wrong[0] if wrong else given)}"
            )
        object.__setattr__(self, "pieces", pieces)
        if self.speed is None:
            return
        speed = number("zone.speed", self.speed)
        if not 0 < speed < np.inf:
            raise ProblemError(f"zone.speed: expected a limit above 0 m/s, got {speed:g}")
        object.__setattr__(self, "speed", float(speed))

    def rule(self, name: str) -> Formula:
        """What every member has to do, as a part of the task; `name` is that of the zone."""
        outside = Avoid(name)
        if self.speed is None:
            return Always(outside)
        slow = (Predicate(((SPEED, -sign),), self.speed) for sign in (1.0, -1.0))
        return Always(Or((outside, And(tuple(slow)))))

    def __str__(self) -> str:
        return "keep out" if self.speed is None else f"|v| <= {self.speed:g} m/s"


def rules(problem: Problem) -> dict[str, Formula]:
    """The rules of a problem's zones by their names."""
    return {name: zone.rule(name) for name, zone in problem.zones.items()}


def required(problem: Problem) -> Formula:
    """The task with the rules of all zones."""
    added = tuple(rules(problem).values())
    return And((*conjuncts(problem.task), *added)) if added else problem.task


def zone_pieces(zones: Mapping[str, Zone]) -> dict[str, tuple[Obstacle, ...]]:
    """The convex pieces of each zone."""
    return {name: zone.pieces for name, zone in zones.items()}
