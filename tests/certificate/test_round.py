"""Verdicts about round shapes that polygons stand for: neither proven nor refuted by what is between the two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.systems import SingleIntegrator, Unicycle

STILL = np.zeros((2, 2))
AWAY = Polyhedron.box([[90, 91], [90, 91]])
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.2, 0.7], [0.1, 1.0]])


def posed(*given: Any, **more: Any) -> Problem:
    """A problem; it is given texts and lists, too, which it reads."""
    return Problem(*given, **more)


def _verdict(task: str, place: np.ndarray, shape: Polyhedron, radius: float = 0.0, still: bool = True) -> str:
    """What is proven of a robot that stands somewhere."""
    robot = Unicycle() if still else SingleIntegrator()
    fleet = Fleet(robot, {}, position=place, radius=radius)
    return certify(posed("round", fleet, 1, 2, task, {"shape": shape, "away": AWAY}), STILL).proven


@pytest.mark.parametrize("still", [True, False], ids=["arcs", "states"])
@pytest.mark.parametrize("middle", [0.0, 1e5])
def test_discs_are_judged_by_neither_polygon(middle: float, still: bool) -> None:
    rng, disc = np.random.default_rng(7), DiscRegion(Disc([middle, -middle], 1.0))
    seen = set()
    for away in [*rng.uniform(0.99, 1.01, 30), 0.9, 0.9985, 1.0015, 1.1]:
        angle = np.pi / 32 if away in (0.9985, 1.0015) else rng.uniform(0, 2 * np.pi)
        place = disc.disc.center + away * np.array([np.cos(angle), np.sin(angle)])
        inside = float(np.hypot(*(place - disc.disc.center))) < 1
        for task, holds in (("F[0,1] in(shape)", inside), ("F[0,1] not in(shape)", not inside)):
            verdict = _verdict(task, place, disc, still=still)
            assert verdict != ("no" if holds else "yes")
            seen.add((holds, verdict))
    assert {(True, "yes"), (False, "no"), (True, "undecided"), (False, "undecided")} <= seen


@pytest.mark.parametrize("shape", ["polygon", "disc"])
def test_places_grown_by_the_radius_have_round_corners(shape: str) -> None:
    rng, radius = np.random.default_rng(3), 0.4
    region = Polyhedron.polygon(CORNERS) if shape == "polygon" else DiscRegion(Disc([0.5, 0.5], 0.6))
    exact = shapely.Polygon(CORNERS) if shape == "polygon" else None
    seen = set()
    for place in np.concatenate([rng.uniform(-0.6, 1.8, (60, 2)), [[1.3, -0.3], [-0.3, -0.3], [-0.25, 1.3]]]):
        if exact is None:
            clear = float(np.hypot(*(place - 0.5))) - 0.6 - radius
        else:
            clear = exact.distance(shapely.Point(place)) - radius
        for task, holds in (("F[0,1] avoid(shape)", clear > 0), ("F[0,1] not avoid(shape)", clear < 0)):
            verdict = _verdict(task, place, region, radius)
            assert verdict != ("no" if holds else "yes")
            seen.add((holds, verdict))
    assert {(True, "yes"), (False, "no")} <= seen


def test_limits_at_a_sharp_corner_of_a_zone_are_not_refuted() -> None:
    zones = {"slow": Zone((Obstacle.box([[-1, 1], [-1, 1]]),), 0.5)}

    def verdict(place: float) -> str:
        fleet = Fleet(Unicycle(), {}, position=[place, place], heading=0.0, radius=0.5)
        problem = posed("corner", fleet, 1e-3, 2, "F not in(away)", {"away": AWAY}, zones=zones)
        return certify(problem, np.array([[1.0, 0.0]] * 2)).proven

    # (1.36, 1.36) is 0.509 m from the corner, and (1.3, 1.3) 0.424 m
    assert [verdict(place) for place in (1.36, 1.3, 1.51)] == ["undecided", "no", "yes"]
