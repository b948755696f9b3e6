"""What a problem uses that its system does not support, and shapes that are not of the position's dimension."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.constraints.stl import Avoid, Inside, Not
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.problem.capabilities import FEATURES, supports
from ensemble_ctrl.problem.checks.finding import Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def support_findings(problem: Problem) -> Iterator[Finding]:
    """What is used and not supported (`ensemble_ctrl.problem.capabilities`)."""
    for name, feature in FEATURES.items():
        if feature.requested(problem) and not (found := supports(problem, name)):
            yield Finding(feature.path, found.message, found.hint)
    yield from _of_bodies(problem)
    if problem.fleet.system.transcription == "states":
        yield from _of_positions(problem)


def _of_bodies(problem: Problem) -> Iterator[Finding]:
    """Bodies are kept out throughout a window: other formulas are about the planned point."""
    limits = any(zone.speed is not None for zone in problem.zones.values())  # refused by themselves
    if problem.fleet.footprint is not None and not limits and (why := problem.specification.elsewhere):
        yield Finding(("task",), why, "write G[a,b] avoid(...) joined by and")


def _of_positions(problem: Problem) -> Iterator[Finding]:
    """Choices of how facets are searched for robots on arcs."""
    solve, name = problem.solve, problem.fleet.system.name
    given = {"grid": solve.grid == "coarse", "facets": solve.facets == "near", "polish": solve.polish}
    for field in (field for field, default in given.items() if not default):
        yield Finding(("solve", field), f"this is not for the {name}", "facets are chosen in one way there")


def dimension_findings(problem: Problem) -> Iterator[Finding]:
    """Regions, obstacles and the target have as many coordinates as the position."""
    places, target = problem.fleet.places, problem.objective.target
    wanted = f"expected {len(places)} dimension{'s' * (len(places) > 1)} ({', '.join(places)})"
    for name, region in problem.regions.items():
        if region.A.shape[1] != len(places):
            yield Finding(("regions", name), f"{wanted}, got {region.A.shape[1]}", on_key=True)
    for name, pieces in problem.obstacles.items():
        if len(places) == 1:
            yield Finding(("obstacles", name), "expected none: a position of one coordinate has regions only")
        elif odd := [piece for piece in pieces if piece.A.shape[1] != len(places)]:
            yield Finding(("obstacles", name), f"{wanted}, got {odd[0].A.shape[1]}", on_key=True)
    for name, motion in problem.motions.items():
        if motion.offsets.shape[1] != len(places):
            yield Finding(("motions", name), f"{wanted}, got {motion.offsets.shape[1]}", on_key=True)
    if len(places) == 1 and _keeps_out(problem.task):
        yield Finding(("task",), "a position of one coordinate can't be kept out of places", "write x <= 1 or the like")
    if isinstance(target, np.ndarray) and len(target) != len(places):
        message = f"expected one number for each of {', '.join(places)}, got {target.tolist()}"
        yield Finding(("objective", "terminal", "target"), message)


def _keeps_out(formula: Formula) -> bool:
    """Whether a formula avoids a place."""
    outside = isinstance(formula, Not) and isinstance(formula.child, Inside)
    return isinstance(formula, Avoid) or outside or any(_keeps_out(part) for part in formula.parts)
