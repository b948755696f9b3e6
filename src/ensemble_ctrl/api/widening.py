"""How wide may the fleet be?  The largest range of the parameter around its nominal value with a certified plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict

Tell = Callable[[Interval, bool], None]
"""Called after each range tried, with whether it was certified."""

GROWTH = 1.5
"""Factor by which the range grows until it is too wide."""
NARROWEST = 0.05
"""Smallest factor considered, as a share of the nominal one."""
FURTHEST = 3.0
"""Largest offset of a start considered, metres or radians."""


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
    search = _Search(problem, tell, parameter or names[0])
    distribution = search.distribution_of(problem)
    limit = distribution.center * (1 - NARROWEST) if search.name in problem.fleet.system.parameters else FURTHEST
    # half widths: certified up to `good`, refused at `bad`
    good, bad = 0.0, limit
    half = min(max(distribution.half_width, tolerance), limit)
    # bracket: halved until one is certified, or grown by GROWTH until one is not
    if not search.certified(half):
        bad, half = half, half / 2
        while half > tolerance / 2 and not search.certified(half):
            bad, half = half, half / 2
        good = half if search.best is not None else 0.0
    else:
        good = half
        while good < limit and search.certified(min(good * GROWTH, limit)):
            good = min(good * GROWTH, limit)
        bad = min(good * GROWTH, limit)
    # bisection to the tolerance
    while search.best is not None and bad - good > tolerance and good < limit:
        middle = (good + bad) / 2
        good, bad = (middle, bad) if search.certified(middle) else (good, middle)
    return search.answer()


@dataclass(eq=False)
class _Search:
    """The ranges tried so far: the best plan, and the narrowest failure."""

    problem: Problem
    tell: Tell | None
    name: str
    best: Plan | None = None
    failed: Plan | None = None
    tried: int = 0

    def distribution_of(self, problem: Problem) -> Interval:
        """The range of the parameter that is widened."""
        distribution = problem.fleet.parameters[self.name]
        return Interval(distribution.lower, distribution.upper)

    def certified(self, half: float) -> bool:
        """Whether a certified plan is found for the nominal value give or take `half`."""
        # the uniform distribution on [nominal - half, nominal + half]
        nominal, fleet = self.distribution_of(self.problem).center, self.problem.fleet
        distribution = Interval(nominal - half, nominal + half)
        try:
            problem = self.problem.with_(
                fleet=replace(fleet, parameters={**fleet.parameters, self.name: distribution}),
                verify=replace(self.problem.verify, certificate=True, members=1000),
            )
        except ProblemError:  # so wide that the checks refuse it: there is certainly no plan
            self.tried += 1
            if self.tell:
                self.tell(distribution, False)
            return False
        found = self._plan(problem)
        good = found.certificate is not None and found.certificate.proven == "yes"
        self.tried += 1
        if good:
            self.best = found
        elif self.failed is None or half < self.distribution_of(self.failed.problem).half_width:
            self.failed = found
        if self.tell:
            self.tell(distribution, good)
        return good

    def _plan(self, problem: Problem) -> Plan:
        """From the last good plan; where that fails, from routes."""
        if self.best is not None:
            found = plan(problem, guess=self.best, check=False)
            if found.certificate is not None and found.certificate.proven == "yes":
                return found
        return plan(problem, check=False)

    def answer(self) -> Widest:
        """What was found."""
        return Widest(
            self.distribution_of(self.best.problem) if self.best else None,
            self.best,
            self.failed.conflicts() if self.failed else (),
            self.distribution_of(self.failed.problem) if self.failed else None,
            self.tried,
        )
