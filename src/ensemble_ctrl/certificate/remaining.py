r"""Proof that the rest of a plan is good for a robot of which a set of states is known.

The set holds all poses within `away` metres and `turn` radians of one pose, with parameters in their ranges.  A robot
that starts with another heading drives the same way, turned about its start: it is never further than

.. math:: r(t) = \mathrm{away} + 2 \sin(\mathrm{turn} / 2)\, \lvert p(t) - p(0) \rvert

from the robot with the same parameters that starts at the middle pose.  So the proof is that of `certify` for a fleet
without start parameters whose members grow by ``r`` with time; a predicate, being a distance, falls by no more.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.certify import part_bound
from ensemble_ctrl.certificate.clearance import Prover
from ensemble_ctrl.certificate.disturbance import UNIT
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.constraints.stl import Known
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

SPARE = 2e-3
"""Metres beyond which a proven clearance isn't sharpened."""

CELLS = 4
"""Cells of each parameter to begin with."""


@dataclass(frozen=True)
class SetCertificate:
    """What is proven of the rest of a plan.

    Attributes
    ----------
    proven : bool
        Whether every robot of the set does the rest of the task.
    clearance, robustness : float
        Proven lower bounds in metres, infinite without obstacles or without other parts.
    worst : str
        The obstacle or the part that decides.
    seconds : float
        What it took.
    """

    proven: bool
    clearance: float
    robustness: float
    worst: str
    seconds: float

    @property
    def least(self) -> float:
        """The smaller of both bounds, metres."""
        return min(self.clearance, self.robustness)


def together(found: Mapping[str, SetCertificate]) -> SetCertificate:
    """What is proven of one plan for several sets, by name: no more than of each of them.

    Notes
    -----
    *Guarantee*: with `proven`, every robot of every set does the task.
    """
    if len(found) == 1:
        return next(iter(found.values()))
    name, worst = min(found.items(), key=lambda item: item[1].least)
    return SetCertificate(
        all(each.proven for each in found.values()),
        min(each.clearance for each in found.values()),
        min(each.robustness for each in found.values()),
        f"{name}: {worst.worst}",
        sum(each.seconds for each in found.values()),
    )


def certify_set(
    problem: Problem, controls: Floats, away: float, turn: float, more: Floats | None = None
) -> SetCertificate:
    """Prove `controls` for a set of states.

    Parameters
    ----------
    problem : Problem
        What is left: its fleet starts at the middle pose, and its parameters bend trajectories; its time is 0 now.
    controls : ndarray, shape (steps, n_u)
        Commands of what is left.
    away, turn : float
        Metres and radians.
    more : ndarray, shape (steps,), optional
        Metres that robots may be further away in each step, beyond the errors of the fleet's uncertainty.

    Returns
    -------
    SetCertificate

    Notes
    -----
    *Guarantee*: with `proven`, every robot of the exact model in the set does the task in dense time. A clearance
    or robustness above `SPARE` is not sharpened further, so the bounds are not tight. Nothing is proven on terrain, of
    bodies, and of tasks about headings and speeds.
    """
    began = time.perf_counter()
    controls = problem.fleet.checked_controls(controls)
    flow = Flow.of(problem, controls)
    prover = Prover(flow, problem.fleet.names, cells=CELLS)
    # a start off by `away`, a heading off by `turn`: |R(turn) d - d| = 2 sin(turn / 2) |d|
    growth = (away + 2 * np.sin(min(turn, np.pi) / 2) * _distance(flow, prover)) * (1 + 64 * UNIT)
    growth = growth if more is None else growth + more
    # terrain: who touches it was decided for robots at the middle pose; bodies and signals change with the heading
    if problem.terrain or problem.fleet.footprint or problem.specification.signals:
        growth = np.full_like(growth, np.inf)
    found, fleet = [(np.inf, "no obstacle")], problem.fleet
    for avoid in problem.specification.avoid:
        spans = Spans.of(avoid.begin, avoid.end, problem.duration, flow.steps)
        for piece in avoid.pieces:
            bound = prover.bound(avoid.name, piece, spans, avoid.radius, avoid.motion, growth, SPARE)
            found.append((bound.proven, f"avoid({avoid.name})"))
    clearance, nearest = min(found)
    largest = float(growth.max())
    # predicates are distances: a member that is `growth` away has lost no more than that
    robustness, hardest = np.inf, ""
    for part in problem.specification.parts:
        value = -np.inf
        if isinstance(part.formula, Known):
            value = part.formula.value
        elif np.isfinite(largest):
            parameters, enough = fleet.parameters, largest + SPARE
            value = part_bound(problem, controls, parameters, part, fleet, largest, CELLS, enough).proven - largest
        robustness, hardest = min((robustness, hardest), (value, str(part)))
    worst = nearest if clearance < robustness else hardest
    proven = clearance >= 0 and robustness >= 0
    return SetCertificate(proven, clearance, robustness, worst, time.perf_counter() - began)


def _distance(flow: Flow, prover: Prover) -> Floats:
    """Upper bounds of the distance from the start of any member, for each step, metres."""
    # |p(t) - p(0)| at grid times for cells: middle, linear part, remainder
    away = np.linalg.norm(prover.track.position - prover.track.position[:, :1], axis=-1)
    sides = (np.linalg.norm(prover.track.slope, axis=-1) * prover.half[:, None]).sum(axis=-1)
    at = (away + sides + flow.remainder(prover.half)).max(axis=0)
    # within a step no member is further than at its nearer end plus half of the way
    drive = flow.fastest * flow.step * np.abs(flow.v)
    return np.asarray(np.maximum(at[:-1], at[1:]) + drive / 2 + prover.error + flow.error)
