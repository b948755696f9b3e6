"""How wide may the fleet be?  The largest range of the parameter around its nominal value with a certified plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ensemble_ctrl.api.planning import judged
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import called, expect
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.planning.ranges import Oracle, Scaled, furthest, widened
from ensemble_ctrl.planning.ranges import Tell as Tried
from ensemble_ctrl.planning.ranges.box import Box, Boxes
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict, conflicts
from ensemble_ctrl.problem.fleet import Fleet

Tell = Callable[[Interval, bool], None]
"""Called after each range tried, with whether it was certified."""
Stop = Callable[[], bool]
"""Whether to end with what is found so far."""


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


def widest(
    problem: Problem,
    tolerance: float = 0.01,
    tell: Tell | None = None,
    parameter: str | None = None,
    *,
    stop: Stop = lambda: False,
) -> Widest:
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
    stop : callable
        Called during the search; once it returns True, the answer is what is found so far.

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

    search = Scaled(Oracle(problem, _stopping(stop), telling), fleet)
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


@dataclass(frozen=True, eq=False)
class WidestBox:
    """The largest certified box of two parameters.

    Attributes
    ----------
    ranges : dict of str to Interval
        Of the two parameters; empty if not even one of them has a range with a plan.
    plan : Plan or None
        Its certified plan.
    curve : tuple of dict of str to float
        Half widths of every certified box that no other one contains, from one parameter alone to the other.
    tried : int
        Boxes tried.
    """

    ranges: dict[str, Interval]
    plan: Plan | None
    curve: tuple[dict[str, float], ...]
    tried: int


def widest_box(
    problem: Problem, parameters: Sequence[str] | None = None, *, tell: Tried | None = None, stop: Stop = lambda: False
) -> WidestBox:
    """Search for the certified box of two parameters with the largest area, around their nominal values.

    Parameters
    ----------
    problem : Problem
        Its own ranges give the nominal values, and the first widths to try.
    parameters : sequence of str, optional
        The two; the fleet's first two if not given. The others keep their ranges.
    tell : callable, optional
        Called with each fleet tried, and whether it was certified.
    stop : callable
        Called during the search; once it returns True, the answer is the largest box found so far.

    Raises
    ------
    ProblemError
        If the fleet has no two such parameters.

    Notes
    -----
    *Guarantee*: the plan is certified for the whole box, and each box of the curve has such a plan. That no larger box
    has one is not proven.
    """
    names = expect("problem", problem, Problem).fleet.names
    chosen = names[:2] if parameters is None else tuple(parameters)
    if len(set(chosen)) != 2 or not set(chosen) <= set(names):
        known = ", ".join(names) or "none: all members are equal"
        raise ProblemError(f"parameters: expected two of the fleet's ({known}), got {', '.join(chosen) or 'none'}")
    search = Boxes(Oracle(problem, _stopping(stop), tell), (chosen[0], chosen[1])).run()
    best = search.largest
    curve = tuple(
        dict(zip(chosen, box.halves, strict=True)) for box in search.boxes if _is_outermost(box, search.boxes)
    )
    if best is None:
        return WidestBox({}, None, curve, search.oracle.tried)
    ranges = {name: _range(best.found.solution.problem.fleet, name) for name in chosen}
    return WidestBox(ranges, judged(best.found.solution, best.found.shortest), curve, search.oracle.tried)


def _stopping(stop: Stop) -> Progress:
    """The planner's progress that only asks whether to stop."""
    called("stop", stop)
    return lambda phase, iteration: bool(stop())


def _is_outermost(box: Box, boxes: list[Box]) -> bool:
    """Whether no other box contains this one."""
    (a, b), others = box.halves, [other.halves for other in boxes if other is not box]
    return not any(first >= a and second >= b for first, second in others)
