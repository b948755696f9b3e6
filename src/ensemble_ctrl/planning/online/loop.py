"""The loop's one step: from a measurement to the next commands, with a proof or with a reason to stand."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.remaining import SetCertificate
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.ocp.online import InitialCondition, Timer
from ensemble_ctrl.planning.online.evidence import NOTHING, Evidence
from ensemble_ctrl.planning.online.measurement import Measurement, Seen
from ensemble_ctrl.planning.online.obstacles import ChangingMap
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.step import Step, Work
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

WIDEST = 4
"""How often ranges may grow before the robot is stopped for good."""
TIGHTER, TIGHTEST = 1.5, 0.2
"""Times of what a proof lacks that the next plan keeps more, and the most that it keeps, metres."""
PREPARED = 4
"""Times that the first plan is improved before anything moves."""
SHARE = 0.6
"""Share of the deadline for solving; the rest is for proofs."""


class Receding(ChangingMap):
    """Plans for one robot, or several, again and again; `step` takes a measurement and returns the next commands.

    Parameters
    ----------
    problem : Problem
        The ranges of its fleet are what is assumed of each robot's parameters. Each has to do the task, which must not
        speak of a fleet.
    options : OnlineOptions, optional
        Those of the problem's file (`Problem.online`) if not given.
    controls : ndarray, shape (steps, n_u), optional
        A plan to begin with; made here, which takes seconds, if not given.
    timer : callable
        Seconds, for the deadline; that of the processor (`time.process_time`) leaves out what other processes take.
    robots : sequence of str, optional
        Names of the robots that hear the commands, all the same ones; those of the problem's file if not given.
        Measurements of several come by name.

    Attributes
    ----------
    problem : Problem
        Of one robot.
    robots : dict of str to Followed
        Where each robot is and has been.
    stopped : str
        Why the robots stand; empty while it moves.
    elapsed : float
        Seconds since the plan began, for whoever has a clock to set; obstacles are added then.
    alarmed : bool
        Whether something has happened since the last step that the commands given out did not account for; `recall`
        takes back those that can still be stopped.
    history : list of Step
        One for each call of `step`.

    Raises
    ------
    ProblemError
        For a deadline longer than the steps applied of a plan, `controls` of another shape, or names that are no names.

    Notes
    -----
    *Guarantee*: as long as the robots are as assumed (`OnlineOptions.errors`, the ranges, the map), commands are only
    given out when it is proven for every state of each that the measurements allow that nothing is hit until the next
    ones take over, and that standing after that hits nothing that stands. Robots are kept clear of each other where the
    task says so (``G apart(d)``), which is about robots of different starts.
    """

    def __init__(
        self,
        problem: Problem,
        options: OnlineOptions | None = None,
        controls: Floats | None = None,
        timer: Timer = time.perf_counter,
        robots: Sequence[str] | None = None,
    ) -> None:
        self.timer = timer
        settings = expect("problem", problem, Problem).online or OnlineSettings()
        robots = tuple(settings.robots) if robots is None else robots
        super().__init__(problem, settings.options if options is None else options, robots)
        if self.options.lead(problem.step) > self.options.applied_steps:
            most = self.options.applied_steps * problem.step
            raise ProblemError(
                f"online.deadline: expected at most the {most:g} s of {self.options.applied_steps} applied steps, "
                f"got {self.options.deadline:g} s"
            )
        if controls is None:
            controls = solve(problem if problem.fleet.starts else self.problem).controls
        plan = np.array(controls, dtype=float)
        if plan.shape != (problem.steps, 2) or not np.isfinite(plan).all():
            raise ProblemError(f"controls: expected finite numbers of shape ({problem.steps}, 2), got {plan.shape}")
        self.plan: Floats = plan
        self.program = self._program(self.plan)
        self.history: list[Step] = []
        self.stopped, self.alarmed = "", False
        self._evidence, self._final = NOTHING, False
        self._tighter, self._attempts = 0.0, 0
        self._prepare()

    # --- what a user's own loop reads and calls

    @property
    def over(self) -> bool:
        """Whether all commands have been returned."""
        return self.sent >= self.steps

    @property
    def proven(self) -> bool:
        """Whether the rest of the task is proven for the commands that are planned now.

        Never after a time in which something that moves, or came while robots drove, was on the map and nothing was
        proven.
        """
        return self._evidence.proof == "whole" and self.holds and not self._unwatched

    def observe(self, measurement: Seen | None) -> None:
        """Learn from a measurement without planning; what is wrong with it is in the next step's events."""
        for name, seen in self.named(measurement).items():
            self._learn(name, seen)

    def step(self, measurement: Seen | None = None) -> Floats:
        """Take a measurement, plan from there, and return the commands that follow those already returned.

        Parameters
        ----------
        measurement : Measurement, mapping of str to Measurement, or None
            The newest pose, of several robots by name; None if there is none since the last call of `step` or
            `observe`. A robot that is left out keeps its set, which grows as it is carried along.

        Returns
        -------
        ndarray, shape (applied_steps or fewer, n_u)
            Zeros for robots that have to stand; fewer rows at the end of the loop, and none after it.
        """
        work = Work(self.timer)
        self.observe(measurement)
        self.alarmed = False
        if self.over:
            return self.plan[:0]
        self._decide(work)
        self._watch(self._until_standing(work))
        begin, end = self.sent, min(self.sent + self.options.applied_steps, self.steps)
        controls = self.planned(begin, end)
        events, self._events = tuple(dict.fromkeys(self._events)), []
        self.history.append(work.step(begin, end, self._ranges(), self._now()[1], events))
        self._send(controls)
        return controls

    def predicted(self, robot: str | None = None) -> Floats:
        """Where a robot, the only one if not named, goes with its middle parameters, shape (times, 2), metres."""
        at, poses = self._now()
        name = next(iter(self.robots)) if robot is None else robot
        if not poses:
            return np.zeros((0, 2))
        return self._middle(self.robots[name].coefficients(self.program.truncation.nodes, poses[name]), self.plan[at:])

    def late(self, now: int, ahead: int = 0) -> None:
        """Commands come too late for the control steps before `now`.

        Parameters
        ----------
        now : int
            The present control step, after the last whose commands were returned.
        ahead : int
            How many steps of what was planned the robot had been given beyond those; after them it stood.
        """
        held = self.planned(self.sent, min(self.sent + ahead, now))
        stood = np.zeros((now - self.sent - len(held), held.shape[1]))
        self._events.append(f"commands came {(now - self.sent) * self.problem.step:.1f} s late")
        self.plan = self.plan.copy()
        self.plan[max(self.sent + len(held) - self.base, 0) : max(now - self.base, 0)] = 0.0
        self._send(np.concatenate([held, stood]))
        self.alarmed = True
        if len(stood):
            self._evidence = NOTHING
            self._unwatched |= not self._standing_helps

    def planned(self, begin: int, end: int) -> Floats:
        """The commands of control steps as they are planned now; zeros where nothing is planned."""
        rows = self.plan[max(begin - self.base, 0) : max(end - self.base, 0)]
        return np.concatenate([rows, np.zeros((end - begin - len(rows), self.plan.shape[1]))])

    def stop(self, reason: str, for_good: bool = False) -> None:
        """Let the robot stand from the next commands on: for good, or until a step finds a proven way."""
        if not self.stopped:
            self._events.append(f"stopped: {reason}")
        self.stopped = self.stopped or reason
        self._evidence, self._final = NOTHING, self._final or for_good
        self._stand()

    def judged(self) -> float:
        """Robustness of the parts of the task with one, along the past of every robot.

        Returns
        -------
        float
            Metres, a lower bound, from the measurements, and no less than 0 where the task is proven; minus infinity if
            some part is not decided yet, and for a receding horizon's task, which never ends, infinity.
        """
        if self.options.horizon == "receding":
            return math.inf
        for robot in self.robots.values():
            robot.advance(self.problem.steps + 1)
        measured = min(robot.progress.value for robot in self.robots.values())
        return max(measured, 0.0) if self.proven else measured

    @property
    def given_up(self) -> bool:
        """Whether the robot stands and no step will let it drive again."""
        return bool(self.stopped) and (self._final or self._attempts >= self.options.attempts)

    def _learn(self, name: str, measurement: Measurement) -> None:
        """From a measurement of one robot."""
        robot = self.robots[name]
        if self.over and measurement.finite:
            # steps that are past without commands count as standing
            late = math.ceil(measurement.time / self.problem.step - 1e-6) - self.sent
            self._send(np.zeros((min(max(late, 0), len(self.plan)), self.plan.shape[1])))
        events = robot.tracker.observe(measurement)
        self._events += events if len(self.robots) == 1 else [f"{name}: {event}" for event in events]
        if any("ignored" not in event for event in events):
            self._evidence, self.alarmed = NOTHING, True
        if robot.tracker.widened > WIDEST:
            self.stop(f"whatever its parameters, {self._called(name)} is not like the model", for_good=True)
        if self.options.horizon == "shrinking":
            robot.advance(min(robot.tracker.at, self.problem.steps))

    def _prepare(self) -> None:
        """Make the plan good for all starts that measurements may tell, as far as that is possible."""
        errors = self.options.errors
        fleets = {name: robot.tracker.problem.fleet for name, robot in self.robots.items()}
        every = {
            name: PoseSet(fleet.position, np.full(2, errors.position), fleet.heading, errors.heading)
            for name, fleet in fleets.items()
        }
        nodes = self.program.truncation.nodes
        # robots that start alike are no different yet
        start = dict([next(iter(every.items()))]) if len(set(map(id, fleets.values()))) == 1 else every
        certificate = self._certified(self.plan, 0, start)
        for _ in range(PREPARED):
            if certificate.proven:
                break
            self._tighten(certificate)
            self.plan = self.program.solve(
                self._initial(nodes, 0, start, self.plan, 0, self._tighter), rounds=8
            ).controls
            certificate = self._certified(self.plan, 0, start)
        self._tighter = 0.0
        self.program.solve(
            self._initial(nodes, 0, every, self.plan, 0, 0.0), rounds=1
        )  # what is loaded once is loaded now

    def _replaced(self, event: str, harmless: bool) -> None:
        """The map is another: plan on it; where something could be in the way, what is planned is proven anew."""
        self.program = self._program(self.plan)
        self._events.append(event)
        if not harmless:
            found = self._proof(self.plan, Work(self.timer))
            self._evidence = NOTHING if self.stopped else found
            self.alarmed |= self._evidence.proof != "whole"
            if found.proof != "none" and (self._standing_helps or not self.stopped):
                self._watch(found)

    def _until_standing(self, work: Work) -> Evidence:
        """What is proven of the commands that are sent next, or else of those on the way until robots stand."""
        if work.evidence.proof != "none" or not self._standing_helps or self._unproven_since is None:
            return work.evidence
        return self._proof(self.plan, work)

    # --- deciding

    def _decide(self, work: Work) -> None:
        """Whose commands are sent next."""
        for name, tracker in self.trackers.items():
            if tracker.last is None:
                self.stop("there is no measurement" + (f" of {name}" if len(self.robots) > 1 else ""))
            # seconds from the last measurement to the next commands
            silent = self.sent * self.problem.step - tracker.time
            if silent > self.options.silence + self.options.deadline:
                self.stop(f"{self._called(name)} has said nothing for {silent:.1f} s")
        known = bool(self._now()[1])
        if self.seen and not known:
            self.stop("no pose fits what was measured")
        if self._final or not known:
            self._stand()
        elif self.stopped:
            self._recover(work)
        else:
            self._rebase()
            if self.sent - self.base < len(self.plan):
                self._replan(work)
            else:
                self.stop("nothing was measured for a whole horizon")

    def _replan(self, work: Work) -> None:
        """A new plan if something is proven of it, else the last one, else stand."""
        found = self.program.solve(
            self._present(self.plan), SHARE * self.options.deadline, self.options.rounds, self.timer
        )
        work.solve_seconds, work.iterations, work.status = found.seconds, found.iterations, found.status
        evidence = self._proof(found.controls, work)
        self._tighten(evidence.tried)
        if work.seconds > self.options.deadline:
            self._events.append(f"planning took {work.seconds:.3f} s, longer than {self.options.deadline:g} s")
            evidence = NOTHING
        if self._apart and "whole" not in (evidence.proof, self._evidence.proof):
            self._evidence = self._again(work)  # new plans know nothing of distances between robots
        kept = self._evidence.proof == "whole"
        if evidence.proof == "whole" or (evidence.proof == "period" and not kept):
            self.plan, self._evidence = found.controls, evidence
            work.ended("new", evidence)
        elif kept:
            work.ended("kept", self._evidence)
        else:
            self._evidence = self._again(work)
            work.ended("kept", self._evidence)
            if self._evidence.proof == "none":
                tried = self._evidence.tried
                worst = "" if tried is None else f": {tried.worst} by {-tried.least:.3f} m"
                self.stop(f"nothing is proven safe from here{worst}")
                work.source = "stopped"

    def _again(self, work: Work) -> Evidence:
        """A new proof of the last plan; its old one, where that still reaches far enough."""
        old, end = self._evidence, self.sent + self.options.applied_steps + self.options.lead(self.problem.step)
        again = self._proof(self.plan, work)
        return old if again.proof == "none" and end <= old.until else again

    def _recover(self, work: Work) -> None:
        """Look for a way from where the robot stands; it takes over when `recovery` seconds have passed."""
        self._stand()
        # the new plan takes over when it has been made, `recovery` seconds from now
        begin = self.sent + math.ceil(self.options.recovery / self.problem.step)
        fresh = self.sent * self.problem.step - self.time <= self.options.silence + self.options.deadline
        self._rebase()
        beyond = begin >= self.steps or begin - self.base >= len(self.plan)
        if self._attempts >= self.options.attempts or not fresh or beyond:
            return
        self._attempts += 1
        found = self._from_here(begin - self.base, self.plan, work)
        for _ in range(3 if found is not None else 0):
            assert found is not None
            found = self.program.solve(self._present(found, begin - self.base), rounds=6).controls
            evidence = self._proof(found, work, begin - self.base)
            self._tighten(evidence.tried)
            if evidence.proof != "none":
                self.plan, self._evidence, self.stopped = found, evidence, ""
                self._events.append(f"a way was found; the robot moves on at {begin * self.problem.step:.1f} s")
                work.ended("recovered", evidence)
                return
        self._events.append("no proven way was found from where the robot stands")

    def _tighten(self, certificate: SetCertificate | None) -> None:
        """Keep more after a proof that fell short, less after one that did not."""
        if certificate is None or certificate.clearance >= 0:
            self._tighter *= 0.7
        else:
            # more margin for the next plan by TIGHTER times what the proof lacks, up to TIGHTEST
            self._tighter = min(self._tighter - TIGHTER * certificate.clearance, TIGHTEST)

    # --- where things stand; grid times count from the base

    def _present(self, plan: Floats, free: int | None = None) -> InitialCondition:
        """What a solve starts from: `plan` may change from step `free` on, the first unsent one if not given."""
        at, poses = self._now()
        assert poses
        nodes, free = self.program.truncation.nodes, self.sent - self.base if free is None else free
        return self._initial(nodes, at, poses, plan, free, self._tighter)

    def _rebase(self) -> None:
        """With a receding horizon, let the grid begin at the last measurement; what is new at its end is to stand."""
        shift = self._now()[0]
        if self.options.horizon == "receding" and shift > 0:
            self.plan = np.concatenate([self.plan[shift:], np.zeros((min(shift, len(self.plan)), 2))])
            self.base += shift
            # a proof of the last grid is one of a period of this grid if all windows last throughout
            avoided, end = self.problem.specification.avoid, self.problem.duration
            lasting = all(avoid.begin <= 0 and avoid.end >= end for avoid in avoided)
            self._evidence = self._evidence.of_a_period() if lasting else NOTHING

    def _stand(self) -> None:
        """No speed from the next commands on."""
        self.plan = self.plan.copy()
        self.plan[max(self.sent - self.base, 0) :] = 0.0
