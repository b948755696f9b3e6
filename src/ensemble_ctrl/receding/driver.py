"""The loop on a robot and a clock, until the end, a fault that can't be mended, or a wish to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.receding.loop import Receding, Step
from ensemble_ctrl.receding.robot import Clock, Robot

Floats = NDArray[np.float64]
Ending = Literal["success", "finished", "failed", "stopped", "interrupted"]
Listener = Callable[[Step, Floats], None]
"""Called after each step with what it did and its commands."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a run of the loop ended.

    Attributes
    ----------
    ending : {"success", "finished", "failed", "stopped", "interrupted"}
        ``success``: the task is done, proven, and nothing contradicted the assumptions. ``finished``: it is done, as
        far as the measurements tell, but not proven to the end or after something had contradicted the assumptions.
        ``failed``: it is not. ``stopped``: the robot stands, for `reason`. ``interrupted``: someone wanted to stop.
    reason : str
        In words.
    robustness : float
        Of the task but for what must be kept out of, metres, from the measurements and no less than their errors.
    path : ndarray, shape (times, 2)
        Middles of the sets of places at the grid times, metres.
    steps : tuple of Step
        What the loop did.
    """

    ending: Ending
    reason: str
    robustness: float
    path: Floats
    steps: tuple[Step, ...]

    @property
    def seconds(self) -> Floats:
        """Time of every step that planned, shape (plans,)."""
        return np.array([step.seconds for step in self.steps if step.iterations])


def drive(
    loop: Receding,
    robot: Robot,
    clock: Clock,
    *,
    wanted: Callable[[], bool] = lambda: False,
    listener: Listener | None = None,
) -> Outcome:
    """Run the loop until its end.

    Parameters
    ----------
    loop : Receding
        New, or with some steps done.
    robot : Robot
    clock : Clock
        At 0 when the plan begins; a simulated robot is its own.
    wanted : callable
        Whether someone wants to stop; asked in every control step.
    listener : callable, optional
        Told of every step, before its commands are sent.

    Returns
    -------
    Outcome

    Notes
    -----
    The robot is told to stop on every way out of here, exceptions included. Commands are sent one block ahead, with
    the next few steps of the plan behind it, and again in every control step, so that a lost message does no harm.
    """
    step = loop.problem.step
    lead = loop.options.lead(step)
    block: tuple[float, Floats] | None = None
    try:
        tick = round(clock.now() / step)
        while tick < loop.steps:
            if wanted():
                return _outcome(loop, "interrupted", "someone wanted to stop")
            loop.observe(robot.read())
            if not loop.over and (loop.sent == 0 or tick >= loop.sent - lead):
                begin = loop.sent
                controls = loop.step()
                block = begin * step, np.concatenate([controls, loop.planned(loop.sent, loop.sent + lead)])
                if listener is not None:
                    listener(loop.history[-1], controls)
            if block is not None:
                robot.send(*block)
            if loop.stopped and loop.given_up:
                return _outcome(loop, "stopped", loop.stopped)
            tick += 1
            clock.wait(tick * step)
        _last_looks(loop, robot, clock)
        return _judged(loop)
    finally:
        robot.stop()


def _last_looks(loop: Receding, robot: Robot, clock: Clock) -> None:
    """Measurements of the end take a while to arrive."""
    step = loop.problem.step
    end = loop.steps * step
    for extra in range(1, round(loop.options.silence / step) + 1):
        loop.observe(robot.read())
        if loop.tracker.time >= end - 1e-6:
            return
        clock.wait(end + extra * step)


def _judged(loop: Receding) -> Outcome:
    """What the measurements say at the end."""
    if loop.stopped:
        return _outcome(loop, "stopped", loop.stopped)
    robustness, entered = loop.judged(), loop.entered()
    if entered:
        return _outcome(loop, "failed", f"the robot was in {entered}", robustness)
    if robustness < 0:
        return _outcome(loop, "failed", "the measurements do not show that the task was done", robustness)
    if not loop.tracker.holds:
        return _outcome(loop, "finished", "done, but the robot was not as assumed", robustness)
    if not loop.proven:
        return _outcome(loop, "finished", "done, but not proven to the end", robustness)
    return _outcome(loop, "success", "done, and proven", robustness)


def _outcome(loop: Receding, ending: Ending, reason: str, robustness: float = -np.inf) -> Outcome:
    """The outcome with what the loop knows."""
    path = np.array(loop.tracker.path).reshape(-1, 2)
    return Outcome(ending, reason, robustness, path, tuple(loop.history))
