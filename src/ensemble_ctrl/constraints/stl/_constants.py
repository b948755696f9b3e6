"""What ``true`` and ``false`` make of a formula around them: nothing of them is left but where all is constant."""

from __future__ import annotations

import math

from ensemble_ctrl.constraints.stl.formula import Always, And, Eventually, Formula, Mean, Not, Or, Share, Until
from ensemble_ctrl.constraints.stl.leaves import Known


def simplified(formula: Formula) -> Formula:
    """The formula without constants among its parts, with the same robustness.

    Parameters
    ----------
    formula : Formula
        Its parts are simplified already; ``true`` is a robustness of infinity, ``false`` one of minus infinity.
    """
    if not any(isinstance(part, Known) for part in formula.parts):
        return formula
    match formula:
        case Not(child=Known(value=value)):
            return Known(-value)
        case And():
            return _joined(And, formula.parts, -math.inf)
        case Or():
            return _joined(Or, formula.parts, math.inf)
        case Eventually(child=child) | Always(child=child) | Mean(child=child) | Share(child=child):
            return child
        case Until():
            return _until(formula)
    raise AssertionError(formula)


def _joined(kind: type[And] | type[Or], parts: tuple[Formula, ...], deciding: float) -> Formula:
    """A conjunction or disjunction, which one constant decides and on which the other has no influence."""
    if any(isinstance(part, Known) and part.value == deciding for part in parts):
        return Known(deciding)
    kept = tuple(part for part in parts if not isinstance(part, Known))
    if not kept:
        return Known(-deciding)
    return kept[0] if len(kept) == 1 else kind(kept)


def _until(formula: Until) -> Formula:
    """``true U g`` is ``F g``; ``f U[a,b] true`` has to keep f up to a only."""
    left, right, a, b, column = formula.left, formula.right, formula.a, formula.b, formula.column
    if Known(-math.inf) in (left, right):
        return Known(-math.inf)
    if isinstance(left, Known):
        return right if isinstance(right, Known) else Eventually(right, a, b, column)
    return Always(left, 0.0, a, column) if a else left
