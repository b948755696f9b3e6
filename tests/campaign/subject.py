"""A case given to the package: its problem, and what the certificate says."""

from __future__ import annotations

from typing import Any

import numpy as np

from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Beta, Distribution, Interval, Mixture, Samples, TruncatedNormal
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from . import model
from .model import Case


def distribution_of(distribution: model.Distribution) -> Distribution:
    """The package's distribution."""
    kind, *rest = distribution
    if kind == "samples":
        return Samples(rest[0])
    if kind == "mixture":
        return Mixture(*((distribution_of(part), weight) for part, weight in rest[0]))
    makers: dict[str, Any] = {"uniform": Interval, "beta": Beta, "normal": TruncatedNormal}
    made: Distribution = makers[kind](*rest)
    return made


def obstacle_of(polygon: model.Polygon, kind: int) -> Obstacle:
    """An obstacle by its corners; a rectangle along the axes by its bounds or its sides, as the kind says."""
    low, high = np.min(polygon, axis=0), np.max(polygon, axis=0)
    corners = {(float(x), float(y)) for x in (low[0], high[0]) for y in (low[1], high[1])}
    if corners != set(polygon) or kind % 3 == 0:
        return Obstacle.polygon(polygon)
    if kind % 3 == 1:
        return Obstacle.box(np.column_stack([low, high]))
    return Obstacle([[1, 0], [0, 2], [-4, 0], [0, -1]], [low[0], 2 * low[1], -4 * high[0], -high[1]])


def problem_of(case: Case) -> Problem:
    """The problem of a case, with input bounds that its controls keep."""
    most = np.maximum(np.abs(np.array(case.controls)).max(axis=0), 1e-3) * 2
    system: ArcSystem = Unicycle("y" if case.heading_from == "y" else "x")
    if case.system == "bicycle":
        system, most[1] = Bicycle("y" if case.heading_from == "y" else "x", case.wheelbase), 1.5
    cloud = {name: np.array(case.parameters[name][1]) for name in case.cloud} or None
    parameters = {name: distribution_of(distribution) for name, distribution in case.parameters.items()}
    fleet = Fleet(
        system, parameters, np.array(case.position), case.heading, -most, most, radius=case.radius, samples=cloud
    )
    return Problem(
        "case",
        fleet,
        case.duration,
        len(case.controls),
        parse(model.text(case.task)),
        {name: Polyhedron.box(box) for name, box in case.regions.items()},
        {name: tuple(obstacle_of(piece, len(case.controls)) for piece in p) for name, p in case.obstacles.items()},
        {name: Motion(np.array(times), np.array(places)) for name, (times, places) in case.motions.items()},
    )


def certified(case: Case) -> Certificate:
    """What is proven of a case's controls."""
    ranges = {name: Interval(*ends) for name, ends in (case.ranges or {}).items()}
    return certify(problem_of(case), np.array(case.controls), ranges or None)
