"""The paper's receding-horizon loop: measure, solve the published program for what is left, apply some steps.

Nothing is proven of a plan, and none is refused: a robot is stopped only where it is not seen any more.  What the robot
did is for the log and the true track to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import Always, And, Eventually, Formula
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.ocp.published import PublishedTask, published_program
from ensemble_ctrl.ocp.solvers import SolverOptions, solve
from ensemble_ctrl.planning.online.evidence import NOTHING
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.remaining import EVERYWHERE
from ensemble_ctrl.planning.online.step import Work
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint, AvoidThroughout, TaskPart

Floats = NDArray[np.float64]

BARRIER, TOLERANCE = 1e-3, 1e-3
"""Of IPOPT, from the rest of the last plan."""


class PublishedLoop(Receding):
    """The loop without proofs: every plan is the solution of the paper's program from the last measurement.

    Parameters
    ----------
    As for `Receding`, of one robot and with a shrinking horizon.

    Notes
    -----
    *Guarantee*: none.  The fleet's whole range is planned for each time, with all members where the robot was measured.
    The facets are those that the rest of the last plan is furthest behind.

    Raises
    ------
    UnsupportedError
        For several robots or a receding horizon, and for a task that the paper has no equations for.
    """

    def _prepare(self) -> None:
        """Check that the paper has equations for the task; nothing is proven of the first plan."""
        if len(self.robots) > 1 or self.options.horizon != "shrinking":
            raise UnsupportedError("online: the published loop is of one robot, with `horizon: shrinking`")
        PublishedTask.of(self.problem)

    def _decide(self, work: Work) -> None:
        """Re-solve from where the robot will be, or keep the last plan."""
        (tracker,), (robot,) = self.trackers.values(), self.robots.values()
        silent = self.sent * self.problem.step - tracker.time
        pose = robot.pose(self.sent)
        if pose is None or silent > self.options.silence + self.options.deadline:
            self.stop(f"the robot has said nothing for {silent:.1f} s")
            work.ended("stopped", NOTHING)
            return
        found = self._solved(pose, work)
        if found is not None:
            self.plan = np.concatenate([self.plan[: self.sent], found])
        if work.seconds > self.options.deadline:
            self._events.append(f"planning took {work.seconds:.3f} s, longer than {self.options.deadline:g} s")
        work.ended("kept" if found is None else "new", NOTHING)

    def _solved(self, pose: PoseSet, work: Work) -> Floats | None:
        """The commands of the program from a pose on; None if it has no solution."""
        try:
            program = published_program(rest_of(self.problem, self.sent, pose), self.plan[self.sent :])
        except ProblemError as error:
            self._events.append(str(error).splitlines()[0])
            return None
        guess = program.nlp.guess
        nlp = program.fixed([guess[one.binaries] for one in program.facets])
        solve_options = self.problem.solve
        options = SolverOptions(solve_options.max_iterations, 10 * self.options.deadline, TOLERANCE, BARRIER)
        began = self.timer()
        outcome = solve(nlp, options)
        work.solve_seconds, work.iterations = self.timer() - began, outcome.iterations
        work.status = outcome.message
        if outcome.status != "solved":
            self._events.append(f"no solution: {outcome.message}; the last plan is kept")
            return None
        return program.controls(outcome.x)


def rest_of(problem: Problem, begin: int, pose: PoseSet) -> Problem:
    """What is left of a problem from a grid time on, as the paper reads it: windows earlier, the start at a pose.

    Parameters
    ----------
    problem : Problem
        On its whole horizon.
    begin : int
        The grid time.
    pose : PoseSet
        Its middle becomes the start of all members.

    Returns
    -------
    Problem
        A way-point whose window is open counts as not yet visited.
    """
    gone = begin * problem.step
    parts: list[Formula] = []
    written: list[AvoidThroughout | TaskPart] = [*problem.specification.always, *problem.specification.parts]
    for part in written:
        if part.end > gone + 1e-9 * problem.step:
            # the windows of G and F on the later clock
            assert isinstance(part.written, Always | Eventually)
            parts.append(replace(part.written, a=max(part.begin - gone, 0.0), b=part.end - gone))
    task = EVERYWHERE if not parts else parts[0] if len(parts) == 1 else And(tuple(parts))
    fleet = problem.fleet.with_(position=pose.position, heading=pose.heading)
    return problem.with_(fleet=fleet, task=task, duration=problem.duration - gone, steps=problem.steps - begin)


def violations(problem: Problem, track: Floats, fine: int, more: Sequence[AvoidConstraint] = ()) -> dict[str, float]:
    """What a true track did: how long it was where it must not be, and how deep.

    Parameters
    ----------
    problem : Problem
        On its whole horizon.
    track : ndarray, shape (times, 2)
        Places, `fine` for each control step, from time 0 on, metres.
    fine : int
    more : sequence of AvoidConstraint
        What else must be kept out of.

    Returns
    -------
    dict of str to float
        ``seconds`` inside of something to keep out of, and the smallest ``clearance``, metres; negative inside.
    """
    step = problem.step / fine
    times = np.asarray(step * np.arange(len(track)), dtype=np.float64)
    inside, least = np.zeros(len(track), dtype=bool), np.inf
    for avoid in (*problem.specification.avoid, *more):
        when = np.flatnonzero(avoid.during(times))
        if len(when):
            distances = avoid.distances(track[None], times)[0]
            inside[when] |= distances < 0
            least = min(least, float(distances.min()))
    # an interval between two samples counts if both of its ends are inside
    seconds = step * sum(int(a and b) for a, b in pairwise(inside.tolist()))
    return {"seconds": seconds, "clearance": least}
