"""The certificate of a plan: bounds for every avoided obstacle and every part of the task, and a verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import Bound, CounterExample, Verdict, nearest_piece, nearness
from ensemble_ctrl.certificate.clearance import Prover
from ensemble_ctrl.certificate.enclosure import Flow, Ranged
from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.certificate.share import boxes, weighed
from ensemble_ctrl.certificate.starts import of_each_start
from ensemble_ctrl.certificate.task import TaskBound, bound_task
from ensemble_ctrl.constraints.stl.rewrite import leaves
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.plain import at_least
from ensemble_ctrl.core.values import shown
from ensemble_ctrl.problem.signals import names_in
from ensemble_ctrl.problem.specification import NOTHING_AVOIDED, NOTHING_REQUIRED, TaskPart, unjudged_bodies

if TYPE_CHECKING:
    from ensemble_ctrl.moments import Distribution
    from ensemble_ctrl.problem import Problem
    from ensemble_ctrl.problem.fleet import Fleet
    from ensemble_ctrl.problem.specification import AvoidConstraint, ChanceConstraint

Floats = NDArray[np.float64]
SPLITS = (1, 4, 16)
"""Parts into which each step is cut, in turn, until a part of the task is proven or refuted."""
ENOUGH = 0.5
"""Metres of clearance beyond which an obstacle's bound is not refined, if another one is nearer."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """What is proven of a plan, for every member with parameters in `ranges` and every instant.

    Attributes
    ----------
    proven : {"yes", "no", "undecided"}
        ``yes``: every bound is positive or zero. ``no``: `counter_example` violates the task.
    clearances : tuple of Bound
        Proven and sampled clearance for each avoidance constraint.
    parts : tuple of TaskBound
        Proven and sampled robustness of the other parts of the task.
    counter_example : CounterExample or None
        A concrete violation.
    ranges : dict of str to (float, float)
        Range of each parameter that the claim is about.
    boxes : int
        Parameter-time boxes examined for clearances.
    seconds : float
        What it took.
    inputs : str
        SHA-256 of the controls and of everything in the problem that the claim depends on.
    reason : str
        Why nothing can be said of any part, in words; empty where there are bounds.
    uncertainty : dict
        Bounds of the errors of the model that the claim is for, with the terrain, as plain data; empty without any.
    enough : float or None
        Metres: a clearance that is proven to be larger, and larger than the least, is not refined. None if each is.

    Notes
    -----
    *Guarantee*: with ``yes``, every member with its parameters in the ranges does the task in dense time, rounding
    included, under every disturbance within the bounds of `uncertainty`; without such bounds, if it follows the model
    exactly. Not covered: errors beyond the bounds, and rounding in the robot.
    """

    proven: Verdict
    clearances: tuple[Bound, ...]
    parts: tuple[TaskBound, ...]
    counter_example: CounterExample | None
    ranges: dict[str, tuple[float, float]]
    boxes: int
    seconds: float
    inputs: str
    reason: str = ""
    uncertainty: Mapping[str, Any] = field(default_factory=dict)
    enough: float | None = None

    @property
    def clearance(self) -> float:
        """Smallest proven clearance in metres; infinite without obstacles."""
        return min((b.proven for b in self.clearances), default=np.inf)

    @property
    def robustness(self) -> float:
        """Smallest proven robustness of the parts that do not only avoid, in `unit`; infinite without such parts."""
        return min((b.proven for b in self.parts), default=np.inf)

    @property
    def unit(self) -> str:
        """What follows `robustness`: ``m``, the unit that all parts have, or that they have several."""
        units = {part.unit or "m" for part in self.parts} or {"m"}
        return units.pop() if len(units) == 1 else "in mixed units"

    @property
    def empty(self) -> bool:
        """Whether it holds only because the task asks nothing, as one that avoids the obstacles of an empty map."""
        claims = [*self.clearances, *(part for part in self.parts if np.isfinite(part.proven))]
        return self.proven == "yes" and not claims

    def __repr__(self) -> str:
        if self.empty:
            return f"Certificate({NOTHING_REQUIRED})"
        scope = ", ".join(f"{name} {low:g}..{high:g}" for name, (low, high) in self.ranges.items())
        clearance = f"clearance >= {at_least(self.clearance)} m" if np.isfinite(self.clearance) else NOTHING_AVOIDED
        rest = f"robustness >= {at_least(self.robustness)} {self.unit}, {self.seconds:.2f} s"
        errors = ", errors of the model" if self.uncertainty else ""
        return f"Certificate(proven: {self.proven}, {scope}{errors}, {clearance}, {rest})"


@np.errstate(over="ignore", invalid="ignore")  # what overflows proves nothing
def certify(
    problem: Problem, controls: Floats, ranges: Mapping[str, Distribution] | None = None, *, each: bool = False
) -> Certificate:
    """Prove, refute or leave undecided that `controls` are good for every member.

    Parameters
    ----------
    problem : Problem
        Fleet, map and task.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    ranges : mapping of str to Distribution, optional
        Other ranges than the fleet's for some of its parameters.
    each : bool
        Whether to refine the clearance of each obstacle; without it, of one that is proven to be further away than
        `ENOUGH` and than the nearest one, no more is claimed than that.

    Raises
    ------
    ProblemError
        For names that are not the fleet's, and for controls of another shape than (steps, n_u) or not finite.

    Returns
    -------
    Certificate
    """
    began = time.perf_counter()
    if not hasattr(problem, "fleet"):
        raise ProblemError(f"problem: expected a Problem, got {shown(problem)}")
    distributions, controls = _distributions(problem, ranges), problem.fleet.checked_controls(controls)
    if len(controls) != problem.steps:
        raise ProblemError(f"controls: expected a row for each of {problem.steps} steps, got {len(controls)}")
    if problem.fleet.starts:
        return of_each_start(problem, controls, distributions, lambda one: certify(one, controls, ranges, each=each))
    proof = PROOFS[problem.fleet.enclosure](problem, controls, distributions)
    specification = problem.specification
    chances = {id(chance.part): chance for chance in specification.chance}
    try:
        if problem.pairs:
            raise Unenclosed("members of several starts in one frame are no fleet to prove something of")
        if problem.uncertain and not getattr(proof, "counts_errors", False):
            raise Unenclosed("this enclosure does not count errors of the model")
        if why := unjudged_bodies(problem):
            raise Unenclosed(why)
        clearances = _clearances(proof, specification.avoid, np.inf if each else ENOUGH)
        parts = tuple(
            proof.share(chances[id(part)]) if id(part) in chances else proof.part(part) for part in specification.parts
        )
        looked, reason = proof.boxes, ""
    except Unenclosed as error:
        clearances, parts, looked, reason = (), (), 0, str(error)
    found = _counter_example(clearances, parts)
    # yes: every bound is at least 0, and a comparison with NaN is false; no: an upper bound is below 0
    good = all(b.proven >= 0 for b in clearances) and all(b.covered and b.proven >= 0 for b in parts)
    verdict: Verdict = "no" if found else "yes" if good and not reason else "undecided"
    return Certificate(
        verdict,
        clearances,
        parts,
        found,
        {name: (distribution.lower, distribution.upper) for name, distribution in distributions.items()},
        looked,
        time.perf_counter() - began,
        fingerprint(problem, controls, distributions),
        reason,
        problem.errors,
        None if each or len(clearances) < 2 else ENOUGH,
    )


def unproven(problem: Problem, controls: Floats, reason: str) -> Certificate:
    """The certificate of a proof that was not finished: nothing is claimed of the fleet's own ranges."""
    distributions = dict(problem.fleet.parameters)
    ranges = {name: (distribution.lower, distribution.upper) for name, distribution in distributions.items()}
    inputs, bounds = fingerprint(problem, controls, distributions), problem.errors
    return Certificate("undecided", (), (), None, ranges, 0, 0.0, inputs, reason, bounds)


def _distributions(problem: Problem, ranges: Mapping[str, Distribution] | None) -> dict[str, Distribution]:
    """The fleet's ranges, some of them replaced."""
    if ranges is not None and not isinstance(ranges, Mapping):
        raise ProblemError(f"ranges: expected a mapping of names to distributions, got {shown(ranges)}")
    distributions = dict(problem.fleet.parameters)
    for name, distribution in (ranges or {}).items():
        if name not in distributions:
            raise ProblemError(f"ranges: expected names among {', '.join(distributions)}, got {name!r}")
        distributions[name] = distribution
    return distributions


class Proof(Protocol):
    """The bounds of one plan for members with parameters in some ranges.

    One that counts the errors of a fleet's model says so by an attribute ``counts_errors``; others are refused these.
    """

    @property
    def boxes(self) -> int:
        """Boxes looked at for clearances so far."""

    def nearness(self, avoid: AvoidConstraint) -> float:
        """About the clearance from one obstacle or region, metres."""

    def clearance(self, avoid: AvoidConstraint, enough: float = np.inf) -> Bound:
        """The clearance from one obstacle or region; one proven to be above `enough` is not refined."""

    def part(self, part: TaskPart) -> TaskBound:
        """The robustness of one part of the task."""

    def share(self, chance: ChanceConstraint) -> TaskBound:
        """The robustness of a part for a share of the fleet."""


@dataclass(eq=False)
class ArcsProof:
    """The bounds of robots on arcs, from the closed form of their motion."""

    counts_errors: ClassVar[bool] = True
    problem: Problem
    controls: Floats
    distributions: Mapping[str, Distribution]

    @cached_property
    def _prover(self) -> Prover:
        """The search for the least clearance."""
        return Prover(Flow.of(self.problem, self.controls, self.distributions), self.problem.fleet.names, early=True)

    @cached_property
    def _fleet(self) -> Fleet:
        """The fleet that shares and means are of."""
        return weighed(self.problem, self.distributions)

    @property
    def boxes(self) -> int:
        """Boxes looked at for clearances so far."""
        return self._prover.boxes

    def nearness(self, avoid: AvoidConstraint) -> float:
        """About the clearance from one obstacle or region, metres."""
        return nearness(self._prover, avoid, _spans(self._prover, self.problem, avoid))

    def clearance(self, avoid: AvoidConstraint, enough: float = np.inf) -> Bound:
        """The clearance from one obstacle or region; one proven to be above `enough` is not refined."""
        return nearest_piece(self._prover, avoid, _spans(self._prover, self.problem, avoid), enough)

    def part(self, part: TaskPart) -> TaskBound:
        """The robustness of one part of the task."""
        return part_bound(self.problem, self.controls, self.distributions, part, self._fleet)

    def share(self, chance: ChanceConstraint) -> TaskBound:
        """The robustness of a part for a share of the fleet."""
        found = _share(self.problem, self.controls, self.distributions, self._fleet, chance)
        return replace(found, unit=_unit(self.problem, chance.part))


def _general(problem: Any, controls: Floats, distributions: Mapping[str, Distribution]) -> Proof:
    """The bounds of any smooth system, from an enclosure of its differential equation."""
    from ensemble_ctrl.certificate.general.proof import GeneralProof

    return GeneralProof(problem, controls, distributions)


PROOFS: dict[str, Callable[[Any, Floats, Mapping[str, Distribution]], Proof]] = {"arcs": ArcsProof, "general": _general}
"""Where bounds come from, by the name of a fleet's enclosure."""


def _clearances(proof: Proof, avoid: Sequence[AvoidConstraint], enough: float) -> tuple[Bound, ...]:
    """The clearance from each obstacle and region, the nearest first: the others need only be far enough."""
    near = [proof.nearness(one) for one in avoid]
    found: dict[int, Bound] = {}
    for k in np.argsort(near, kind="stable").tolist():
        # above the least distance seen so far, a bound changes nothing; up to `enough` it is wanted all the same
        least = min((b.sampled for b in found.values()), default=np.inf)
        found[k] = proof.clearance(avoid[k], max(least, enough))
    return tuple(found[k] for k in range(len(avoid)))


def _spans(prover: Prover, problem: Problem, avoid: AvoidConstraint) -> Spans:
    """When something is avoided."""
    # who is late by up to a delay is where others were that long before
    begin = max(0.0, avoid.begin - prover.flow.delay * (1 + 1e-9))
    return Spans.of(begin, avoid.end, problem.duration, prover.flow.steps)


def part_bound(
    problem: Problem,
    controls: Floats,
    ranges: Mapping[str, Ranged],
    part: TaskPart,
    fleet: Fleet,
    wanted: float = 0.0,
    cells: int = 0,
    enough: float = np.inf,
) -> TaskBound:
    """The bound of one part of the task; on finer time where the bulges between grid times stand in the way.

    `wanted` is the robustness in metres that would do; `fleet`, `cells` and `enough` as for `bound_task`.
    """
    # finer time until the bound is good enough, or an upper bound says that it never will be
    for split in SPLITS:
        bound = bound_task(problem, controls, ranges, part.formula, fleet, split, cells, enough)
        if bound.proven >= wanted or bound.sampled < wanted:
            break
    return replace(bound, part=str(part), unit=_unit(problem, part))


def _unit(problem: Problem, part: TaskPart) -> str:
    """What follows the robustness of a part; empty for metres."""
    unit = problem.fleet.unit_of({name for leaf in leaves(part.resolved) for name in names_in(leaf)})
    return "" if unit == "m" else unit


def _share(
    problem: Problem,
    controls: Floats,
    distributions: Mapping[str, Distribution],
    fleet: Fleet,
    chance: ChanceConstraint,
) -> TaskBound:
    """The bound of ``share(p, f)``: that of `f` for all members of a box with enough mass, if one is proven."""
    best: TaskBound | None = None
    for box, mass in boxes(problem, controls, fleet, chance):
        prover = Prover(Flow.of(problem, controls, box), problem.fleet.names, early=True)
        # f for every member of the box, as for a fleet of its own: its mass is a lower bound of the share
        bounds = [nearest_piece(prover, avoid, _spans(prover, problem, avoid)).proven for avoid in chance.avoid]
        bounds += [part_bound(problem, controls, box, part, fleet).proven for part in chance.rest]
        found = TaskBound(str(chance.part), min(bounds, default=np.inf), np.inf, {}, share=mass)
        if best is None or found.proven > best.proven:
            best = found
        if found.proven >= 0:
            break
    if best is not None and best.proven >= 0:
        return best
    found = part_bound(problem, controls, distributions, chance.part, fleet)  # members that need not be side by side
    if found.sampled < 0 and problem.fleet.radius > 0:
        # predicates grow obstacles by the radius with sharp corners: what is refuted is refuted without it
        bare = problem.with_(fleet=replace(problem.fleet, radius=0.0))
        found = replace(
            found, sampled=part_bound(bare, controls, distributions, TaskPart.of(bare, chance.share), fleet).sampled
        )
    if best is not None and best.proven >= found.proven:
        return replace(best, sampled=found.sampled)
    return replace(found, share=chance.share.p) if found.proven >= 0 else found


def _counter_example(clearances: Sequence[Bound], parts: Sequence[TaskBound]) -> CounterExample | None:
    """The worst violation seen."""
    found = [
        CounterExample(f"avoid({b.obstacle})", b.parameters, b.time, -b.sampled) for b in clearances if b.sampled < 0
    ]
    found += [CounterExample(b.part, b.parameters, None, -b.sampled) for b in parts if b.covered and b.sampled < 0]
    return max(found, key=lambda c: c.amount, default=None)
