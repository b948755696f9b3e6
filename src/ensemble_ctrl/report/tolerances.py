"""What a plan tolerates of each kind of error, as bars of a page that wrap on a narrow screen."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ensemble_ctrl.planning.tolerance import Tolerance, Tolerated

MEASURED = "tolerances"
"""The entry of a plan's details that holds its measured tolerances."""


def tolerance_bars(found: Tolerance) -> str:
    """A bar for each kind of error alone, and for the scaled mix, as HTML.

    Parameters
    ----------
    found : Tolerance
        As `ensemble_ctrl.planning.tolerance.measure` returns it.

    Notes
    -----
    Kinds with one unit have one scale, from zero to the largest bound among them, or to what an attack needs.
    *Guarantee*: every text that comes from the problem is escaped.
    """
    kinds = "".join(_bar(one, _top([other for other in found.kinds if other.unit == one.unit])) for one in found.kinds)
    # a mix is a multiple, whose scale reaches the errors of the problem, or the bounds of each kind alone
    mix = _bar(found.mix, max(1.0, _top([found.mix])))
    note = "The largest error of each kind alone, and of all together, with which the plan stays proven. "
    note += "Bars with the same unit have the same scale."
    if any(one.broken is not None for one in (*found.kinds, found.mix)):
        note += " Red: neither proven nor broken, up to the smallest error with which an attack broke the plan."
    return f'<ul class="bars">{kinds}{mix}</ul><p class="note">{note}</p>'


def ending(one: Tolerated) -> str:
    """What can't be proven beyond a bound, when and for whom."""
    if one.beyond is None:
        return "and more than that makes no sense"
    when = "" if one.time is None else f" at t = {one.time:.2f} s"
    who = ", ".join(f"{name} {value:.4g}" for name, value in one.parameters.items())
    broken = "" if one.broken is None else f"; broken by an attack with {one.amount(one.broken)}"
    return f"then {one.ends}{when}{f' ({who})' if who else ''}{broken}"


def _top(kinds: Sequence[Tolerated]) -> float:
    """The end of a scale."""
    return max(max(one.bound, one.broken or 0.0) for one in kinds)


def _bar(one: Tolerated, top: float) -> str:
    """One entry: the kind, its bound, its bar and where it ends."""

    def share(value: float) -> str:
        return f"{100 * value / top if top > 0 else 0.0:.1f}%"

    paler = "" if one.broken is None else f'<i class="tried" style="width:{share(one.broken)}"></i>'
    bar = f'<div class="bar">{paler}<i style="width:{share(one.bound)}"></i></div>'
    head = f"<span>{escape(one.kind)}</span><b>{escape(one.amount(one.bound))}</b>"
    return f"<li>{head}{bar}<small>{escape(ending(one))}</small></li>"
