"""Problems at the edge of what checks refuse: the controls of each do the task, and are proven to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.systems import Unicycle

AHEAD = Footprint(np.array([[1.0, -0.1], [1.5, -0.1], [1.5, 0.1], [1.0, 0.1]]))
"""A body that the planned point is not part of."""
RING = tuple(
    Obstacle.box(box)
    for box in (
        [[-0.6, 0.6], [0.4, 0.6]],
        [[-0.6, 0.6], [-0.6, -0.4]],
        [[0.4, 0.6], [-0.6, 0.6]],
        [[-0.6, -0.4], [-0.6, 0.6]],
    )
)
BODY = Fleet(Unicycle(), {}, position=[0, 0], heading=0.0, footprint=AHEAD)
POINT = Fleet(Unicycle(), {}, position=[0, 0], heading=0.0)
GOAL = {"goal": [[2.0, 4.5], [-1.0, 1.0]]}


def posed(*given: Any, **more: Any) -> Problem:
    """A problem; it is given texts and lists, too, which it reads."""
    return Problem(*given, **more)


@pytest.mark.parametrize(
    "case",
    [
        {"fleet": BODY, "regions": GOAL, "obstacles": {"ring": RING}, "task": "F in(goal) and G avoid(ring)"},
        {
            "fleet": BODY,
            "regions": {"goal": [[0.5, 0.7], [-0.1, 0.1]]},
            "obstacles": {"post": Obstacle.box([[0.4, 0.8], [-0.2, 0.2]])},
            "task": "F[0,1] in(goal) and G avoid(post)",
        },
        {
            "fleet": BODY,
            "regions": GOAL,
            "zones": {"kept": Zone((Obstacle.box([[-0.2, 0.2], [-0.2, 0.2]]),))},
            "task": "F in(goal)",
        },
    ],
    ids=["walls", "covered", "zone"],
)
def test_points_outside_of_their_body_may_be_in_obstacles(case: dict[str, Any]) -> None:
    problem = posed("body", duration=4, steps=4, **case)
    assert certify(problem, np.array([[1.0, 0.0]] * 4)).proven == "yes"


def test_slow_members_keep_a_limit_below_the_least_command() -> None:
    zones = {"slow": Zone((Obstacle.box([[-1, 9], [-1, 1]]),), 0.6)}

    def made(low: float, high: float) -> Problem:
        fleet = Fleet(
            Unicycle(),
            {"traction": Interval(low, high)},
            position=[0, 0],
            heading=0.0,
            input_lower=[1, -1],
            input_upper=[2, 1],
        )
        return posed("slow", fleet, 4, 4, "F in(goal)", {"goal": [[1, 3], [-1, 1]]}, zones=zones)

    assert certify(made(0.4, 0.5), np.array([[1.0, 0.0]] * 4)).proven == "yes"
    with pytest.raises(ProblemError, match=r"drive at least 0\.7 m/s"):
        made(0.4, 0.7)


def test_discs_are_wider_than_the_polygon_inside_them() -> None:
    # between two corners of the polygon of 32 sides in the disc, 0.9975 from the middle
    angle = np.pi / 32
    place, disc = 0.9975 * np.array([np.cos(angle), np.sin(angle)]), DiscRegion(Disc([0, 0], 1.0))
    fleet = POINT.with_(starts=[place, -place])
    assert posed("apart", fleet, 4, 4, "G in(disc)", {"disc": disc}).fleet.starts
    turns = 2 * angle * np.arange(32)
    inside = Obstacle.polygon(np.column_stack([np.cos(turns), np.sin(turns)]))
    away = POINT.with_(position=[3, 0])
    regions, task = {"disc": disc}, "F in(disc) and G avoid(post)"
    assert posed("rim", away, 4, 4, task, regions, {"post": inside}).obstacles
    with pytest.raises(ProblemError, match="obstacles cover the whole region"):
        posed("rim", away, 4, 4, task, regions, {"post": Disc([0, 0], 1.01)})
