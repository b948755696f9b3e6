r"""A lower bound on the number of channels: members of which no two can share one.

Under one control, members i and j that start at :math:`s_i, s_j` move alike up to their own factors.

*Robots on arcs*, :math:`p_i(t) = s_i + a_i \int_0^t v e^{i (g_i + b_i W)}` with the turn W of the command:

.. math:: p_j = s_j + r (p_i - s_i) + e, \quad r = a_j / a_i, \quad
          |e| \le |a_j| v \min(2 t, |g_j - g_i| t + |b_j - b_i| w t^2 / 2)

for the top speed v and the top turn rate w, since unit vectors at an angle d differ by at most min(2, |d|).

*Systems with a gain* (`ensemble_ctrl.systems.System.gain`) :math:`k_i`: :math:`p_i = f_i + k_i c(t)` with the free
motion :math:`f_i`, so that :math:`p_j = f_j + (k_j / k_i) (p_i - f_i)` exactly.

Where both have to be in a region R at one time, that is impossible if the image of R under that map is further from R
than the error. Where each has to be there at some time of a window of length L, robots on arcs move at most
:math:`|a_j| v L` between.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import Always, Eventually, Inside, conjuncts
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning.ranges.parts import places
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

CANDIDATES = 400
"""Members looked at, about."""
SLACK = 1e-9
"""Metres, for each metre of a coordinate above one, that a distance has to be larger than the bound."""


@dataclass(frozen=True, eq=False)
class Meeting:
    """A region that every member has to be in: at all times of a window, or at some.

    Attributes
    ----------
    corners : ndarray, shape (corners, 2)
        Of the region, metres.
    normals, offsets : ndarray, shapes (faces, 2) and (faces,)
        Unit rows; the region is where ``normals @ p <= offsets``.
    begin, end : float
        The window, seconds.
    always : bool
        Whether it is at all times.
    """

    corners: Floats
    normals: Floats
    offsets: Floats
    begin: float
    end: float
    always: bool


def apart(problem: Problem) -> tuple[dict[str, float], ...]:
    """Members of which no two can share a control, as many as are found; one at least.

    Notes
    -----
    *Guarantee*: in exact arithmetic no two of them do the task under one control, so that no fewer channels than they
    are are enough, however the fleet is grouped. `SLACK` covers the rounding. There may be more such members.
    """
    members, meetings = _candidates(problem.fleet), list(_meetings(problem))
    chosen = [members[0]]
    for member in members[1:] if meetings else ():
        if all(_incompatible(problem, meetings, one, member) for one in chosen):
            chosen.append(member)
    return tuple(problem.fleet.named(member) for member in chosen)


def _candidates(fleet: Fleet) -> Floats:
    """Members of the fleet: measured rows, else combinations of values of every parameter, in order."""
    wide = [name for name in fleet.names if fleet.parameters[name].upper > fleet.parameters[name].lower]
    ticks = max(1, round(CANDIDATES ** (1 / max(1, len(wide)))) - 1)
    if fleet.samples is None:
        axes = [places(fleet, name, ticks) for name in fleet.names]
        return np.array(list(product(*axes)), dtype=float)
    rows = np.tile(fleet.center, (len(next(iter(fleet.samples.values()))), 1))
    for name, column in fleet.samples.items():
        rows[:, fleet.names.index(name)] = column
    return rows[np.lexsort(rows.T[::-1])]


def _meetings(problem: Problem) -> Iterator[Meeting]:
    """What the task requires of all members without alternatives; nothing where its windows are not fixed."""
    for part in conjuncts(problem.specification.task) if problem.least_duration is None else ():
        if not isinstance(part, Always | Eventually):
            continue
        begin = part.a or 0.0
        end = min(problem.duration, problem.duration if part.b is None else part.b)
        for leaf in conjuncts(part.child):
            # of F (f and g) each of the two alone is necessary
            region = problem.regions.get(leaf.name) if isinstance(leaf, Inside) else None
            if region is not None and _is_flat(region) and begin <= end:
                normals, offsets = _faces(region)
                yield Meeting(region.vertices, normals, offsets, begin, end, isinstance(part, Always))


def _is_flat(region: Polyhedron) -> bool:
    """Whether a region is a polygon in the plane."""
    return region.A.shape[1] == 2 and region.is_bounded and len(region.vertices) > 2


def _faces(region: Polyhedron) -> tuple[Floats, Floats]:
    """Unit normals that point outwards, and offsets, of the faces."""
    normals, offsets = np.concatenate([region.A, -region.A]), np.concatenate([region.upper, -region.lower])
    size = np.linalg.norm(normals, axis=1)
    finite = np.isfinite(offsets)
    return normals[finite] / size[finite, None], offsets[finite] / size[finite]


def _incompatible(problem: Problem, meetings: list[Meeting], one: Floats, other: Floats) -> bool:
    """Whether no control brings both members through all meetings."""
    pairs = [np.stack([one, other]), np.stack([other, one])]
    return any(_misses(problem, meeting, pair) for meeting in meetings for pair in pairs)


def _misses(problem: Problem, meeting: Meeting, pair: Floats) -> bool:
    """Whether the second member can't be in the region when the first one is there."""
    relation = _arcs(problem, meeting, pair) if problem.fleet.system.on_arcs else _gain(problem, meeting, pair)
    if relation is None:
        return False
    factor, start, image, reach = relation
    corners = image + factor * (meeting.corners - start)
    # a face with all corners of the image so far beyond it is a lower bound of the distance
    distance = float((corners @ meeting.normals.T - meeting.offsets).min(axis=0).max())
    return distance > reach + SLACK * max(1.0, float(np.abs(corners).max()))


Relation = tuple[float, Floats, Floats, float]
"""Factor r, places s_i and s_j, and the error in metres of ``p_j = s_j + r (p_i - s_i)``."""


def _arcs(problem: Problem, meeting: Meeting, pair: Floats) -> Relation | None:
    """Of robots on arcs."""
    fleet = problem.fleet
    (a, b, g, *first), (a2, b2, g2, *second) = fleet.coefficients(pair).tolist()
    if a == 0:
        return None
    largest = np.maximum(np.abs(fleet.input_lower), np.abs(fleet.input_upper))
    speed, turn = float(largest[0]), abs(float(fleet.arcs.rates(*largest)[1]))
    t = meeting.begin if meeting.always else meeting.end
    # |e| <= |a_j| v min(2 t, |g_j - g_i| t + |b_j - b_i| w t^2 / 2), and the way between two times of the window
    error = abs(a2) * speed * min(2 * t, abs(g2 - g) * t + abs(b2 - b) * turn * t**2 / 2)
    between = 0.0 if meeting.always else abs(a2) * speed * (meeting.end - meeting.begin)
    return a2 / a, np.array(first), np.array(second), error + between


def _gain(problem: Problem, meeting: Meeting, pair: Floats) -> Relation | None:
    """Of systems with a gain, at one time: no speed is known of them."""
    fleet, k = problem.fleet, round(meeting.begin / problem.step)
    on_grid = abs(k * problem.step - meeting.begin) < 1e-9
    gains = [fleet.system.gain({n: float(v[0]) for n, v in fleet.psi(member[None]).items()}) for member in pair]
    if gains[0] is None or gains[1] is None or not (meeting.always or meeting.begin == meeting.end) or not on_grid:
        return None
    free = fleet.trajectories(np.zeros((problem.steps, len(fleet.system.controls))), pair, problem.step)
    first, second = free[:, k, fleet.place_columns]
    return gains[1] / gains[0], first, second, 0.0
