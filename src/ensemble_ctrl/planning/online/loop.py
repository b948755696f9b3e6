"""The loop's one step: from a measurement to the next commands, with a proof or with a reason to stand."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.remaining import SetCertificate, certify_set, together
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.ocp.online import InitialCondition, OnlineProgram, Timer
from ensemble_ctrl.planning.online.evidence import NOTHING, Evidence, Proof
from ensemble_ctrl.planning.online.followed import Followed
from ensemble_ctrl.planning.online.measurement import Measurement, Seen
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import PoseSet
from ensemble_ctrl.planning.online.remaining import for_a_while, of_one_robot, with_map
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.tracker import Tracker
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Source = Literal["new", "kept", "stopped", "recovered"]
Poses = dict[str, PoseSet]
"""Where each robot may be."""

WIDEST = 4
"""How often ranges may grow before the robot is stopped for good."""
TIGHTER, TIGHTEST = 1.5, 0.2
"""Times of what a proof lacks that the next plan keeps more, and the most that it keeps, metres."""
PREPARED = 4
"""Times that the first plan is improved before anything moves."""
SHARE = 0.6
"""Share of the deadline for solving; the rest is for proofs."""


@dataclass(frozen=True)
class Step:
    """What one step of the loop did.

    Attributes
    ----------
    begin, end : int
        The commands are for the control steps ``begin .. end - 1``, counted from the start of the loop.
    source : {"new", "kept", "stopped", "recovered"}
        Whose commands they are: of a new plan, of the last one, of none, or of a plan made while standing.
    proof : {"whole", "period", "none"}
        What is proven of them for the whole set of states: the rest of the task; or that nothing is hit until the next
        plan takes over, nor by standing after that; or nothing, for a robot that stands.
    clearance, robustness : float
        Proven of these commands, and of those planned after them as far as the proof goes (`Evidence`), metres; those
        of a ``kept`` plan are of its own proof.
    ranges : dict of str to (float, float)
        What is known of the parameters; of several robots, each is named after its robot, as in ``red.traction``.
    away, turn : float
        Size of the largest set of poses at the last measurement, metres and radians; infinite without one.
    seconds, solve_seconds, certify_seconds : float
        What it took.
    iterations : int
        Quadratic programs.
    status : str
        How solving ended.
    events : tuple of str
        What was out of the ordinary.
    """

    begin: int
    end: int
    source: Source
    proof: Proof
    clearance: float
    robustness: float
    ranges: dict[str, tuple[float, float]]
    away: float
    turn: float
    seconds: float
    solve_seconds: float
    certify_seconds: float
    iterations: int
    status: str
    events: tuple[str, ...]


@dataclass(eq=False)
class _Work:
    """What a step has tried so far."""

    timer: Timer
    began: float = field(init=False)
    solve_seconds: float = 0.0
    certify_seconds: float = 0.0
    iterations: int = 0
    status: str = ""
    source: Source = "stopped"
    evidence: Evidence = NOTHING

    def __post_init__(self) -> None:
        self.began = self.timer()

    @property
    def seconds(self) -> float:
        """Since the step began."""
        return self.timer() - self.began

    def ended(self, source: Source, evidence: Evidence) -> None:
        """Note whose commands are sent, and what is proven of them."""
        self.source, self.evidence = source, evidence


class Receding:
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
    ones take over, and that standing after that hits nothing that stands. Robots are not kept clear of each other.
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
        if not robots or len(set(robots)) < len(robots) or not all(robots):
            raise ProblemError(f"robots: expected different names, at least one, got {list(robots)}")
        self.options = settings.options if options is None else options
        self.problem = of_one_robot(problem)
        if self.options.lead(problem.step) > self.options.applied_steps:
            most = self.options.applied_steps * problem.step
            raise ProblemError(
                f"online.deadline: expected at most the {most:g} s of {self.options.applied_steps} applied steps, "
                f"got {self.options.deadline:g} s"
            )
        plan = solve(self.problem).controls if controls is None else np.array(controls, dtype=float)
        if plan.shape != (problem.steps, 2) or not np.isfinite(plan).all():
            raise ProblemError(f"controls: expected finite numbers of shape ({problem.steps}, 2), got {plan.shape}")
        self.plan: Floats = plan
        self.base = 0
        self.robots = {name: Followed(self.problem, self.options) for name in robots}
        self.program = OnlineProgram.of(self.problem, self.plan, self.options.order)
        self.history: list[Step] = []
        self.stopped, self.alarmed = "", False
        self.elapsed = 0.0
        self._added: dict[str, float] = {}
        self._events: list[str] = []
        self._evidence, self._final = NOTHING, False
        self._tighter, self._attempts = 0.0, 0
        self._prepare()

    # --- what a user's own loop reads and calls

    @property
    def trackers(self) -> dict[str, Tracker]:
        """The past of each robot."""
        return {name: robot.tracker for name, robot in self.robots.items()}

    @property
    def sent(self) -> int:
        """Control steps whose commands have been returned; the next ones begin there."""
        return len(next(iter(self.robots.values())).tracker.sent)

    @property
    def time(self) -> float:
        """Up to which every robot has been measured, seconds."""
        return min(tracker.time for tracker in self.trackers.values())

    @property
    def seen(self) -> bool:
        """Whether every robot has been measured."""
        return all(tracker.last is not None for tracker in self.trackers.values())

    @property
    def holds(self) -> bool:
        """False once measurements of any robot contradicted what was assumed; it stays so."""
        return all(tracker.holds for tracker in self.trackers.values())

    @property
    def steps(self) -> int:
        """Control steps of the whole loop."""
        run_for = self.options.run_for
        return self.problem.steps if run_for is None else max(1, round(run_for / self.problem.step))

    @property
    def over(self) -> bool:
        """Whether all commands have been returned."""
        return self.sent >= self.steps

    @property
    def proven(self) -> bool:
        """Whether the rest of the task is proven for the commands that are planned now."""
        return self._evidence.proof == "whole" and self.holds

    def named(self, measurement: Seen | None) -> dict[str, Measurement]:
        """Measurements by the names of their robots.

        Raises
        ------
        ProblemError
            For a robot that there is not, and for one without a name where there are several.
        """
        if measurement is None:
            return {}
        if isinstance(measurement, Mapping):
            strange = [name for name in measurement if name not in self.robots]
            if strange:
                raise ProblemError(f"measurement: expected of {', '.join(self.robots)}, got one of {strange[0]!r}")
            return dict(measurement)
        if len(self.robots) > 1:
            raise ProblemError(f"measurement: expected by name, of {', '.join(self.robots)}, got one without")
        return {next(iter(self.robots)): measurement}

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
        work = _Work(self.timer)
        self.observe(measurement)
        self.alarmed = False
        if self.over:
            return self.plan[:0]
        self._decide(work)
        begin, end = self.sent, min(self.sent + self.options.applied_steps, self.steps)
        controls = self.planned(begin, end)
        self._note(begin, end, work)
        self._send(controls)
        return controls

    def predicted(self, robot: str | None = None) -> Floats:
        """Where a robot, the only one if not named, goes with its middle parameters, shape (times, 2), metres."""
        at, poses = self._now()
        name = next(iter(self.robots)) if robot is None else robot
        if not poses:
            return np.zeros((0, 2))
        return self._middle(self.robots[name].drives(self.program.truncation.nodes, poses[name]), self.plan[at:])

    def recall(self, begin: int) -> None:
        """Take commands back that were returned for the control steps from `begin` on, none of which is past."""
        if begin < self.sent:
            for tracker in self.trackers.values():
                tracker.recall(begin)

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

    def add_obstacle(self, name: str, pieces: Sequence[Obstacle]) -> None:
        """Put an obstacle on the map, wherever it is; the task has to avoid all ``obstacles`` for it to count.

        It counts from now on, that is from `elapsed` or the newest measurement, whichever is later. What is planned
        is not proven any more. Where a robot may be in it, all are stopped; else the next step lets them stand if no
        way is proven.

        Raises
        ------
        ProblemError
            For a name that is taken.
        """
        if name in self.problem.obstacles or name in self.problem.regions:
            raise ProblemError(f"obstacle: expected a new name, got {name!r}")
        self._added[name] = max(self.elapsed, *(tracker.time for tracker in self.trackers.values()))
        self.problem = with_map(self.problem, {**self.problem.obstacles, name: tuple(pieces)})
        for robot in self.robots.values():
            robot.take(self.problem)
        self.program = OnlineProgram.of(self.problem, self.plan, self.options.order)
        self._evidence, self.alarmed = NOTHING, True
        self._events.append(f"an obstacle was added to the map: {name}")
        reached = self._reached(name)
        if reached:
            self.stop(f"{reached} may be in {name}")

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

    def entered(self) -> str:
        """Which robot must have been in which obstacle, by the measurements; empty for none."""
        kept = self.problem.specification.avoid
        for name, tracker in self.trackers.items():
            for k, pose in enumerate(tracker.past):
                time = k * self.problem.step
                for avoid in (avoid for avoid in kept if self._counts(avoid, time)):
                    if _gap(avoid, pose, time) < -pose.away:
                        return f"{self._called(name)} was in {avoid.name}"
        return ""

    def _reached(self, name: str) -> str:
        """Which robot may be in an obstacle that has just come and has to be avoided; empty for none."""
        time = self._added[name]
        avoided = self.problem.specification.avoid
        new = [avoid for avoid in avoided if avoid.name == name and self._counts(avoid, time)]
        for robot, tracker in self.trackers.items():
            pose = tracker.pose(time)
            if pose is not None and any(_gap(avoid, pose, time) < pose.away for avoid in new):
                return self._called(robot)
        return ""

    def _counts(self, avoid: AvoidConstraint, time: float) -> bool:
        """Whether something must be kept out of at a time; what came later need not be."""
        if time < self._added.get(avoid.name, 0.0):
            return False
        if self.options.horizon == "receding":
            return time >= avoid.begin  # the window begins anew at every present
        return bool(avoid.during(np.array([time]))[0])

    @property
    def given_up(self) -> bool:
        """Whether the robot stands and no step will let it drive again."""
        return bool(self.stopped) and (self._final or self._attempts >= self.options.attempts)

    def _learn(self, name: str, measurement: Measurement) -> None:
        """From a measurement of one robot."""
        robot = self.robots[name]
        if self.over and measurement.finite:
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

    def label(self, name: str, parameter: str) -> str:
        """What a step calls a parameter of a robot."""
        return parameter if len(self.robots) == 1 else f"{name}.{parameter}"

    def _called(self, name: str) -> str:
        """A robot in a sentence."""
        return name if len(self.robots) > 1 else "the robot"

    def _send(self, controls: Floats) -> None:
        """Some more commands were given out, to all robots."""
        for tracker in self.trackers.values():
            tracker.send(controls)

    def _prepare(self) -> None:
        """Make the plan good for all starts that measurements may tell, as far as that is possible."""
        errors, fleet = self.options.errors, self.problem.fleet
        pose = PoseSet(fleet.position, np.full(2, errors.position), fleet.heading, errors.heading)
        start = {next(iter(self.robots)): pose}  # the others are no different yet
        certificate = self._certified(self.plan, 0, start)
        for _ in range(PREPARED):
            if certificate.proven:
                break
            self._tighten(certificate)
            self.plan = self.program.solve(self._present_at(0, start, self.plan, 0), rounds=8).controls
            certificate = self._certified(self.plan, 0, start)
        self._tighter = 0.0
        every = dict.fromkeys(self.robots, pose)
        self.program.solve(self._present_at(0, every, self.plan, 0), rounds=1)  # what is loaded once is loaded now

    # --- deciding

    def _decide(self, work: _Work) -> None:
        """Whose commands are sent next."""
        for name, tracker in self.trackers.items():
            if tracker.last is None:
                self.stop("there is no measurement" + (f" of {name}" if len(self.robots) > 1 else ""))
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

    def _replan(self, work: _Work) -> None:
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

    def _again(self, work: _Work) -> Evidence:
        """A new proof of the last plan; its old one, where that still reaches far enough."""
        old, end = self._evidence, self.sent + self.options.applied_steps + self.options.lead(self.problem.step)
        again = self._proof(self.plan, work)
        return old if again.proof == "none" and end <= old.until else again

    def _recover(self, work: _Work) -> None:
        """Look for a way from where the robot stands; it takes over when `recovery` seconds have passed."""
        self._stand()
        begin = self.sent + math.ceil(self.options.recovery / self.problem.step)
        fresh = self.sent * self.problem.step - self.time <= self.options.silence + self.options.deadline
        self._rebase()
        beyond = begin >= self.steps or begin - self.base >= len(self.plan)
        if self._attempts >= self.options.attempts or not fresh or beyond:
            return
        self._attempts += 1
        found = self._from_here(begin - self.base, work)
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

    def _from_here(self, begin: int, work: _Work) -> Floats | None:
        """A plan on the whole grid whose commands start at step `begin`, from the planner; None if it finds none."""
        poses = self._now()[1]
        if not poses:
            return None
        midst = np.mean([pose.position for pose in poses.values()], axis=0)
        name = min(poses, key=lambda each: float(np.linalg.norm(poses[each].position - midst)))
        try:
            rest = self.robots[name].rest(self.base + begin, poses[name])
            limits = replace(rest.solve, time_limit=0.8 * self.options.recovery)
            found = solve(rest.with_(solve=limits, verify=replace(rest.verify, certificate=False)))
        except ProblemError as error:
            self._events.append(f"no way from here: {str(error).splitlines()[0]}")
            return None
        work.solve_seconds, work.status = sum(found.seconds.values()), found.status
        return np.concatenate([self.plan[:begin], found.controls])[: len(self.plan)]

    def _proof(self, controls: Floats, work: _Work, begin: int | None = None) -> Evidence:
        """What can be proven of commands, some of which have been sent, from the last measurement on."""
        at, poses = self._now()
        if not poses:
            return NOTHING
        begin = self.sent - self.base if begin is None else begin
        span = begin - at + self.options.applied_steps + self.options.lead(self.problem.step)
        try:
            rests = self._rests(at, poses)
            whole = self._shown(rests, controls[at:], at, poses)
            work.certify_seconds += whole.seconds
            if whole.proven:
                return Evidence.whole(whole, self.base + len(controls) if self.problem.motions else math.inf)
            span = min(span, len(controls) - at)
            soon = {name: for_a_while(rest, span) for name, rest in rests.items()}
            short = self._shown(soon, controls[at:][:span], at, poses)
        except ProblemError as error:
            self._events.append(str(error).splitlines()[0])
            return NOTHING
        work.certify_seconds += short.seconds
        return Evidence.period(short, self.base + at + span, whole) if short.proven else Evidence(tried=short)

    def _certified(self, controls: Floats, at: int, poses: Poses) -> SetCertificate:
        """What is proven from a grid time on, of every robot."""
        return self._shown(self._rests(at, poses), controls[at:], at, poses)

    def _rests(self, at: int, poses: Poses) -> dict[str, Problem]:
        """What is left for each robot from a grid time on."""
        return {name: self.robots[name].rest(self.base + at, pose) for name, pose in poses.items()}

    def _shown(self, rests: Mapping[str, Problem], ahead: Floats, at: int, poses: Poses) -> SetCertificate:
        """What is proven of commands from a grid time on for what is left."""
        departures = {name: self.robots[name].tracker.departures(ahead, self.base + at) for name in poses}
        return together(
            {
                name: certify_set(rests[name], ahead, pose.away, pose.turn, departures[name])
                for name, pose in poses.items()
            }
        )

    def _tighten(self, certificate: SetCertificate | None) -> None:
        """Keep more after a proof that fell short, less after one that did not."""
        if certificate is None or certificate.clearance >= 0:
            self._tighter *= 0.7
        else:
            self._tighter = min(self._tighter - TIGHTER * certificate.clearance, TIGHTEST)

    # --- where things stand; grid times count from the base

    def _now(self) -> tuple[int, Poses]:
        """The first grid time from the newest measurement of any robot on, and the sets of poses then.

        There are no sets while one robot is unknown.
        """
        k = max(tracker.at for tracker in self.trackers.values())
        found = {name: robot.pose(k) for name, robot in self.robots.items()}
        poses = {name: pose for name, pose in found.items() if pose is not None}
        return k - self.base, poses if len(poses) == len(found) else {}

    def _present(self, plan: Floats, free: int | None = None) -> InitialCondition:
        """What a solve starts from: `plan` may change from step `free` on, the first unsent one if not given."""
        at, poses = self._now()
        assert poses
        return self._present_at(at, poses, plan, self.sent - self.base if free is None else free)

    def _present_at(self, at: int, poses: Poses, plan: Floats, free: int) -> InitialCondition:
        """The same for sets of poses at a grid time: the robots' members side by side, and the largest growth."""
        nodes, ahead, base = self.program.truncation.nodes, plan[at:], self.base
        soon = free - at + 2 * self.options.applied_steps
        drives, paths, grown = [], [], []
        for name, pose in poses.items():
            robot = self.robots[name]
            drives.append(robot.drives(nodes, pose))
            middle = self._middle(drives[-1], ahead)
            paths.append(robot.path(base, base + at))
            grown.append(robot.growth(middle, ahead, base + at, pose, soon))
        growth = np.zeros(len(plan) + 1)
        growth[at:] = np.max(grown, axis=0) + self._tighter
        return InitialCondition(
            at, free, np.concatenate(drives), np.stack(paths, axis=1), growth, plan, base * self.problem.step
        )

    def _middle(self, drives: Floats, controls: Floats) -> Floats:
        """Where the middle one of some members goes, shape (steps + 1, 2), metres."""
        middle = drives[len(drives) // 2][None]
        return np.asarray(self.problem.fleet.arcs.paths(controls, middle, self.problem.step)[0])

    def _rebase(self) -> None:
        """With a receding horizon, let the grid begin at the last measurement; what is new at its end is to stand."""
        shift = self._now()[0]
        if self.options.horizon == "receding" and shift > 0:
            self.plan = np.concatenate([self.plan[shift:], np.zeros((min(shift, len(self.plan)), 2))])
            self.base += shift
            avoided, end = self.problem.specification.avoid, self.problem.duration
            lasting = all(avoid.begin <= 0 and avoid.end >= end for avoid in avoided)
            self._evidence = self._evidence.of_a_period() if lasting else NOTHING

    def _stand(self) -> None:
        """No speed from the next commands on."""
        self.plan = self.plan.copy()
        self.plan[max(self.sent - self.base, 0) :] = 0.0

    def _note(self, begin: int, end: int, work: _Work) -> None:
        """Remember what this step did."""
        poses, evidence = self._now()[1], work.evidence
        ranges = {
            self.label(name, parameter): (float(low), float(high))
            for name, tracker in self.trackers.items()
            for parameter, (low, high) in zip(tracker.sets.names, tracker.ranges, strict=True)
        }
        self.history.append(
            Step(
                begin=begin,
                end=end,
                source=work.source,
                proof=evidence.proof,
                clearance=evidence.clearance,
                robustness=evidence.robustness,
                ranges=ranges,
                away=max((pose.away for pose in poses.values()), default=math.inf),
                turn=max((pose.turn for pose in poses.values()), default=math.inf),
                seconds=work.seconds,
                solve_seconds=work.solve_seconds,
                certify_seconds=work.certify_seconds,
                iterations=work.iterations,
                status=work.status,
                events=tuple(dict.fromkeys(self._events)),
            )
        )
        self._events = []


def _gap(avoid: AvoidConstraint, pose: PoseSet, time: float) -> float:
    """How far the middle of a set of poses is from what must be kept out of, metres."""
    here = pose.position - avoid.offsets(np.array([time]))[0]
    return min(float(piece.distance(here)) for piece in avoid.pieces) - avoid.radius
