"""Windows shrunk by a step, so that what holds at the times of a grid holds between them, too."""

from __future__ import annotations

from dataclasses import replace

from ensemble_ctrl.constraints.stl.formula import Always, Eventually, Formula, Release, Until
from ensemble_ctrl.constraints.stl.rewrite import rebuilt


def shrunk(formula: Formula, step: float, repeated: bool = False) -> Formula:
    r"""A formula whose visits under *always* come in windows that begin a step later.

    Parameters
    ----------
    formula : Formula
        In negation normal form.
    step : float
        Of the grid, seconds.
    repeated : bool
        Whether an *always* is around it.

    Returns
    -------
    Formula

    Notes
    -----
    Every time t between two neighbours :math:`t_k, t_{k+1}` of a grid has
    :math:`[t_{k+1} + a, t_k + b] \subseteq [t + a, t + b]`: a visit in that window, required at :math:`t_k`, is one
    for all t. Windows shorter than a step stay as they are.
    """
    inner = repeated or isinstance(formula, Always | Release)
    formula = rebuilt(formula, [shrunk(part, step, inner) for part in formula.parts])
    if not repeated or not isinstance(formula, Eventually | Until) or formula.a is None or formula.b is None:
        return formula
    # [a, b] becomes [a + dt, b] where a step or more of it is left
    return replace(formula, a=formula.a + step) if formula.b - formula.a >= 2 * step else formula


__all__ = ["shrunk"]
