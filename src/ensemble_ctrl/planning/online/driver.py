"""The loop on a robot and a clock, until the end, a fault that can't be mended, or a wish to stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.robot import Clock, Robot
from ensemble_ctrl.planning.online.step import Source, Step
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


class Past(Protocol):
    """What is known of a robot."""

    @property
    def last(self) -> Any:
        """Its newest measurement."""

    @property
    def past(self) -> Sequence[Any]:
        """Its sets at the grid times, each with the middle of its places."""


class Loop(Protocol):
    """A loop of any kind of system, as a driver and a log see it."""

    problem: Problem
    options: OnlineOptions
    history: list[Step]
    base: int
    elapsed: float
    alarmed: bool
    stopped: str

    @property
    def trackers(self) -> Mapping[str, Past]:
        """The past of each robot, by name."""

    @property
    def steps(self) -> int:
        """Control steps of the whole loop."""

    @property
    def sent(self) -> int:
        """Control steps whose commands have been returned."""

    @property
    def time(self) -> float:
        """Up to which every robot has been measured, seconds."""

    @property
    def seen(self) -> bool:
        """Whether every robot has been measured."""

    @property
    def over(self) -> bool:
        """Whether all commands have been returned."""

    @property
    def holds(self) -> bool:
        """Whether nothing has contradicted what is assumed."""

    @property
    def proven(self) -> bool:
        """Whether the rest of the task is proven."""

    @property
    def given_up(self) -> bool:
        """Whether no step will let anything move again."""

    def named(self, measurement: Any) -> Mapping[str, Any]:
        """Measurements by the names of their robots."""

    def label(self, name: str, parameter: str) -> str:
        """What a step calls a parameter of a robot."""

    def observe(self, measurement: Any) -> None:
        """Learn from a measurement without planning."""

    def step(self, measurement: Any = None) -> Floats:
        """Plan, and return the next commands."""

    def planned(self, begin: int, end: int) -> Floats:
        """The commands of control steps as they are planned now."""

    def recall(self, begin: int) -> None:
        """Take commands back."""

    def late(self, now: int, ahead: int = 0) -> None:
        """Commands come too late."""

    def stop(self, reason: str, for_good: bool = False) -> None:
        """Give out no more commands."""

    def judged(self) -> float:
        """Robustness along the past."""

    def entered(self) -> str:
        """Which robot must have been where it must not be."""

    def predicted(self, robot: str | None = None) -> Floats:
        """Where a robot goes."""


Ending = Literal["success", "finished", "failed", "stopped", "interrupted"]
Listener = Callable[[Step, Floats], None]
"""Called after each step with what it did and its commands."""
Scene = Callable[[float], None]
"""Called with the seconds since the plan began."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a run of the loop ended.

    Attributes
    ----------
    ending : {"success", "finished", "failed", "stopped", "interrupted"}
        ``success``: the task is done, proven, and nothing contradicted the assumptions. ``finished``: it is done, as
        far as the measurements tell, but not proven to the end or after something had contradicted the assumptions.
        ``failed``: neither they nor a proof show that it is done, or a robot was where it must not be. ``stopped``: the
        robot stands, for `reason`. ``interrupted``: someone wanted to stop.
    reason : str
        In words.
    robustness : float
        Of the task but for what must be kept out of, metres: a lower bound by the measurements, and 0 where that is
        less but the task is proven.
    paths : dict of str to ndarray of shape (times, 2)
        Of each robot, middles of the sets of places at the grid times, metres.
    steps : tuple of Step
        What the loop did.
    start : float
        When the plan began, on the clock.
    """

    ending: Ending
    reason: str
    robustness: float
    paths: dict[str, Floats]
    steps: tuple[Step, ...]
    start: float = 0.0

    @property
    def sources(self) -> dict[str, int]:
        """How many steps each source of commands had."""
        return {name: sum(step.source == name for step in self.steps) for name in get_args(Source)}

    @property
    def seconds(self) -> Floats:
        """Time of every step that planned, shape (plans,)."""
        return np.array([step.seconds for step in self.steps if step.iterations])


def drive(
    loop: Loop,
    robot: Robot,
    clock: Clock,
    *,
    wanted: Callable[[], bool] = lambda: False,
    listener: Listener | None = None,
    scene: Scene | None = None,
) -> Outcome:
    """Run the loop until its end.

    Parameters
    ----------
    loop : Loop
        New.
    robot : Robot
        One, or all robots of the loop, which hear the same commands; what is measured of several comes by name.
    clock : Clock
        Of the measurements and the commands; a simulated robot is its own.
    wanted : callable
        Whether someone wants to stop; asked in every control step.
    listener : callable, optional
        Told of every step, before its commands are sent.
    scene : callable, optional
        Called in every control step from the start of the plan on with the seconds since then, before the robot is
        measured: for whoever sees obstacles come, move and go (`Receding.add_obstacle`).

    Returns
    -------
    Outcome

    Notes
    -----
    The plan begins a little after the robot, which stands, has been measured first. Commands are sent one block ahead,
    with the next few steps of the plan behind it, and again in every control step, so that a lost message does no
    harm. The robot is told to stop on every way out of here, exceptions included.
    """
    try:
        start = _first_look(loop, robot, clock)
        if start is None:
            loop.stop("there is no measurement")
            return Outcome("stopped", loop.stopped, -np.inf, {}, ())
        return _Drive(loop, robot, clock, start, wanted, listener, scene).run()
    finally:
        robot.stop()


def _first_look(loop: Loop, robot: Robot, clock: Clock) -> float | None:
    """Wait for the first measurement; returns when the plan begins."""
    step, began = loop.problem.step, clock.now()
    while clock.now() - began <= loop.options.silence:
        loop.observe({name: replace(seen, time=0.0) for name, seen in loop.named(robot.read()).items()})
        if loop.seen:
            return (math.ceil(clock.now() / step - 1e-6) + loop.options.lead(step)) * step
        clock.wait(clock.now() + step)
    return None


class _Drive:
    """One run; its time 0 is `start` on the clock."""

    def __init__(
        self,
        loop: Loop,
        robot: Robot,
        clock: Clock,
        start: float,
        wanted: Callable[[], bool],
        listener: Listener | None,
        scene: Scene | None,
    ) -> None:
        self.loop, self.robot, self.clock, self.start = loop, robot, clock, start
        self.wanted, self.listener, self.scene = wanted, listener, scene
        self.block: tuple[float, Floats] | None = None

    def run(self) -> Outcome:
        """Until the end of the loop, or until it has to end."""
        loop, step = self.loop, self.loop.problem.step
        lead = loop.options.lead(step)
        tick = -lead
        while tick < loop.steps:
            self.clock.wait(self.start + tick * step)
            tick = max(tick, math.floor((self.clock.now() - self.start) / step + 1e-6))
            loop.elapsed = max(tick * step, 0.0)
            if loop.sent and tick > loop.sent and not loop.over:
                loop.late(min(tick, loop.steps), lead)
            if self.wanted():
                return self._ended("interrupted", "someone wanted to stop")
            if self.scene is not None and tick >= 0:
                self.scene(loop.elapsed)
            self._look()
            if loop.alarmed:
                self._take_back(tick, lead)
            if not loop.over and (loop.sent == 0 or tick >= loop.sent - lead):
                self._plan(lead)
            if self.block is not None:
                self.robot.send(*self.block)
            if loop.given_up:
                return self._ended("stopped", loop.stopped)
            tick += 1
        self._last_looks()
        return self._judged()

    def _take_back(self, tick: int, lead: int) -> None:
        """Take back what can still be stopped: if the robots have to stand, all but the present step."""
        loop = self.loop
        loop.recall(max(tick + (1 if loop.stopped else lead), 0))
        if loop.stopped and not loop.over:
            begin = self.start + loop.sent * loop.problem.step
            self.robot.send(begin, loop.planned(loop.sent, loop.sent + lead))

    def _look(self) -> None:
        """Take a measurement, on the loop's own time."""
        for name, seen in self.loop.named(self.robot.read()).items():
            if not seen.time <= self.start + 1e-9:  # until then it stood, as it was seen first
                self.loop.observe({name: replace(seen, time=seen.time - self.start)})

    def _plan(self, lead: int) -> None:
        """The next commands, with a few more behind them."""
        loop = self.loop
        begin = loop.sent
        controls = loop.step()
        more = loop.planned(loop.sent, min(loop.sent + lead, max(loop.steps, loop.sent)))
        self.block = self.start + begin * loop.problem.step, np.concatenate([controls, more])
        if self.listener is not None:
            self.listener(loop.history[-1], controls)

    def _last_looks(self) -> None:
        """Measurements of the end take a while to arrive."""
        loop, step = self.loop, self.loop.problem.step
        end = loop.steps * step
        for extra in range(round(loop.options.silence / step) + 1):
            self.clock.wait(self.start + end + extra * step)
            self._look()
            if loop.time >= end - 1e-6:
                return

    def _judged(self) -> Outcome:
        """What the measurements say at the end."""
        loop = self.loop
        if loop.stopped:
            return self._ended("stopped", loop.stopped)
        robustness, entered = loop.judged(), loop.entered()
        if entered:
            return self._ended("failed", entered, robustness)
        if robustness < 0:
            return self._ended("failed", "the measurements do not show that the task was done", robustness)
        if not loop.holds:
            return self._ended("finished", "done, but the robot was not as assumed", robustness)
        if not loop.proven:
            return self._ended("finished", "done, but not proven to the end", robustness)
        return self._ended("success", "done, and proven", robustness)

    def _ended(self, ending: Ending, reason: str, robustness: float = -np.inf) -> Outcome:
        """The outcome with what the loop knows."""
        paths = {
            name: np.array([known.position for known in tracker.past]).reshape(-1, len(self.loop.problem.fleet.places))
            for name, tracker in self.loop.trackers.items()
        }
        return Outcome(ending, reason, robustness, paths, tuple(self.loop.history), self.start)
