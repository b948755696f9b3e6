"""What a fleet with several starts can't ask for, and what is wrong at some of its starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.constraints.disc import corners_around
from ensemble_ctrl.constraints.stl import Always, Inside, conjuncts
from ensemble_ctrl.constraints.stl.rewrite import reads_fleet
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.members_apart import members_apart_findings, too_close
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.systems import SYSTEMS

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

WHY = "this is for fleets with one start, and fleet.starts has several"
FAR = 10.0
"""Metres by which members are moved, to see whether their rates change."""


def findings_of_starts(problem: Problem, each: Callable[[Problem], tuple[Finding, ...]]) -> tuple[Finding, ...]:
    """What `each` finds of the members of every start; what is about all of them is said once."""
    if refused := (*_refused(problem), *_rates(problem), *members_apart_findings(problem)):
        return refused
    found = {name: each(one) for name, one in by_start(problem).items()}
    common = [one for one in next(iter(found.values())) if all(one in other for other in found.values())]
    own = (_at(one, name) for name, findings in found.items() for one in findings if one not in common)
    return (*common, *own, *_gathered(problem), *too_close(problem))


def _at(finding: Finding, name: str) -> Finding:
    """A finding of one start, at that start's line."""
    if finding.path[:2] == ("fleet", "start"):
        return replace(finding, path=("fleet", "starts", name))
    return replace(finding, message=f"from start {name}: {finding.message}")


def _gathered(problem: Problem) -> Iterator[Finding]:
    """Regions that all members have to be in at one time, and that are narrower than the starts are apart.

    Notes
    -----
    *Guarantee*: certain, for the models that come with the package: their rates do not depend on the position, so
    members of equal parameters keep their offsets under every command.
    """
    system, offsets = problem.fleet.system, np.array(list(problem.fleet.starts.values()))
    if SYSTEMS.get(system.name) is not type(system):
        return
    for part in conjuncts(problem.task):
        inside = conjuncts(part.child) if isinstance(part, Always) else ()
        for name in (leaf.name for leaf in inside if isinstance(leaf, Inside)):
            region = problem.regions.get(name)
            if region is None or region.is_empty or not region.is_bounded:
                continue
            # along each side's normal: how far the starts are apart, and how wide the region is, metres
            normals = region.A / np.linalg.norm(region.A, axis=1, keepdims=True)
            spread, width = (np.ptp(points @ normals.T, axis=0) for points in (offsets, corners_around(region)))
            k = int((spread - width).argmax())
            if spread[k] - width[k] > SLACK:
                message = (
                    f"no command brings all members into {name!r} at one time: the starts are {spread[k]:.3g} m apart "
                    f"where it is {width[k]:.3g} m wide, and members of equal parameters keep their offsets"
                )
                yield Finding(("task",), message, "let them visit it in turn with F, or move the starts together")


def _refused(problem: Problem) -> Iterator[Finding]:
    """What is not for several starts."""
    objective = problem.objective
    asked = {
        ("task",): reads_fleet(problem.task),
        ("objective", "cvar"): objective.cvar is not None,
        ("objective", "terminal", "target"): not isinstance(objective.target, np.ndarray | None),
        ("objective", "earliest"): objective.earliest is not None,
        ("objective", "tolerance"): objective.tolerance is not None,
        ("horizon", "duration"): problem.least_duration is not None,
        ("moments", "coordinates"): problem.coordinates == "modal",
        ("solve", "method"): problem.solve.method == "minlp",
        ("solve", "guarantee"): problem.solve.guarantee == "moment",
        ("report", "baseline"): problem.report.baseline,
    }
    hints = {
        ("task",): "mean(...) and share(...) are about the fleet as a whole: write the task without them",
        ("objective", "terminal", "target"): "give one place [x, y] as the target",
        ("horizon", "duration"): "give a duration",
    }
    for path, yes in asked.items():
        if yes:
            yield Finding(path, WHY, hints.get(path, ""))


def _rates(problem: Problem) -> Iterator[Finding]:
    """A system whose rates depend on the position: its members do not move alike from different places."""
    fleet = problem.fleet.of_one_start
    if fleet.system.on_arcs:
        return
    members = np.concatenate([fleet.corners, fleet.center[None]])
    here = fleet.start_states(members)
    there = here.copy()
    there[[fleet.system.states.index(name) for name in fleet.places]] += FAR
    rest = fleet.rest(fleet.center)
    rates = [fleet.system.derivatives(at, rest, fleet.psi(members)) for at in (here, there)]
    if not np.allclose(rates[0], rates[1], rtol=1e-9, atol=1e-9):
        message = f"the rates of the {fleet.system.name} depend on the position: members move alike from one place only"
        yield Finding(("fleet", "starts"), message, on_key=True)
