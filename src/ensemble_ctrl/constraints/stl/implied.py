"""Conjuncts that others imply: windows of one operator and one formula that contain each other are one."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ensemble_ctrl.constraints.stl._text import resolved_time
from ensemble_ctrl.constraints.stl.formula import Always, Eventually, Formula

Window = tuple[float, float]


def without_implied(parts: Iterable[Formula], duration: float) -> tuple[Formula, ...]:
    """The conjuncts that no other conjunct implies, in their order.

    Parameters
    ----------
    parts : iterable of Formula
        What has to hold, all of it.
    duration : float
        Of the plan, seconds: what ``T`` stands for in a window.

    Notes
    -----
    Exact: ``G[0,8] f`` implies ``G[2,5] f``, and ``F[2,5] f`` implies ``F[0,8] f``. A window without numbers is the
    longest that there is.

    Examples
    --------
    >>> from ensemble_ctrl.constraints.stl import parse
    >>> task = parse("G[0,8] x >= 0 and G[2,5] x >= 0 and F[0,8] y >= 0 and F[2,5] y >= 0")
    >>> [str(part) for part in without_implied(task.parts, 8.0)]
    ['G[0,8] x >= 0', 'F[2,5] y >= 0']
    """
    parts = tuple(parts)
    groups: dict[object, list[int]] = {}
    for k, part in enumerate(parts):
        # G[c,d] f implies G[a,b] f for [a,b] in [c,d]; F[a,b] f implies F[c,d] f
        alike = (type(part), part.child) if isinstance(part, Always | Eventually) else part
        groups.setdefault(alike, []).append(k)
    kept: set[int] = set()
    for same in groups.values():
        first = parts[same[0]]
        windows = [_window(parts[k], duration) for k in same]
        kept |= {same[k] for k in (innermost if isinstance(first, Eventually) else outermost)(windows)}
    return tuple(part for k, part in enumerate(parts) if k in kept)


def _window(part: Formula, duration: float) -> Window:
    """The window of an operator; of another formula one for all."""
    if not isinstance(part, Always | Eventually):
        return 0.0, math.inf
    begin, end = (resolved_time(time, duration) for time in (part.a, part.b))
    return (0.0, math.inf) if begin is None or end is None else (begin, end)


def outermost(windows: list[Window]) -> list[int]:
    """Which windows are in no other one; of equal ones the first."""
    found: list[int] = []
    # sweep by begin: a window that ends no later than an earlier one lies in it
    for k in sorted(range(len(windows)), key=lambda k: (windows[k][0], -windows[k][1], k)):
        if not found or windows[k][1] > windows[found[-1]][1]:
            found.append(k)
    return found


def innermost(windows: list[Window]) -> list[int]:
    """Which windows hold no other one; of equal ones the first."""
    found: list[int] = []
    for k in sorted(range(len(windows)), key=lambda k: (-windows[k][0], windows[k][1], k)):
        if not found or windows[k][1] < windows[found[-1]][1]:
            found.append(k)
    return found
