"""How many broadcast channels does a fleet need?  Groups of its members, each with a certified plan of its own."""

from __future__ import annotations

from math import ceil

from ensemble_ctrl.api.planning import judged
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.values import expect, number, whole
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.planning.ranges import Tell, robots
from ensemble_ctrl.planning.ranges.channels import fewest
from ensemble_ctrl.planning.ranges.curve import curve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

MOST = 16
"""Channels allowed unless another number is given."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A group of the fleet with its plan.

    Attributes
    ----------
    plan : Plan
        Certified for every member of the group, and replayed; its problem is that of the group alone.
    """

    plan: Plan

    @property
    def ranges(self) -> dict[str, Interval]:
        """The group's range of each parameter."""
        return _ranges(self.plan.problem.fleet)

    @property
    def robots(self) -> int | None:
        """How many measured robots are in the group; None for a fleet that is a range."""
        return robots(self.plan.problem.fleet)

    @property
    def clearance(self) -> float:
        """What is proven of the group's clearance, metres; infinite without obstacles."""
        certificate = self.plan.certificate
        return float("-inf") if certificate is None else certificate.clearance


@dataclass(frozen=True)
class Point:
    """One point of the curve of clearance against channels.

    Attributes
    ----------
    channels : int
    clearance : float
        Proven of every channel, metres.
    """

    channels: int
    clearance: float


@dataclass(frozen=True, eq=False)
class Channels:
    """The answer.

    Attributes
    ----------
    channels : tuple of Channel
        In the order of the parameters; empty where the fleet could not be covered.
    missed : dict of str to Interval, or None
        Where it could not be covered, a part of the fleet that no plan was found for or that is left over when no more
        channels are allowed.
    apart : tuple of dict of str to float
        Members of which no two can share a control, proven from how far one control can take them
        (`ensemble_ctrl.planning.ranges.bound`); one where nothing is proven.
    tried : int
        Parts of the fleet that a plan was searched for.
    curve : tuple of Point
        Numbers of channels with the largest clearance found for each, where a number of channels is allowed; else only
        those of `channels`. Empty where the fleet could not be covered.
    limited : bool
        Whether it could not be covered because no more channels are allowed.
    """

    channels: tuple[Channel, ...]
    missed: dict[str, Interval] | None
    apart: tuple[dict[str, float], ...]
    tried: int
    curve: tuple[Point, ...] = ()
    limited: bool = False

    @property
    def lower_bound(self) -> int:
        """No fewer channels are enough, however the fleet is grouped."""
        return len(self.apart)

    @property
    def clearance(self) -> float:
        """The least clearance proven of any channel, metres."""
        return min((channel.clearance for channel in self.channels), default=float("-inf"))


def channels(
    problem: Problem,
    at_most: int | None = None,
    *,
    clearance: float = 0.0,
    tolerance: float = 0.01,
    progress: Progress | None = None,
    tell: Tell | None = None,
) -> Channels:
    """Cover a fleet with as few groups as can be found, each with one certified broadcast control.

    Parameters
    ----------
    problem : Problem
        Any system; with one parameter or several, given as ranges or as measured robots.
    at_most : int, optional
        Channels allowed; 16 if not given. With it, the largest clearance is searched for that each number of channels
        up to it keeps: `Channels.curve`.
    clearance : float
        What every channel has to keep of every obstacle beyond the robots' radius, metres.
    tolerance : float
        How finely a range is cut: a share of its length. Measured fleets are cut between any two robots.
    progress : callable, optional
        As for `ensemble_ctrl.plan`.
    tell : callable, optional
        Called with each part of the fleet tried, and whether it was certified.

    Returns
    -------
    Channels

    Raises
    ------
    ProblemError
        For a task of the fleet as a whole, ``mean`` or ``share``: that of a group is another.

    Notes
    -----
    *Guarantee*: every plan is certified for all members of its group, and every member is in a group. No fewer
    than `Channels.lower_bound` channels are enough; between that and the number found, nothing is proven.

    The distribution within a group of a range is uniform; measured robots stay as they are.

    Examples
    --------
    >>> import ensemble_ctrl as ec
    >>> problem = ec.load_text('''
    ... fleet: {model: double_integrator, parameters: {mass: {range: [1.0, 1.7]}}, start: {position: [0, 0]}}
    ... horizon: {duration: 4 s, steps: 16}
    ... regions: {goal: {box: [[1.7, 2.3], [-0.5, 0.5]]}}
    ... task: G[3.5, 4] in(goal)
    ... ''')
    >>> len(ec.channels(problem, tolerance=0.05).channels)
    2
    """
    expect("problem", problem, Problem)
    most = MOST if at_most is None else whole("at_most", at_most, 1)
    ticks = ceil(1 / min(1.0, max(1e-4, number("tolerance", tolerance))))
    found = fewest(problem, most, ticks, max(0.0, number("clearance", clearance)), progress=progress, tell=tell)
    if found.missed is not None:
        return Channels((), _ranges(found.missed), found.apart, found.tried, limited=found.limited)
    first, *more = (found,) if at_most is None else curve(problem, found, most, progress=progress, tell=tell)
    plans = (judged(group.solution, group.shortest, progress=progress) for group in first.groups)
    points = tuple(Point(len(one.groups), one.clearance) for one in (first, *more))
    return Channels(tuple(Channel(plan) for plan in plans), None, found.apart, found.tried, points)


def _ranges(fleet: Fleet) -> dict[str, Interval]:
    """The range of each parameter."""
    return {name: Interval(distribution.lower, distribution.upper) for name, distribution in fleet.parameters.items()}
