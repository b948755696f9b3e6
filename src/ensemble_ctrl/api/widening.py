"""How wide may the fleet be?  The largest range of the parameter around its nominal value with a certified plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ensemble_ctrl.api.planning import judged
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.ranges import Oracle, Scaled, furthest, widened
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict, conflicts
from ensemble_ctrl.problem.fleet import Fleet

Tell = Callable[[Interval, bool], None]
"""Called after each range tried, with whether it was certified."""


@dataclass(frozen=True, eq=False)
class Widest:
    """The answer.

    Attributes
    ----------
    interval : Interval or None
        The widest range certified, None if not even the narrowest tried was.
    plan : Plan or None
        Its certified plan.
    blocked : tuple of Conflict
        What failed in the best attempt at the next wider range tried, worst first.
    beyond : Interval or None
        That wider range; None where the limit of the search was reached.
    tried : int
        Ranges tried.
    """

    interval: Interval | None
    plan: Plan | None
    blocked: tuple[Conflict, ...]
    beyond: Interval | None
    tried: int


def widest(problem: Problem, tolerance: float = 0.01, tell: Tell | None = None, parameter: str | None = None) -> Widest:
    """Search by doubling and bisection for the widest certified range around a nominal parameter.

    Parameters
    ----------
    problem : Problem
        Its own range gives the nominal value, and the first width to try.
    tolerance : float
        The half width is found to within this, in units of the parameter.
    tell : callable, optional
        Called after each range tried.
    parameter : str, optional
        The parameter to widen, the fleet's first if not given; the others keep their ranges.

    Raises
    ------
    ProblemError
        If the fleet has no such parameter.

    Notes
    -----
    *Guarantee*: the plan returned is certified for its whole range. That no wider plan exists is not proven: the
    planner just found none.
    """
    names = expect("problem", problem, Problem).fleet.names
    if not names or parameter not in (None, *names):
        known = ", ".join(names) or "none: all members are equal"
        raise ProblemError(f"parameter: expected one of the fleet's ({known}), got {parameter!r}")
    name = parameter or names[0]
    own = problem.fleet.parameters[name]

    def fleet(half: float) -> Fleet:
        # the uniform distribution on [nominal - half, nominal + half]
        return widened(problem.fleet, {name: half})

    def telling(tried: Fleet, good: bool) -> None:
        if tell is not None:
            tell(_range(tried, name), good)

    search = Scaled(Oracle(problem, tell=telling), fleet)
    limit = furthest(problem.fleet, name)
    search.run(min(max(own.half_width, tolerance), limit), limit, tolerance)
    return _answer(search, name)


def _answer(search: Scaled, name: str) -> Widest:
    """What was found."""
    best, failed = search.best, None if search.failed is None else search.failed[1].solution
    return Widest(
        None if best is None else _range(best.solution.problem.fleet, name),
        None if best is None else judged(best.solution, best.shortest),
        () if failed is None else conflicts(failed.problem, failed.controls),
        None if failed is None else _range(failed.problem.fleet, name),
        search.oracle.tried,
    )


def _range(fleet: Fleet, name: str) -> Interval:
    """The range of a parameter."""
    own = fleet.parameters[name]
    return Interval(own.lower, own.upper)
