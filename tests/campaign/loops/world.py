"""The package's loop on the campaign's robots: what it is given, what it says, and what it sends."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.log import RunLog
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import Errors
from ensemble_ctrl.planning.online.step import Step
from ensemble_ctrl.problem import Objective, Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from .robot import BOUNDS, PARTS, Adversary, Body, Camera
from .scene import Scene, rates

Floats = NDArray[np.float64]
Look = Callable[["World", Step, Floats], None]


def problem_of(scene: Scene) -> Problem:
    """The package's problem of a scene."""
    most = np.maximum(np.abs(np.array(scene.controls)).max(axis=0), 0.3) * 1.3
    system: ArcSystem = Unicycle("y" if scene.heading_from == "y" else "x")
    if scene.system == "bicycle":
        system, most[1] = Bicycle("y" if scene.heading_from == "y" else "x", scene.wheelbase), 1.0
    parameters = {name: Interval(*ends) for name, ends in scene.parameters.items()}
    if scene.spread:
        parameters |= dict.fromkeys(("start_x", "start_y"), Interval(-scene.spread, scene.spread))
    start = np.array(scene.position), scene.heading
    fleet = Fleet(system, parameters, *start, -most, most, scene.radius, uncertainty=bounds_of(scene, system))
    return Problem(
        "loop",
        fleet,
        scene.duration,
        len(scene.controls),
        parse(scene.task),
        {name: Polyhedron.box([list(box[:2]), list(box[2:])]) for name, box in scene.regions.items()},
        {name: (Obstacle.polygon(np.array(shape)),) for name, shape in scene.obstacles.items()},
        {name: Motion.steady(velocity, scene.duration) for name, velocity in scene.velocities.items()},
        Objective(1.0, effort=0.1),
        terrain={
            f"mud{k}": Patch((Obstacle.polygon(np.array(corners)),), {"linear_traction": (low, high)})
            for k, (corners, low, high) in enumerate(scene.patches)
        },
    )


def bounds_of(scene: Scene, system: ArcSystem) -> Uncertainty:
    """What robots may do beside the model."""
    bounds, (first, second) = {name: scene.bounds.get(name, 0.0) for name in BOUNDS}, system.controls
    return Uncertainty(
        {"position": bounds["place"], "heading": bounds["heading"]},
        {first: bounds["first"], second: bounds["second"]},
        {first: bounds["share"], second: bounds["share"]},
        varies=dict.fromkeys(scene.parameters, bounds["stray"]),
        delay=bounds["delay"],
        jitter=bounds["jitter"],
        heading_hold=bounds["hold"] or None,
    )


@dataclass
class World:
    """The robots, which are their own clock, and what they were sent.

    Attributes
    ----------
    carried_out : list of ndarray
        The command of every control step that has begun, zero where there was none.
    """

    scene: Scene
    bodies: dict[str, Body]
    cameras: dict[str, Camera] = field(init=False)
    commands: dict[int, Floats] = field(default_factory=dict)
    carried_out: list[Floats] = field(default_factory=list)
    delivered: dict[str, list[Floats]] = field(default_factory=dict)
    loop: Receding | None = None
    came: float = np.inf

    def __post_init__(self) -> None:
        self.cameras = {name: Camera(body) for name, body in self.bodies.items()}
        self.delivered = {name: [] for name in self.bodies}
        for camera in self.cameras.values():
            camera.look()

    @property
    def robots(self) -> dict[str, Body]:
        """By name."""
        return self.bodies

    @property
    def parts(self) -> int:
        """Parts of control steps so far."""
        return len(next(iter(self.bodies.values())).track) - 1

    @cached_property
    def start(self) -> float:
        """When the plan begins, on the clock: all robots are seen at once."""
        lead = max(1, int(np.ceil(float(self.scene.options["deadline"]) / self.scene.step - 1e-9)))  # type: ignore[arg-type]
        return lead * self.scene.step

    def now(self) -> float:
        """Seconds."""
        return self.parts * self.scene.step / PARTS

    def wait(self, until: float) -> None:
        """Let all drive."""
        while self.now() < until - 1e-9:
            k, part = divmod(self.parts, PARTS)
            command = self.commands.get(k, np.zeros(2))
            if part == 0:
                self.carried_out.append(command)
            for name, body in self.bodies.items():
                body.drive(lambda n: self.commands.get(n, np.zeros(2)))
                self.cameras[name].look()
            self._come()

    def _come(self) -> None:
        """Something comes on the way."""
        added = self.scene.added
        if added is not None and self.loop is not None and self.came == np.inf and self.now() >= self.start + added[0]:
            self.came = self.now() - self.start
            self.loop.add_obstacle(added[1], [Obstacle.polygon(np.array(added[2]))])

    def read(self) -> Any:
        """What has arrived."""
        seen = {name: camera.read() for name, camera in self.cameras.items()}
        found = {name: Measurement(*map(float, each)) for name, each in seen.items() if each is not None}
        for name, each in seen.items():
            if each is not None:
                self.delivered[name].append(each)
        if len(self.bodies) > 1:
            return found
        return next(iter(found.values()), None)

    def send(self, begin: float, controls: Floats) -> None:
        """Commands from a time on."""
        first = round(begin / self.scene.step)
        self.commands = {k: u for k, u in self.commands.items() if k < first}
        self.commands |= {first + i: np.array(u, dtype=float) for i, u in enumerate(controls)}

    def stop(self) -> None:
        """Stand at once."""
        self.commands = {}


@dataclass
class Ran:
    """A loop that has ended."""

    world: World
    loop: Receding
    outcome: Outcome
    lines: list[dict[str, Any]]


def body_of(scene: Scene, adversary: Adversary, pose: Floats) -> Body:
    """A robot of a scene."""

    def asked(command: Floats) -> tuple[float, float]:
        v, turn = rates(scene, command)[0]
        return float(v), float(turn)

    return Body(adversary, scene.parameters, scene.errors, scene.step, pose, scene.bounds, asked, patches=scene.patches)


def world_of(scene: Scene) -> World:
    """The robots of a scene, at the start."""
    bodies = {}
    for k, (name, adversary) in enumerate(scene.robots.items()):
        shift = scene.spread * np.array([1.0, -1.0]) * (1 if k == 0 else -1)
        pose = np.array([*(np.array(scene.position) + shift), scene.heading])
        bodies[name] = body_of(scene, adversary, pose)
    return World(scene, bodies)


def options_of(scene: Scene) -> OnlineOptions:
    """How the loop runs."""
    errors = Errors(**scene.errors)
    return OnlineOptions(errors=errors, **scene.options)  # type: ignore[arg-type]


def run(scene: Scene, problem: Problem, look: Look, log: Path) -> Ran:
    """Run the loop of a scene."""
    world = world_of(scene)
    ticks = count()
    deadline = float(scene.options["deadline"])  # type: ignore[arg-type]
    slow = np.random.default_rng(world.scene.robots[next(iter(scene.robots))].seed)
    passed = [0.0]

    def timer() -> float:
        """Time stands still, or some plans take too long."""
        if scene.timer == "slow" and next(ticks) % 4 == 3:
            passed[0] += deadline * float(slow.choice([0.0, 0.5, 1.2]))
        return passed[0]

    loop = Receding(problem, options_of(scene), np.array(scene.controls), timer, tuple(scene.robots))
    world.loop = loop

    def listen(step: Step, controls: Floats) -> None:
        book.step(loop, step, controls)
        look(world, step, controls)

    with RunLog(log) as book:
        book.start(loop)
        outcome = drive(loop, world, world, listener=listen)
        book.end(outcome)
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return Ran(world, loop, outcome, lines)
