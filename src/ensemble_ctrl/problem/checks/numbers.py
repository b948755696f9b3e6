"""Numbers outside their range, and ambiguous names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.moments import MAX_ORDER, Distribution, Mixture, Samples
from ensemble_ctrl.problem.checks.finding import Finding, Path

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

MAX_SEED = 2**32 - 1
MAX_STEPS = 100_000
MAX_MEMBERS = 10_000_000
MAX_SAMPLES = 40_000
"""Measured values of a parameter that a problem file can hold."""


def number_findings(problem: Problem) -> Iterator[Finding]:
    """Numbers outside their range."""
    solve, verify = problem.solve, problem.verify
    yield from _number(("horizon", "duration"), problem.duration, above=0.0, unit=" s")
    least = problem.least_duration
    if least is not None and not 0 <= least <= problem.duration:
        message = f"expected at_least from 0 s up to at_most, {problem.duration:g} s, got {least:g} s"
        yield Finding(("horizon", "duration"), message)
    count = len(problem.fleet.system.controls)
    if np.size(problem.objective.effort) not in (1, count):
        message = f"expected one weight, or {count}, got {np.size(problem.objective.effort)}"
        yield Finding(("objective", "effort"), message)
    yield from _whole(("horizon", "steps"), problem.steps, 1, MAX_STEPS)
    if problem.order is not None:
        yield from _whole(("moments", "order"), problem.order, 1, MAX_ORDER, " (or auto)")
    yield from _choice(("moments", "coordinates"), problem.coordinates, ("nodal", "modal"))
    yield from _choice(("moments", "integrator"), problem.integrator, ("exponential", "rk4"))
    yield from _factors(problem)
    yield from _number(("fleet", "radius"), problem.fleet.radius, least=0.0, unit=" m")
    yield from _number(("solve", "time_limit"), solve.time_limit, above=0.0, unit=" s")
    yield from _number(("solve", "margin"), solve.margin, least=0.0, unit=" m")
    yield from _whole(("solve", "seed"), solve.seed, 0, MAX_SEED)
    if not isinstance(solve.routes, str) or solve.routes != "all":
        yield from _whole(("solve", "routes"), solve.routes, 1, 1000, " (or all)")
    yield from _whole(("solve", "max_iterations"), solve.max_iterations, 1, 1_000_000)
    yield from _whole(("solve", "cells"), solve.cells, 1, 64)
    if not isinstance(solve.solver, str) or not solve.solver:
        yield Finding(("solve", "solver"), f"expected the name of a solver, got {solve.solver!r}")
    yield from _choice(("solve", "method"), solve.method, ("nlp", "minlp"))
    yield from _choice(("solve", "grid"), solve.grid, ("coarse", "full"))
    yield from _choice(("solve", "facets"), solve.facets, ("near", "all", "linear"))
    yield from _number(("solve", "bonmin_limit"), solve.bonmin_limit, above=0.0, unit=" s")
    yield from _choice(("solve", "guarantee"), solve.guarantee, ("moment", "nodes", "hull"))
    yield from _whole(("verify", "members"), verify.members, 1, MAX_MEMBERS)
    yield from _whole(("verify", "substeps"), verify.substeps, 1, 1000)


def _number(
    path: Path, value: float, least: float = -math.inf, above: float = -math.inf, unit: str = ""
) -> Iterator[Finding]:
    """A finite number in range."""
    if not math.isfinite(value) or value < least or value <= above:
        bound = f"of at least {least:g}" if least > -math.inf else f"above {above:g}"
        yield Finding(path, f"expected a finite number {bound}, got {value:g}{unit}")


def _whole(path: Path, value: object, least: int, most: int, also: str = "") -> Iterator[Finding]:
    """A whole number in range."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not least <= value <= most:  # type: ignore[operator]
        yield Finding(path, f"expected a whole number from {least} to {most}{also}, got {value!r}")


def _choice(path: Path, value: object, known: tuple[str, ...]) -> Iterator[Finding]:
    """One of a few words."""
    if not isinstance(value, str) or value not in known:
        yield Finding(path, f"expected one of {', '.join(known)}, got {value!r}")


def _factors(problem: Problem) -> Iterator[Finding]:
    """Factors are positive, since a robot with traction zero can't move; and a file can hold the distributions."""
    for name, distribution in problem.fleet.parameters.items():
        path = ("fleet", "parameters", name)
        if name in problem.fleet.system.factors and distribution.lower <= 0:
            field = {Samples: "samples", Mixture: "mixture"}.get(type(distribution), "range")
            yield Finding(
                (*path, field), f"expected a range above 0, got [{distribution.lower:g}, {distribution.upper:g}]"
            )
        count = _measured(distribution)
        if count > MAX_SAMPLES:
            message = f"expected at most {MAX_SAMPLES} measured values, got {count}"
            yield Finding((*path, "samples"), message, "keep every tenth, say: the distribution hardly changes")


def _measured(distribution: Distribution) -> int:
    """How many measured values a distribution holds."""
    if isinstance(distribution, Mixture):
        return sum(_measured(part) for part, _ in distribution.parts)
    return len(distribution.values) if isinstance(distribution, Samples) else 0


def name_findings(problem: Problem) -> Iterator[Finding]:
    """Names that are ambiguous in a task."""
    for kind, names in (("regions", problem.regions), ("obstacles", problem.obstacles)):
        for name in names:
            if name in RESERVED or name == ALL_OBSTACLES:
                yield Finding(
                    (kind, name),
                    f"{name!r} is a word of the task language",
                    "choose another name",
                    on_key=True,
                )
    for name in problem.obstacles:
        if name in problem.regions:
            yield Finding(("obstacles", name), f"{name!r} is a region's name too", "choose another name", on_key=True)
