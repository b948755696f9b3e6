"""The bounds of a plan of any system: what `certify` asks, answered from one enclosure of all members."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import Bound, nearest_piece, nearness
from ensemble_ctrl.certificate.general.clearance import Prover
from ensemble_ctrl.certificate.general.enclosure import Enclosure, enclose
from ensemble_ctrl.certificate.general.start import Start
from ensemble_ctrl.certificate.general.task import Elements, bound_task
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.certificate.schedule import Schedule
from ensemble_ctrl.certificate.share import weighed
from ensemble_ctrl.certificate.task import TaskBound
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.constraints.stl.leaves import Predicate
from ensemble_ctrl.constraints.stl.rewrite import negation_normal_form, reads_fleet
from ensemble_ctrl.problem.specification import AvoidConstraint, ChanceConstraint, TaskPart

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem


Floats = NDArray[np.float64]

SPLITS = (1, 4, 16)
"""Parts into which each piece of time is cut, in turn, until a part of the task is proven or refuted."""


@dataclass(eq=False)
class GeneralProof:
    """The bounds of one plan.

    Parameters
    ----------
    problem : Problem
    controls : ndarray, shape (steps, n_u)
    distributions : mapping of str to Distribution
        The ranges that the claim is about.
    spread : ndarray, shape (states,), optional
        By how much each state may start off besides.

    Raises
    ------
    Unenclosed
        By every bound, if the system can't be enclosed.
    """

    counts_errors: ClassVar[bool] = True
    problem: Problem
    controls: Floats
    distributions: Mapping[str, Distribution]
    spread: Floats | None = None

    @cached_property
    def enclosure(self) -> Enclosure:
        """Where every member is at every instant."""
        fleet = self.problem.fleet
        return enclose(fleet.system, self._start, self.controls, self.problem.duration, fleet.uncertainty)

    @cached_property
    def _start(self) -> Start:
        """The ranges and where members start."""
        fleet, names = self.problem.fleet, tuple(self.distributions)
        shifts = [fleet.shifted(name) for name in names]
        given = {**fleet.system.start(), **fleet.start}
        return Start(
            names,
            np.array([distribution.lower for distribution in self.distributions.values()], dtype=float),
            np.array([distribution.upper for distribution in self.distributions.values()], dtype=float),
            np.array([float(given.get(name, 0.0)) for name in fleet.states]),
            np.array(shifts, dtype=np.int64),
            self.spread,
        )

    @cached_property
    def _prover(self) -> Prover:
        """The search for the least clearance."""
        fleet = self.problem.fleet
        rows, begin = np.eye(len(fleet.states))[fleet.place_columns], self._start
        return Prover(
            self.enclosure, rows, fleet.names, begin.lower, begin.upper, self.problem.duration, len(self.controls)
        )

    @property
    def boxes(self) -> int:
        """Boxes looked at for clearances so far."""
        return self._prover.boxes

    def nearness(self, avoid: AvoidConstraint) -> float:
        """About the clearance from one obstacle or region, metres."""
        return nearness(self._prover, avoid, self._spans(avoid))

    def clearance(self, avoid: AvoidConstraint, enough: float = np.inf) -> Bound:
        """The worst piece of what is avoided; one proven to be further away than `enough` is not refined."""
        return nearest_piece(self._prover, avoid, self._spans(avoid), enough)

    def _spans(self, avoid: AvoidConstraint) -> Spans:
        """When something is avoided."""
        return Spans.of(avoid.begin, avoid.end, self.problem.duration, len(self.controls))

    def part(self, part: TaskPart) -> TaskBound:
        """The bound of one part of the task, on finer time where the pieces' bounds stand in the way."""
        formula = negation_normal_form(part.formula)
        states = tuple(sorted({name for predicate in _predicates(formula) for name, _ in predicate.coefficients}))
        duration, steps, parts = self.problem.duration, len(self.controls), self.enclosure.parts
        bound = TaskBound(str(part), -np.inf, np.inf, {}, covered=False)
        for split in SPLITS if self.spread is None else SPLITS[:2]:
            # time cut at the ends of the enclosure's pieces, each in `split` parts
            schedule = Schedule.of(formula, duration, np.full(steps, parts * split, dtype=np.int64))
            if schedule is None:
                break
            elements = Elements.of(schedule.mesh, duration, steps, parts)
            fleet = weighed(self.problem, self.distributions)
            bound = bound_task(self.enclosure, schedule, elements, states, fleet, reads_fleet(part.written))
            if bound.proven >= 0 or bound.sampled < 0:
                break
        unit = self.problem.fleet.unit_of(states)
        return replace(bound, part=str(part), unit="" if unit == "m" else unit)

    def share(self, chance: ChanceConstraint) -> TaskBound:
        """The bound of ``share(p, f)``: the cells whose members all do `f`, weighed."""
        found, problem = self.part(chance.part), self.problem
        if found.sampled < 0 and problem.fleet.radius > 0:
            # predicates grow obstacles by the radius with sharp corners: what is refuted is refuted without it
            bare = problem.with_(fleet=replace(problem.fleet, radius=0.0))
            other = GeneralProof(bare, self.controls, self.distributions)
            other.enclosure = self.enclosure
            found = replace(found, sampled=other.part(TaskPart.of(bare, chance.share)).sampled)
        return replace(found, share=chance.share.p) if found.proven >= 0 else found


def _predicates(formula: Formula) -> Iterator[Predicate]:
    """Every predicate of a ground formula."""
    if isinstance(formula, Predicate):
        yield formula
    for part in formula.parts:
        yield from _predicates(part)
