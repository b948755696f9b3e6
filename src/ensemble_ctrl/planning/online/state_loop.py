"""The loop for a system that an ODE defines and all of whose states are measured."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.remaining import certify_box
from ensemble_ctrl.certificate.remaining import SetCertificate
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.online import Timer
from ensemble_ctrl.planning.online.evidence import NOTHING, Evidence
from ensemble_ctrl.planning.online.measurement import StateMeasurement, StateSeen
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.remaining import left_over, of_one_robot, with_ranges
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.state_sets import Box
from ensemble_ctrl.planning.online.state_tracker import StateSet, StateTracker
from ensemble_ctrl.planning.online.step import Step, Work
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.planning.planner.states import improve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

TIGHTER, TIGHTEST = 1.5, 0.2
"""Times of what a proof lacks that the next plan keeps more, and the most that it keeps."""
PREPARED = 3
"""Times that the first plan is improved before anything moves."""
SHARE = 0.6
"""Share of the deadline for solving; the rest is for the proof."""


class StateLoop:
    """Plans for one robot again and again; `step` takes a measurement and returns the next commands.

    Parameters
    ----------
    problem : Problem
        The ranges of its fleet are what is assumed of the robot's parameters.
    options : OnlineOptions, optional
        Those of the problem's file (`Problem.online`) if not given.
    controls : ndarray, shape (steps, n_u), optional
        A plan to begin with; made here, which takes seconds, if not given.
    timer : callable
        Seconds, for the deadline.
    robots : sequence of str, optional
        The robot's name; that of the problem's file if not given.

    Attributes
    ----------
    problem : Problem
        Of one robot.
    stopped : str
        Why nothing was begun, or is sent any more; empty while the robot moves.
    alarmed : bool
        Whether something has happened since the last step that the commands given out did not account for.
    history : list of Step
        One for each call of `step`.

    Notes
    -----
    *Guarantee*: as long as the system is the model, errors and parameters are within what is assumed, and no
    measurement contradicted that, every command that is given out belongs to a plan that is proven, for every state and
    parameter that the measurements allow, to do all that is left of the task. Such a system can't stand still at once,
    so that a new plan replaces the last only with such a proof; else the last one goes on, whose proof stands.
    """

    def __init__(
        self,
        problem: Problem,
        options: OnlineOptions | None = None,
        controls: Floats | None = None,
        timer: Timer = time.perf_counter,
        robots: Sequence[str] | None = None,
    ) -> None:
        settings = problem.online or OnlineSettings()
        names = tuple(settings.robots) if robots is None else tuple(robots)
        if len(names) != 1:
            raise ProblemError(f"robots: expected one for a system defined by an ODE, got {list(names)}")
        self.problem, self.timer = of_one_robot(problem), timer
        self.options = settings.options if options is None else options
        if self.options.lead(self.problem.step) > self.options.applied_steps:
            most = self.options.applied_steps * self.problem.step
            raise ProblemError(f"online.deadline: expected at most the {most:g} s of the applied steps")
        plan = solve(self.problem).controls if controls is None else np.array(controls, dtype=float)
        if plan.shape != (problem.steps, len(problem.fleet.system.controls)) or not np.isfinite(plan).all():
            raise ProblemError(f"controls: expected finite numbers for {problem.steps} steps, got {plan.shape}")
        self.plan: Floats = plan
        self.name, self.base, self.elapsed = names[0], 0, 0.0
        self.tracker = StateTracker(self.problem, self.options.errors_of(self.problem), self.options.learn)
        self.history: list[Step] = []
        self.stopped, self.alarmed = "", False
        self._evidence, self._tighter, self._events = NOTHING, 0.0, list[str]()
        self._prepare()

    # --- what a user's own loop, a driver and a log read and call

    @property
    def robots(self) -> dict[str, StateTracker]:
        """The robot by its name."""
        return {self.name: self.tracker}

    @property
    def trackers(self) -> dict[str, StateTracker]:
        """The past of the robot by its name."""
        return {self.name: self.tracker}

    @property
    def steps(self) -> int:
        """Control steps of the whole loop."""
        return self.problem.steps

    @property
    def sent(self) -> int:
        """Control steps whose commands have been returned; the next ones begin there."""
        return len(self.tracker.sent)

    @property
    def time(self) -> float:
        """Up to which the robot has been measured, seconds."""
        return self.tracker.time

    @property
    def seen(self) -> bool:
        """Whether the robot has been measured."""
        return self.tracker.last is not None

    @property
    def over(self) -> bool:
        """Whether all commands have been returned."""
        return self.sent >= self.steps

    @property
    def holds(self) -> bool:
        """False once measurements contradicted what was assumed; it stays so."""
        return self.tracker.holds

    @property
    def proven(self) -> bool:
        """Whether the rest of the task is proven for the commands that are planned now."""
        return self._evidence.proof == "whole" and self.holds

    @property
    def given_up(self) -> bool:
        """Whether no step will give out commands any more."""
        return bool(self.stopped)

    def named(self, measurement: StateSeen | None) -> dict[str, StateMeasurement]:
        """A measurement by the name of its robot.

        Raises
        ------
        ProblemError
            For a robot that there is not.
        """
        found = measurement if isinstance(measurement, Mapping) else {self.name: measurement} if measurement else {}
        if strange := set(found) - {self.name}:
            raise ProblemError(f"measurement: expected of {self.name}, got one of {sorted(strange)[0]!r}")
        return dict(found)

    def label(self, name: str, parameter: str) -> str:
        """What a step calls a parameter."""
        return parameter

    def observe(self, measurement: StateSeen | None) -> None:
        """Learn from a measurement without planning; what is wrong with it is in the next step's events."""
        for seen in self.named(measurement).values():
            held = self.holds
            self._events += self.tracker.observe(seen)
            if held and not self.holds:
                self._evidence, self.alarmed = NOTHING, True

    def step(self, measurement: StateSeen | None = None) -> Floats:
        """Take a measurement, plan from there, and return the commands that follow those already returned.

        Parameters
        ----------
        measurement : StateMeasurement, mapping or None
            The newest states; None if there are none since the last call of `step` or `observe`.

        Returns
        -------
        ndarray, shape (applied_steps or fewer, n_u)
            None at all if nothing was proven at the beginning, and after the end.
        """
        work = Work(self.timer)
        self.observe(measurement)
        self.alarmed = False
        if self.over or self.stopped:
            return self.plan[:0]
        self._decide(work)
        begin, end = self.sent, min(self.sent + self.options.applied_steps, self.steps)
        end = begin if self.stopped else end
        events, self._events = tuple(dict.fromkeys(self._events)), []
        known = {self.name: StateSet.of(self.problem, self.tracker.box)} if self.seen else {}
        self.history.append(work.step(begin, end, self._ranges(), known, events))
        self.tracker.send(self.plan[begin:end])
        return self.plan[begin:end]

    def planned(self, begin: int, end: int) -> Floats:
        """The commands of control steps as they are planned now, for as long as the plan lasts."""
        return self.plan[begin:begin] if self.stopped else self.plan[begin:end]

    def recall(self, begin: int) -> None:
        """Take commands back that were returned for the control steps from `begin` on, none of which is past."""
        if begin < self.sent:
            self.tracker.recall(begin)

    def late(self, now: int, ahead: int = 0) -> None:
        """Commands come too late for the control steps before `now`: what the robot does then is not known."""
        self._events.append(f"commands came {(now - self.sent) * self.problem.step:.1f} s late")
        self.stop("commands came late, and what such a robot does without is not known")

    def stop(self, reason: str, for_good: bool = True) -> None:
        """Give out no more commands."""
        if not self.stopped:
            self._events.append(f"stopped: {reason}")
        self.stopped, self._evidence = self.stopped or reason, NOTHING

    def judged(self) -> float:
        """Robustness of the parts of the task with one, along the past, no less than 0 where the task is proven."""
        value = self.tracker.judged()
        return max(value, 0.0) if self.proven else value

    def entered(self) -> str:
        """In what the robot must have been, by the measurements; empty for nothing."""
        for k, known in enumerate(self.tracker.past):
            time = k * self.problem.step
            for avoid in self.problem.specification.avoid:
                if bool(avoid.during(np.array([time]))[0]):
                    here = known.position - avoid.offsets(np.array([time]))[0]
                    gap = min(float(piece.distance(here)) for piece in avoid.pieces) - avoid.radius
                    if gap < -known.away:
                        return f"the robot was in {avoid.name}"
        return ""

    def predicted(self, robot: str | None = None) -> Floats:
        """Where the robot goes with its middle parameters, shape (times, d), metres."""
        if not self.seen:
            return np.zeros((0, len(self.problem.fleet.places)))
        at, fleet = self.tracker.at, self._fleet(self.tracker.box)
        if at >= len(self.plan):
            return self.tracker.past[-1].position[None]
        states = fleet.trajectories(self.plan[at:], fleet.center[None], self.problem.step)[0]
        return np.asarray(states[:, fleet.place_columns])

    # --- deciding

    def _prepare(self) -> None:
        """Make the first plan good for all starts that a measurement may tell, as far as that is possible."""
        fleet = self.problem.fleet
        start = Box.about(fleet.start_states(fleet.center[None])[:, 0], self.tracker.errors)
        for _ in range(PREPARED):
            certificate = self._certified(self.plan, self._rest(0, start, self.tracker.progress.left), start)
            if certificate.proven:
                break
            self._tighten(certificate)
            more = replace(self.problem.solve, margin=self.problem.solve.margin + self._tighter)
            off = replace(self.problem.verify, certificate=False)
            found = solve(self.problem.with_(solve=more, verify=off), guess=self.plan)
            self.plan = found.controls if found.status == "planned" else self.plan

    def _decide(self, work: Work) -> None:
        """Whose commands are sent next: of a new plan with a proof, else of the last one."""
        if not self.seen:
            self.stop("there is no measurement")
            return
        silent = self.sent * self.problem.step - self.tracker.time
        if silent > self.options.silence + self.options.deadline:
            self._events.append(f"the robot has said nothing for {silent:.1f} s: the last plan goes on")
        new = self._solved(work)
        evidence = NOTHING if new is None else self._proof(new, work)
        self._tighten(evidence.tried)
        if work.seconds > self.options.deadline:
            self._events.append(f"planning took {work.seconds:.3f} s, longer than {self.options.deadline:g} s")
            evidence = NOTHING
        if new is not None and evidence.proof == "whole":
            self.plan, self._evidence = new, evidence
            work.ended("new", evidence)
            return
        if self._evidence.proof == "none":
            self._evidence = self._proof(self.plan, work)
        work.ended("kept", self._evidence)
        if self._evidence.proof == "none":
            tried = self._evidence.tried
            worst = "" if tried is None else f" ({tried.worst})"
            if not self.sent:
                self.stop(f"nothing is proven from where the robot is{worst}")
            else:
                self._events.append(f"nothing is proven from here{worst}: the last plan goes on")

    def _solved(self, work: Work) -> Floats | None:
        """The plan with other commands from the first unsent step on; None if there are none."""
        begin = self.sent
        try:
            box, progress = self.tracker.ahead(begin)
            rest = self._rest(begin, box, progress.left)
            limits = replace(
                rest.solve,
                time_limit=max(SHARE * self.options.deadline, 0.01),
                margin=rest.solve.margin + self._tighter,
                routes=1,
            )
            found = improve(replace(rest, solve=limits), self.plan[begin:])
        except (ProblemError, Unenclosed) as error:
            self._events.append(f"no way from here: {str(error).splitlines()[0]}")
            return None
        work.solve_seconds, work.iterations = found.build_seconds + found.solve_seconds, found.iterations
        work.status = found.status
        return np.concatenate([self.plan[:begin], found.controls])

    def _proof(self, plan: Floats, work: Work) -> Evidence:
        """What can be proven of a plan from the newest set on."""
        at, box = self.tracker.at, self.tracker.box
        try:
            rest = self._rest(at, box, self.tracker.progress.left)
        except ProblemError as error:
            self._events.append(str(error).splitlines()[0])
            return NOTHING
        certificate = self._certified(plan[at:], rest, box)
        work.certify_seconds += certificate.seconds
        return Evidence.whole(certificate, math.inf) if certificate.proven else Evidence(tried=certificate)

    def _certified(self, controls: Floats, rest: Problem, box: Box) -> SetCertificate:
        """What is proven of commands for a box of states and what is left."""
        return certify_box(rest, controls, box.half)

    def _rest(self, begin: int, box: Box, parts: Sequence[object]) -> Problem:
        """What is left from a grid time on, starting in the middle of a box."""
        return left_over(self.problem, begin, parts, self._fleet(box))  # type: ignore[arg-type]

    def _fleet(self, box: Box) -> Fleet:
        """The fleet with what is known of the parameters, starting in the middle of a box."""
        start = dict(zip(self.problem.fleet.system.states, box.middle.tolist(), strict=True))
        return with_ranges(self.problem.fleet, self.tracker.sets.ranges).with_(start=start)

    def _tighten(self, certificate: SetCertificate | None) -> None:
        """Keep more after a proof that fell short, less after one that did not."""
        if certificate is None or certificate.least >= 0 or not math.isfinite(certificate.least):
            self._tighter *= 0.7
        else:
            self._tighter = min(self._tighter - TIGHTER * certificate.least, TIGHTEST)

    def _ranges(self) -> dict[str, tuple[float, float]]:
        """What is known of every parameter."""
        sets = self.tracker.sets
        return {name: (float(low), float(high)) for name, (low, high) in zip(sets.names, sets.ranges, strict=True)}
