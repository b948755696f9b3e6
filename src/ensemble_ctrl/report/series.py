"""What the charts show: how well the fleet does its task over time, and how close it comes for every parameter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, leaves, member_robustness
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import affordable, all_states, headings
from ensemble_ctrl.problem.signals import columns, with_signals
from ensemble_ctrl.problem.specification import TaskPart

Floats = NDArray[np.float64]

MEMBERS = 41
"""Members evaluated over time, spread over the parameters' ranges."""
VALUES = 121
"""About as many members are evaluated over one parameter, at even distances."""
GRID = 600
"""The same for fleets with several parameters."""
DRAWN_CLEARANCE = 5.0
"""Obstacles are left out of the chart over the parameter that are this much farther away than the closest, and more
than `NEAR` metres."""
NEAR = 0.5
CURVES = 6
"""Obstacles and parts shown at most, those that come closest to failing."""
SUBSTEPS = 2
"""Samples per step."""


@dataclass(frozen=True, eq=False)
class Series:
    """A part of the task over time.

    Attributes
    ----------
    name : str
        A place or predicate of the task, or ``closest obstacle``.
    low, high : ndarray, shape (times,)
        Worst and best member's distance from failing it, metres or the unit of the state; NaN where it is not required.
    begin, end : float
        The window in which it is required, seconds.
    """

    name: str
    low: Floats
    high: Floats
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class Profile:
    """How close members come to failing, over the first parameter.

    Attributes
    ----------
    parameter : str
        Its name; empty for a fleet without parameters.
    values : ndarray, shape (values,)
        Its values.
    clearances : dict of str to ndarray, shape (values,)
        Smallest distance from each obstacle over time and over the other parameters, metres.
    parts : dict of str to ndarray, shape (values,)
        Robustness of the other parts of the task, the same way, metres.
    far : tuple of str
        Obstacles that are left out: they are far from every member.
    """

    parameter: str
    values: Floats
    clearances: dict[str, Floats]
    parts: dict[str, Floats]
    far: tuple[str, ...] = ()

    @property
    def curves(self) -> dict[str, Floats]:
        """Those of both kinds that come closest to failing, `CURVES` at most, closest first."""
        both = sorted({**self.clearances, **self.parts}.items(), key=lambda item: float(item[1].min()))
        return dict(both[:CURVES])


def distance_label(problem: Problem) -> str:
    """What charts of robustness measure: metres, where a task can refer to nothing but the position."""
    unit = "m" if columns(problem) == problem.fleet.places else "SI"
    return f"distance from failing [{unit}]"


def over_time(problem: Problem, controls: Floats) -> tuple[Floats, tuple[Series, ...]]:
    """Seconds, shape (times,), and a series for every place that the task refers to, most critical first.

    Notes
    -----
    *Guarantee*: exact for `MEMBERS` members at the grid times, corners of the ranges included; for pictures, no proof.
    """
    members = np.concatenate([problem.fleet.spread(affordable(MEMBERS, problem.steps)), problem.fleet.corners])
    whole, members = all_states(problem, controls, members)
    times = np.linspace(0.0, problem.duration, whole.shape[1])
    turned = headings(problem, controls, members)
    found = [
        *_kept_out(problem, whole[..., problem.fleet.place_columns], times, turned),
        *_asked(problem, with_signals(problem, whole, controls, members, problem.step)),
    ]
    return times, tuple(sorted(found, key=lambda one: _worst(one, times))[:CURVES])


def by_parameter(problem: Problem, controls: Floats) -> Profile:
    """Clearances and robustness over the fleet's first parameter; those of the closest `CURVES` obstacles and parts.

    Notes
    -----
    *Guarantee*: exact for the members of a grid, at `SUBSTEPS` times per step; for pictures, no proof.
    """
    fleet = problem.fleet
    members = fleet.grid(affordable(VALUES if len(fleet.names) < 2 else GRID, problem.steps, SUBSTEPS))
    whole, members = all_states(problem, controls, members, SUBSTEPS)
    paths = whole[..., fleet.place_columns]
    turned = headings(problem, controls, members, SUBSTEPS)
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    column = members[:, 0] if fleet.names else np.zeros(len(members))
    # members of one value of the first parameter are one group; a curve is the least over each
    values, groups = np.unique(column, return_inverse=True)

    def least(each: Floats) -> Floats:
        out = np.full(len(values), np.inf)
        np.minimum.at(out, groups.ravel(), each)
        return out

    clearances: dict[str, Floats] = {}
    for avoid in problem.specification.avoid:
        closest = least(avoid.distances(paths, times, turned).min(axis=1, initial=np.inf))
        clearances[avoid.name] = np.minimum(clearances.get(avoid.name, np.inf), closest)
    # rho of each part for every member
    step, fine = problem.step / SUBSTEPS, np.repeat(controls, SUBSTEPS, axis=0)
    signals = StateSignals(with_signals(problem, whole, fine, members, step), columns(problem), step)
    parts = {
        str(part): least(np.asarray(member_robustness(part.formula, signals, ExactOps()))[:, 0])
        for part in problem.specification.parts
    }
    near = _closest(clearances, DRAWN_CLEARANCE)
    far = tuple(name for name in clearances if name not in near)
    return Profile(fleet.names[0] if fleet.names else "", values, near, _closest(parts), far)


def _closest(curves: dict[str, Floats], far: float = np.inf) -> dict[str, Floats]:
    """Those that come closest to failing, of those that are finite and not `far` times as far from it."""
    finite = sorted((float(curve.min()), name) for name, curve in curves.items() if np.isfinite(curve).all())
    # curves up to `far` times the least clearance, or NEAR
    reach = max(NEAR, far * max(finite[0][0], 0.1 * NEAR)) if finite else 0.0
    return {name: curves[name] for least, name in finite[:CURVES] if least <= reach}


def _kept_out(problem: Problem, paths: Floats, times: Floats, turned: Floats | None) -> Iterator[Series]:
    """The closest of all obstacles, if any has to be avoided."""
    kept = problem.specification.avoid
    if not kept:
        return
    # least clearance over all obstacles, per member and instant, each within its own window
    least = np.full(paths.shape[:2], np.inf)
    for avoid in kept:
        when = avoid.during(times)
        least[:, when] = np.minimum(least[:, when], avoid.distances(paths, times, turned))
    least[~np.isfinite(least)] = np.nan
    window = min(d.begin for d in kept), max(d.end for d in kept)
    yield Series("closest obstacle", least.min(axis=0), least.max(axis=0), *window)


def _asked(problem: Problem, whole: Floats) -> Iterator[Series]:
    """The other places and predicates of the task, once each."""
    signals = StateSignals(whole, columns(problem), problem.step)
    seen: set[str] = set()
    for part in problem.specification.parts:
        for leaf in leaves(part.written):
            if str(leaf) in seen:
                continue
            seen.add(str(leaf))
            formula = TaskPart.of(problem, leaf).formula
            value = np.asarray(member_robustness(formula, signals, ExactOps(), 0, signals.steps))
            yield Series(str(leaf), value.min(axis=0), value.max(axis=0), part.begin, part.end)


def _worst(series: Series, times: Floats) -> float:
    """The lowest value in a series' window, for sorting."""
    asked = (times >= series.begin - 1e-9) & (times <= series.end + 1e-9) & np.isfinite(series.low)
    return float(series.low[asked].min(initial=np.inf))
