"""The heading in which a plan has to end, for guesses that can arrive in a heading."""

from __future__ import annotations

import math

from ensemble_ctrl.constraints.stl import Always, Eventually, Formula, Predicate, Within, conjuncts
from ensemble_ctrl.problem import Problem

HEADING = "heading"
LATE = 0.8
"""Share of the horizon after which a window is about the end."""


def final_heading(problem: Problem) -> float | None:
    """Radians from +x in the middle of what the task wants late in the plan; None where it wants no heading then."""
    low, high = -math.inf, math.inf
    for part in problem.specification.parts:
        formula = part.resolved
        if not isinstance(formula, Always | Eventually) or part.end < LATE * problem.duration:
            continue
        for leaf in conjuncts(formula.child):
            if isinstance(leaf, Within) and leaf.state == HEADING:
                return leaf.centre
            bounds = _bounds(leaf)
            low, high = max(low, bounds[0]), min(high, bounds[1])
    return (low + high) / 2 if math.isfinite(low) and math.isfinite(high) else None


def _bounds(leaf: Formula) -> tuple[float, float]:
    """The headings that an inequality about the heading alone leaves."""
    if not isinstance(leaf, Predicate) or [name for name, _ in leaf.coefficients] != [HEADING]:
        return -math.inf, math.inf
    ((_, value),) = leaf.coefficients
    bound = -leaf.offset / value
    return (bound, math.inf) if value > 0 else (-math.inf, bound)
