"""What a loop says, held against what its robots do."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.step import Step

from .robot import PARTS, Adversary, Body
from .scene import Part, Scene
from .world import Ran, World, body_of, problem_of, run

Floats = NDArray[np.float64]
Corners = tuple[tuple[float, float], ...]
TOLERANCE = 1e-6
"""Metres and radians: rounding, and what factors move within one part of a step."""
FUTURES = (("up", "plus"), ("down", "minus"), ("back", "random"))
"""What a robot may go on to do."""
MEMBERS = 3
"""Corners of the sets that a proof is for, each of which goes on in one of these ways."""


@dataclass(frozen=True)
class Fault:
    """Something that is said and is not so."""

    kind: str
    what: str
    amount: float


@dataclass
class Judge:
    """Collects what is wrong while a loop runs."""

    scene: Scene
    faults: list[Fault] = field(default_factory=list)
    proofs: dict[str, int] = field(default_factory=dict)
    checks: int = 0

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(next(iter(self.scene.robots.values())).seed)

    def hold(self, good: bool, kind: str, what: str, amount: float = 0.0) -> None:
        """One statement."""
        self.checks += 1
        if not good:
            self.faults.append(Fault(kind, what, float(amount)))

    # --- the truth

    def clearance(self, world: World, track: Floats, first: float, begin: float, end: float) -> float:
        """Smallest distance of a track, which begins at time `first`, from what it must keep out of in a window."""
        times = first + np.arange(len(track)) * self.scene.step / PARTS
        least = math.inf
        for name, corners in self.scene.obstacles.items():
            least = min(least, self._distance(corners, name, track, times, begin, end))
        for corners in self.scene.solids:
            least = min(least, self._distance(corners, "", track, times, begin, end))
        added = self.scene.added
        if added is not None and world.came < math.inf:
            least = min(least, self._distance(added[2], "", track, times, max(begin, world.came), end))
        return least

    def _distance(
        self,
        corners: tuple[tuple[float, float], ...],
        name: str,
        track: Floats,
        times: Floats,
        begin: float,
        end: float,
    ) -> float:
        """From one obstacle, which may move; negative inside."""
        when = (times >= begin - 1e-9) & (times <= end + 1e-9)
        if not when.any():
            return math.inf
        velocity = np.array(self.scene.velocities.get(name, (0.0, 0.0)))
        places = track[when, :2] - velocity * np.clip(times[when], 0.0, self.scene.duration)[:, None]
        shape = shapely.Polygon(corners)
        points = shapely.points(places)
        outside = shapely.distance(points, shape)
        inside = np.where(outside > 0, 0.0, shapely.distance(points, shape.exterior))
        return float((outside - inside).min()) - self.scene.radius

    def margin(self, part: Part, track: Floats, first: float, shift: float = 0.0) -> float:
        """An upper bound of a part's robustness along a track that begins at time `first`, read at `shift`."""
        times = first + np.arange(len(track)) * self.scene.step / PARTS
        when = (times >= shift + part.begin - 1e-9) & (times <= shift + part.end + 1e-9)
        x0, x1, y0, y1 = self.scene.regions[part.name]
        x, y = track[when, 0], track[when, 1]
        inside = np.minimum.reduce([x - x0, x1 - x, y - y0, y1 - y])
        if part.kind == "G":
            return float(inside.min())
        fastest = np.hypot(*np.diff(track[:, :2], axis=0).T).max(initial=0.0)
        return float(inside.max() + fastest / 2)

    # --- each step

    def step(self, world: World, step: Step, controls: Floats) -> None:
        """Sets and proofs, when commands are given out."""
        assert world.loop is not None
        loop = world.loop
        self.proofs[step.proof] = self.proofs.get(step.proof, 0) + 1
        self.hold(loop.holds, "contradicted", "measurements within their bounds contradict what is assumed")
        for name, body in world.bodies.items():
            self._sets(world, loop, name, body, step)
        if step.proof != "none":
            for name, body in world.bodies.items():
                self._proof(world, loop, name, body, step)

    def _sets(self, world: World, loop: Receding, name: str, body: Body, step: Step) -> None:
        """The truth is in the sets of the past and of now, and in the ranges."""
        tracker = loop.trackers[name]
        track, first = np.array(body.track), round(world.start / self.scene.step * PARTS)
        for k, pose in enumerate(tracker.past):
            at = min(first + k * PARTS, len(track) - 1)
            off = excess(pose.position, pose.half, pose.heading, pose.turn, track[at])
            self.hold(off <= TOLERANCE, "excluded", f"the pose of step {k} of {name}", off)
        k = tracker.at
        here = loop.robots[name].pose(k)
        if here is not None and first + k * PARTS < len(track):
            off = excess(here.position, here.half, here.heading, here.turn, track[first + k * PARTS])
            self.hold(off <= TOLERANCE, "excluded", f"the pose at step {k} of {name}", off)
        when = tracker.time + world.start if tracker.time > 0 else None
        for parameter, (low, high) in zip(tracker.sets.names, tracker.ranges, strict=True):
            true = body.parameter(parameter, body.now if when is None else when)
            off = max(low - true, true - high)
            if when is not None:
                self.hold(off <= TOLERANCE, "excluded", f"{parameter} of {name}", off)
            self.hold(loop.label(name, parameter) in step.ranges, "log", f"no range of {parameter}")

    def _proof(self, world: World, loop: Receding, name: str, body: Body, step: Step) -> None:
        """No consistent robot does other than what is proven."""
        scene = self.scene
        tracker = loop.trackers[name]
        sent = np.concatenate([tracker.sent, controls_after(loop, step)])
        whole = step.proof == "whole"
        lead = loop.options.lead(scene.step)
        end = loop.base + len(loop.plan) if whole else step.end + lead
        last = min(end, loop.base + len(loop.plan))
        now = world.now() - world.start
        parts = max(round((last * scene.step - now) / scene.step * PARTS), 0)

        def commands(step: int) -> Floats:
            k = step - round(world.start / scene.step)
            return sent[k] if 0 <= k < len(sent) else np.zeros(2)

        begin = round(world.start / scene.step * PARTS)
        past = np.array(body.track)[begin:] if world.parts >= begin else np.zeros((0, 3))
        first = 0.0 if world.parts >= begin else now
        at = loop._now()[0] + loop.base
        for drift, slip in FUTURES[: 2 if len(past) else 3]:
            future = body.future(commands, parts, drift, slip)
            track = np.concatenate([past[:-1], future]) if len(past) else future
            self._future(world, name, step, track, first, now, at if scene.receding else 0)
        if step.source in ("new", "recovered"):
            self._members(world, loop, name, body, step, sent, at, last)

    def _members(
        self, world: World, loop: Receding, name: str, body: Body, step: Step, sent: Floats, at: int, last: int
    ) -> None:
        """Corners of the set of poses with ends of the ranges, which have drifted since they were known."""
        scene, tracker = self.scene, loop.trackers[name]
        pose = tracker.onset(at)
        if pose is None:
            return
        began = at * scene.step
        rate, since, bounds = scene.errors["drift"], max(began - tracker.time, 0.0), scene.bounds
        shift = began if scene.receding else 0.0
        for _ in range(MEMBERS):
            sign = self.random.choice([-1.0, 1.0], 3)
            drift, slip = FUTURES[int(self.random.integers(3))]
            start = np.array([*(pose.position + sign[:2] * pose.half), pose.heading + sign[2] * min(pose.turn, np.pi)])
            values = {}
            for parameter, ends in zip(tracker.sets.names, tracker.ranges, strict=True):
                known = float(ends[int(self.random.integers(2))])
                low, high = scene.parameters[parameter]
                way = rate * since * {"up": 1.0, "down": -1.0}.get(drift, 0.0)
                values[parameter] = float(np.clip(known + way, low, high))
            member = body_of(scene, Adversary(values, drift, slip, seed=1), start)
            # its undelayed self; who is late is where that was before
            lag, member.late, member.begun = int(self.random.choice([0, member.late])), 0, at * PARTS
            # how far a loop on its heading had let it go by then
            member.off = float(self.random.choice([-1.0, 1.0])) * bounds.get("hold", 0.0) * bounds.get("heading", 0.0)
            member.saturates = True
            for _ in range((last - at) * PARTS):
                member.drive(lambda n: sent[n] if 0 <= n < len(sent) else np.zeros(2))
            track = np.array(member.track)
            track = np.concatenate([np.tile(track[:1], (lag, 1)), track[: len(track) - lag]])
            self._member(world, step, f"a member for {name}", track, began, shift)

    def _member(self, world: World, step: Step, name: str, track: Floats, began: float, shift: float) -> None:
        """One of them."""
        begin, end = shift + self.scene.duty[0], shift + self.scene.duty[1]
        clear = self.clearance(world, track, began, max(begin, began), end)
        self.hold(clear >= -TOLERANCE, "collides", f"{name} under {step.proof} at step {step.begin}", clear)
        later = self.clearance(world, track, began, max(begin, began, step.begin * self.scene.step), end)
        self.hold(step.clearance <= later + TOLERANCE, "clearance", f"{name} at {step.begin}: {step.clearance}", later)
        if step.proof != "whole":
            return
        for part in self.scene.parts:
            if shift + part.begin >= began:
                value = self.margin(part, track, began, shift)
                good = step.robustness <= value + TOLERANCE
                self.hold(good, "robustness", f"{name}: {part.text} at {step.begin}: {step.robustness}", value)

    def _future(self, world: World, name: str, step: Step, track: Floats, first: float, now: float, base: int) -> None:
        """One of the ways a robot may go."""
        scene = self.scene
        shift = base * scene.step
        begin, end = (shift + scene.duty[0], shift + scene.duty[1])
        ahead = track[round((now - first) / scene.step * PARTS) :]
        clear = self.clearance(world, ahead, now, max(begin, now), end)
        self.hold(clear >= -TOLERANCE, "collides", f"{name} under {step.proof} at step {step.begin}", clear)
        if step.begin * scene.step >= now:
            clear = self.clearance(world, ahead, now, max(begin, step.begin * scene.step), end)
            good = step.clearance <= clear + TOLERANCE
            self.hold(good, "clearance", f"{name} at step {step.begin}: {step.clearance}", clear)
        if step.proof != "whole":
            return
        for part in scene.parts:
            value = self.margin(part, track, first, shift)
            self.hold(value >= -TOLERANCE, "misses", f"{name}: {part.text} at step {step.begin}", value)
            if shift + part.begin >= now:
                good = step.robustness <= value + TOLERANCE
                self.hold(good, "robustness", f"{name}: {part.text} at {step.begin}: {step.robustness}", value)

    # --- the end

    def end(self, ran: Ran) -> None:
        """How it ended, and what is written of it."""
        world, outcome, scene = ran.world, ran.outcome, self.scene
        begin = round(world.start / scene.step * PARTS)
        tracks = {name: np.array(body.track)[min(begin, world.parts) :] for name, body in world.bodies.items()}
        for name, track in tracks.items():
            self._motion(world, name, track, outcome.ending)
            path = outcome.paths.get(name, np.zeros((0, 2)))
            for k, (place, pose) in enumerate(zip(path, ran.loop.trackers[name].past, strict=True)):
                true = track[min(k * PARTS, len(track) - 1), :2]
                off = float(np.linalg.norm(place - true)) - pose.away
                self.hold(off <= TOLERANCE, "path", f"step {k} of {name}", off)
        self._ending(ran, tracks)
        self._log(ran)

    def _motion(self, world: World, name: str, track: Floats, ending: str) -> None:
        """No robot ever was where it must not be, but in something that came where it could not stop any more."""
        scene = self.scene
        begin, end = scene.duty
        still = world.came
        world.came = math.inf
        clear = self.clearance(world, track, 0.0, begin, np.inf if scene.receding else end)
        world.came = still
        self.hold(clear >= -TOLERANCE, "collides", f"{name}, which ended as {ending}", clear)

    def _ending(self, ran: Ran, tracks: dict[str, Floats]) -> None:
        """The ending, its reason and its robustness."""
        scene, outcome, world = self.scene, ran.outcome, ran.world
        if outcome.ending in ("success", "finished") and not scene.receding:
            values = [self.margin(part, track, 0.0) for part in scene.parts for track in tracks.values()]
            worst = min(values, default=math.inf)
            self.hold(worst >= -TOLERANCE, "ending", f"{outcome.ending}, but the task is not done", worst)
            self.hold(outcome.robustness <= worst + TOLERANCE, "ending", "more robust than it is", worst)
        if outcome.ending == "success":
            clear = min(self.clearance(world, track, 0.0, *scene.duty) for track in tracks.values())
            self.hold(clear >= -TOLERANCE, "ending", "a success that hit something", clear)
            self.hold(ran.loop.history[-1].proof == "whole", "ending", "a success without a proof")
        if outcome.ending == "failed" and " was in " in outcome.reason:
            clear = min(self.clearance(world, track, 0.0, 0.0, np.inf) for track in tracks.values())
            self.hold(clear < 0, "ending", outcome.reason, clear)
        if outcome.ending == "stopped":
            after = next(iter(world.bodies.values())).track[-1].copy()
            world.wait(world.now() + 2 * scene.step)
            self.hold(len(world.commands) == 0, "ending", "stopped, with commands left")
            self.hold(bool((next(iter(world.bodies.values())).track[-1] == after).all()), "ending", "does not stand")

    def _log(self, ran: Ran) -> None:
        """The log, line by line."""
        world, outcome, scene = ran.world, ran.outcome, self.scene
        start, *steps, end = ran.lines
        self.hold(start["kind"] == "start" and end["kind"] == "end", "log", "first and last line")
        self.hold(abs(start["step_seconds"] - scene.step) < 1e-12, "log", "step_seconds")
        self.hold(start["steps"] == ran.loop.steps, "log", "steps")
        same = [end["ending"], end["reason"]] == [outcome.ending, outcome.reason]
        self.hold(same and number(end["robustness"]) == finite(outcome.robustness), "log", "the end")
        self.hold(len(steps) == len(outcome.steps), "log", "one line for each step")
        first = round(world.start / scene.step)
        for line, step, after in zip(steps, outcome.steps, [*outcome.steps[1:], None], strict=True):
            self.hold(abs(line["time"] - step.begin * scene.step) < 1e-9, "log", "time")
            for name in ("begin", "end", "source", "proof", "status", "iterations"):
                self.hold(line[name] == getattr(step, name), "log", name)
            for name in ("clearance", "robustness", "away", "turn"):
                self.hold(number(line[name]) == finite(getattr(step, name)), "log", name)
            self.hold(tuple(line["events"]) == step.events, "log", "events")
            self.hold({n: tuple(r) for n, r in line["ranges"].items()} == step.ranges, "log", "ranges")
            self._measured(ran, line)
            until = step.end if after is None else min(step.end, after.begin)
            for k in range(step.begin, until):
                if first + k < len(world.carried_out) and outcome.ending != "interrupted":
                    said = np.array(line["commands"][k - step.begin])
                    done = world.carried_out[first + k]
                    stopped_at_once = outcome.ending == "stopped" and not done.any()
                    self.hold(stopped_at_once or bool((said == done).all()), "log", f"the command of step {k}")

    def _measured(self, ran: Ran, line: dict[str, object]) -> None:
        """The measurement of a line is one that arrived."""
        seen = line.get("measurements") or {next(iter(ran.world.bodies)): line["measurement"]}
        assert isinstance(seen, dict)
        for name, each in seen.items():
            if each is not None:
                arrived = ran.world.delivered[name]
                near = any(
                    [each["x"], each["y"], each["heading"]] == list(map(float, other[1:]))
                    and (each["time"] == 0 or abs(each["time"] + ran.world.start - other[0]) < 1e-9)
                    for other in arrived
                )
                self.hold(near, "log", "a measurement that never arrived")


def controls_after(loop: Receding, step: Step) -> Floats:
    """What was returned in a step, and what is planned after it, from the first step that is not told as sent."""
    begin = loop.sent
    return loop.planned(begin, max(loop.base + len(loop.plan), begin))


def excess(position: Floats, half: Floats, heading: float, turn: float, truth: Floats) -> float:
    """By how much a pose is outside a set, metres or radians."""
    off = abs((truth[2] - heading + np.pi) % (2 * np.pi) - np.pi) - turn
    return float(max(*(np.abs(truth[:2] - position) - half), off))


def finite(value: float) -> float | None:
    """As JSON has it."""
    return value if math.isfinite(value) else None


def number(value: object) -> float | None:
    """As it was read."""
    return None if value is None else float(value)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Judged:
    """One loop."""

    family: str
    ending: str
    proofs: dict[str, int]
    checks: int
    faults: tuple[Fault, ...]


def judge(scene: Scene) -> Judged | None:
    """Run a scene and judge it; None if the package refuses its problem."""
    try:
        problem = problem_of(scene)
    except ProblemError:
        return None
    referee = Judge(scene)
    with tempfile.TemporaryDirectory() as folder:
        ran = run(scene, problem, referee.step, Path(folder) / "log.jsonl")
    referee.end(ran)
    return Judged(scene.family, ran.outcome.ending, referee.proofs, referee.checks, tuple(referee.faults))
