"""Units of what a task measures, in words."""

from __future__ import annotations

from collections.abc import Mapping


def unit_of(units: Mapping[str, str], named: set[str]) -> str:
    """What follows a number that is the smallest of distances in some states.

    Parameters
    ----------
    units : mapping of str to str
        The unit of each state that declares one.
    named : set of str
        The states.

    Returns
    -------
    str
        A unit, or words like ``in mixed units (m, m/s)`` and ``in m or the unit of temp``.

    Examples
    --------
    >>> unit_of({"x": "m", "v": "m/s"}, {"x", "v"})
    'in mixed units (m, m/s)'
    """
    known = sorted({units[name] for name in named if name in units})
    others = [f"the unit of {name}" for name in sorted(named) if name not in units]
    if others:
        return f"in {' or '.join([*known, *others])}"
    known = ["without unit" if unit == "1" else unit for unit in known]
    return known[0] if len(known) == 1 else f"in mixed units ({', '.join(known)})"
