"""Ways to make a problem easier: more time, higher bounds, reversing, another start, a narrower fleet, and so on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil, floor, log10

import numpy as np

from ensemble_ctrl.constraints.stl import Formula
from ensemble_ctrl.constraints.stl.rewrite import rebuilt
from ensemble_ctrl.constraints.stl.robustness import Temporal
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import DISTRIBUTIONS, Distribution
from ensemble_ctrl.planning.planner import Curved
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict
from ensemble_ctrl.problem.fleet import Fleet

GROWTH = (1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0)
"""Factors on the horizon, or on the input bounds."""
SHARES = (0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1)
"""Shares of the parameters' ranges that are kept."""
BACKWARDS = (0.25, 0.5, 1.0)
"""Speeds backwards, as shares of that forwards."""
TURNS = (90.0, -90.0, 180.0)
"""Degrees by which the start is turned, for robots that can't turn on the spot."""
SMALLER = (0.75, 0.5, 0.25, 0.0)
"""Shares of the robots' radius that are kept."""
OBSTACLES = 3
"""Obstacles of which each is left out once."""


@dataclass(frozen=True, eq=False)
class Relaxed:
    """One easier problem.

    Attributes
    ----------
    change : str
        What is different, in words with the figure.
    overrides : tuple of str
        The same as ``KEY=VALUE`` for ``--set``; empty where no override can say it.
    problem : Problem
    """

    change: str
    overrides: tuple[str, ...]
    problem: Problem


@dataclass(frozen=True, eq=False)
class Relaxation:
    """One way to make a problem easier, in several strengths.

    Attributes
    ----------
    name : {"horizon", "input bounds", "range", "reversing", "start heading", "radius", "margin", "obstacle", "terrain"}
    strengths : tuple of float
        From the smallest change to the largest.
    at : callable
        The problem of one strength; raises ProblemError where that is none.
    """

    name: str
    strengths: Sequence[float]
    at: Callable[[float], Relaxed]

    @property
    def curves(self) -> Curved:
        """Whether what gets possible by it may be to drive a curve, and not along a route."""
        ways: dict[str, Curved] = {"horizon": "after", "reversing": "before", "start heading": "before"}
        return ways.get(self.name, "never")


def relaxations(problem: Problem, conflicts: Sequence[Conflict], spread: bool) -> Iterator[Relaxation]:
    """What could be tried, most promising first.

    Parameters
    ----------
    problem : Problem
        For which no plan was found.
    conflicts : sequence of Conflict
        What failed, worst first; of the obstacles among them the first `OBSTACLES` are left out in turn.
    spread : bool
        Whether it is the spread of the fleet that fails, since the robot in its middle does not.
    """
    fleet = problem.fleet
    for name in problem.terrain:
        yield Relaxation("terrain", (0.0,), lambda s, name=name: without_patch(problem, name))  # type: ignore[misc]
    longer = [] if problem.motions else [Relaxation("horizon", GROWTH, lambda f: longer_horizon(problem, f))]
    higher = Relaxation("input bounds", GROWTH, lambda f: wider_bounds(problem, f))
    narrow = [Relaxation("range", SHARES, lambda s: narrower(problem, s))] if any(_narrows(fleet)) else []
    yield from narrow if spread else longer or [higher]
    yield from (longer or [higher]) if spread else narrow
    if fleet.system.on_arcs:
        yield from _driving(problem)
    if fleet.radius > 0:
        yield Relaxation("radius", SMALLER, lambda s: smaller_robots(problem, s))
    if problem.solve.margin > 0:
        yield Relaxation("margin", (0.0,), lambda s: less_margin(problem))
    for name in _in_the_way(problem, conflicts):
        yield Relaxation("obstacle", (0.0,), lambda s, name=name: without(problem, name))  # type: ignore[misc]


def _driving(problem: Problem) -> Iterator[Relaxation]:
    """What helps robots on arcs: driving backwards, and another heading at the start."""
    fleet = problem.fleet
    if fleet.input_lower[0] >= 0 < fleet.input_upper[0]:
        yield Relaxation("reversing", BACKWARDS, lambda s: reversing(problem, s))
    if not (fleet.arcs.turns_in_place and fleet.input_lower[0] <= 0 <= fleet.input_upper[0]):
        for turn in TURNS:
            yield Relaxation("start heading", (turn,), lambda angle: turned(problem, angle))


def longer_horizon(problem: Problem, factor: float) -> Relaxed:
    """More time in as many steps, and the task's windows stretched alike.

    Notes
    -----
    A unicycle or a bicycle drives the same path in more time, with lower commands: nothing gets harder by this.
    """
    duration = round(rounded_up(problem.step * factor) * problem.steps, 9)  # a round step: the windows stay on the grid
    task = stretched(problem.task, duration / problem.duration, duration)
    change = f"a horizon of {duration:g} s in place of {problem.duration:g} s"
    overrides = [f"horizon.duration={duration!r}", f"horizon.steps={problem.steps}"]
    if str(task) != str(problem.task):
        change += f", and with it {task}"
        overrides.append(f"task={task}")
    return Relaxed(change, tuple(overrides), problem.with_(duration=duration, task=task))


def wider_bounds(problem: Problem, factor: float) -> Relaxed:
    """Bounds widened by a factor: of robots on arcs those of speeds and rates of turning, not those of angles."""
    fleet, system = problem.fleet, problem.fleet.system
    rates = np.array([not system.on_arcs or unit.endswith("/s") for unit in system.control_units])
    scale = np.where(rates, factor, 1.0)
    lower, upper = (np.round(bound * scale, 6) for bound in (fleet.input_lower, fleet.input_upper))
    if not system.on_arcs:  # a bound that a larger factor would tighten stays
        lower, upper = np.minimum(lower, fleet.input_lower), np.maximum(upper, fleet.input_upper)
    rows = [
        (name, f"{low:g} to {high:g} {unit}", [float(low), float(high)])
        for name, unit, low, high, rate in zip(system.controls, system.control_units, lower, upper, rates, strict=True)
        if rate
    ]
    change = f"input bounds {factor:g} times as wide: {', '.join(f'{name} {text}' for name, text, _ in rows)}"
    overrides = tuple(f"fleet.input_bounds.{name}={bounds}" for name, _, bounds in rows)
    return Relaxed(change, overrides, problem.with_(fleet=replace(fleet, input_lower=lower, input_upper=upper)))


def reversing(problem: Problem, share: float) -> Relaxed:
    """Driving backwards allowed, at a share of the speed forwards."""
    fleet, system = problem.fleet, problem.fleet.system
    name, unit, high = system.controls[0], system.control_units[0], float(fleet.input_upper[0])
    low = -float(f"{share * high:.4g}")
    change = f"reversing at up to {-low:g} {unit} in place of none"
    lower = np.array([low, fleet.input_lower[1]])
    changed = problem.with_(fleet=replace(fleet, input_lower=lower))
    return Relaxed(change, (f"fleet.input_bounds.{name}={[low, high]}",), changed)


def turned(problem: Problem, angle: float) -> Relaxed:
    """The start turned by some degrees, counter-clockwise."""
    fleet = problem.fleet
    # heading + angle in [-180, 180) degrees
    degrees = float(f"{(np.rad2deg(fleet.heading) + angle + 180) % 360 - 180:.6g}")
    changed = problem.with_(fleet=fleet.with_(heading=float(np.deg2rad(degrees))))
    own = float(f"{np.rad2deg(changed.fleet.own_heading):.6g}")
    change = f"a start heading of {degrees:g} deg in place of {np.rad2deg(fleet.heading):.4g} deg"
    return Relaxed(change, (f"fleet.start.heading={own:g} deg",), changed)


def narrower(problem: Problem, share: float) -> Relaxed:
    """Every range that has ends of its own shrunk towards its middle."""
    fleet = problem.fleet
    distributions = {name: _shrunk(fleet.parameters[name], share) for name in _narrows(fleet)}
    texts = [
        f"{name} {distribution.lower:g} to {distribution.upper:g} in place of {fleet.parameters[name].lower:g} to "
        f"{fleet.parameters[name].upper:g}"
        for name, distribution in distributions.items()
    ]
    overrides = tuple(
        f"fleet.parameters.{name}.range={[distribution.lower, distribution.upper]}"
        for name, distribution in distributions.items()
    )
    changed = replace(fleet, parameters={**fleet.parameters, **distributions})
    return Relaxed(", ".join(texts), overrides, problem.with_(fleet=changed))


def smaller_robots(problem: Problem, share: float) -> Relaxed:
    """A smaller radius."""
    radius = float(f"{problem.fleet.radius * share:.3g}")
    change = f"a radius of {radius:g} m in place of {problem.fleet.radius:g} m"
    smaller = problem.with_(fleet=replace(problem.fleet, radius=radius))
    return Relaxed(change, (f"fleet.radius={radius!r}",), smaller)


def less_margin(problem: Problem) -> Relaxed:
    """Nothing kept to spare."""
    change = f"nothing kept to spare (solve.margin 0 m in place of {problem.solve.margin:g} m)"
    return Relaxed(change, ("solve.margin=0",), problem.with_(solve=replace(problem.solve, margin=0.0)))


def without(problem: Problem, name: str) -> Relaxed:
    """One obstacle less."""
    rest = {key: pieces for key, pieces in problem.obstacles.items() if key != name}
    motions = {key: motion for key, motion in problem.motions.items() if key != name}
    return Relaxed(f"no obstacle {name}", (), problem.with_(obstacles=rest, motions=motions))


def without_patch(problem: Problem, name: str) -> Relaxed:
    """One patch of terrain less."""
    rest = {key: patch for key, patch in problem.terrain.items() if key != name}
    return Relaxed(f"no terrain {name}", (), problem.with_(terrain=rest))


def stretched(formula: Formula, factor: float, duration: float) -> Formula:
    """Every window of a formula longer by a factor, none of them past the horizon."""
    formula = rebuilt(formula, [stretched(part, factor, duration) for part in formula.parts])
    if not isinstance(formula, Temporal):
        return formula

    def later(time: float | None) -> float | None:
        return time if time is None or not np.isfinite(time) else min(round(time * factor, 12), duration)

    return replace(formula, a=later(formula.a), b=later(formula.b))


def rounded_up(value: float) -> float:
    """The next number of two digits: what a person would write.

    Examples
    --------
    >>> rounded_up(17.6), rounded_up(4.4), rounded_up(0.213), rounded_up(20.0)
    (18.0, 4.4, 0.22, 20.0)
    """
    # ceiling at the second significant digit
    digits = 1 - floor(log10(value))
    return round(ceil(round(value * 10.0**digits, 9)) / 10.0**digits, max(digits, 0))


def _narrows(fleet: Fleet) -> Iterator[str]:
    """Parameters whose distribution has a range that can shrink."""
    for name, distribution in fleet.parameters.items():
        if type(distribution) in DISTRIBUTIONS.values() and distribution.lower < distribution.upper:
            yield name


def _shrunk(distribution: Distribution, share: float) -> Distribution:
    """A distribution over the middle of its range."""
    half = distribution.half_width * share
    return distribution.over(float(f"{distribution.center - half:.4g}"), float(f"{distribution.center + half:.4g}"))


def _in_the_way(problem: Problem, conflicts: Sequence[Conflict]) -> list[str]:
    """Obstacles that members enter, worst first."""
    entered = [name for c in conflicts for name in problem.obstacles if c.what == f"avoid({name})"]
    return entered[:OBSTACLES]
