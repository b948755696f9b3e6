"""Errors of the model that a problem can't have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.checks.finding import Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def uncertainty_findings(problem: Problem) -> Iterator[Finding]:
    """Commands that change places, and commands with their errors beyond what the model is for."""
    fleet, bounds = problem.fleet, problem.fleet.uncertainty
    yield from _tolerance_findings(problem)
    path = ("fleet", "uncertainty")
    if bounds.jitter > problem.step / 2:
        message = f"expected at most half a step, {problem.step / 2:g} s, got {bounds.jitter:g} s"
        yield Finding((*path, "jitter"), message)
    if bounds.delay > problem.duration:
        message = f"expected at most the horizon, {problem.duration:g} s, got {bounds.delay:g} s"
        yield Finding((*path, "delay"), message)
    if not fleet.system.on_arcs or not fleet.arcs.monotone:
        return
    ends = np.stack([fleet.input_lower, fleet.input_upper])
    spread = bounds.command_errors(fleet.system.controls, ends).max(axis=0)
    for k, (name, (low, high)) in enumerate(zip(fleet.system.controls, fleet.arcs.monotone, strict=True)):
        if spread[k] and not (low <= ends[0, k] - spread[k] and ends[1, k] + spread[k] <= high):
            wanted = f"expected {name} with its error within {low:g} to {high:g}"
            got = f"got {ends[0, k] - spread[k]:g} to {ends[1, k] + spread[k]:g}"
            yield Finding((*path, "actuators"), f"{wanted}, {got}", "narrow its input_bounds")


def terrain_findings(problem: Problem) -> Iterator[Finding]:
    """Patches with parameters that the system does not have, or with names of other areas."""
    known = problem.fleet.system.factors
    for name, patch in problem.terrain.items():
        if any(piece.A.shape[1] != len(problem.fleet.places) for piece in patch.pieces):
            yield Finding(("terrain", name), f"expected an area in {' and '.join(problem.fleet.places)}", on_key=True)
        for key, (low, high) in patch.parameters.items():
            if key not in known:
                message = f"expected parameters among {', '.join(known)}, got {key!r}"
                hint = "an area is given by box, polygon, disc, halfspaces, wkt, file or areas"
                yield Finding(("terrain", name, key), message, hint, on_key=True)
            elif low <= 0:
                yield Finding(("terrain", name, key), f"expected a range above 0, got [{low:g}, {high:g}]")
        for kind, others in (("a region", problem.regions), ("an obstacle", problem.obstacles)):
            if name in others:
                message = f"{name!r} is the name of {kind} too"
                yield Finding(("terrain", name), message, "choose another name", on_key=True)


def _tolerance_findings(problem: Problem) -> Iterator[Finding]:
    """Errors of which a plan is to tolerate much: some, of what the system has, and nothing else that is extreme."""
    wanted, path = problem.objective.tolerance, ("objective", "tolerance")
    if wanted is None:
        return
    if not wanted:
        yield Finding(path, "expected errors of the model, got none", "for example  disturbance: {position: 1 mm/s}")
    if problem.fleet.uncertainty:
        message = "expected no fleet.uncertainty beside it, got some"
        yield Finding(path, message, "the plan's own errors are a multiple of these")
    if problem.least_duration is not None or problem.objective.earliest is not None:
        yield Finding(path, "expected no time that is to be as short as possible beside it, got one")
    if not problem.verify.certificate:
        yield Finding(path, "expected verify.certificate: true, since what is tolerated is proven, got false")
    try:
        wanted.checked(problem.fleet.system)
    except ProblemError as error:
        yield Finding(path, str(error))
