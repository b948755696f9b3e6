"""A loop as plain numbers: the map, the task, the commands to begin with, and what the robots do."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .robot import Adversary, moved

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""x low, x high, y low, y high."""


@dataclass(frozen=True)
class Part:
    """``F[begin, end] in(name)`` or ``G[begin, end] in(name)``, of a region."""

    kind: str
    name: str
    begin: float
    end: float

    @property
    def text(self) -> str:
        """In the task's language."""
        return f"{self.kind}[{self.begin:.10g}, {self.end:.10g}] in({self.name})"


@dataclass(frozen=True)
class Scene:
    """One loop."""

    family: str
    system: str
    heading_from: str
    wheelbase: float
    parameters: dict[str, tuple[float, float]]
    position: tuple[float, float]
    heading: float
    radius: float
    step: float
    controls: tuple[tuple[float, float], ...]
    obstacles: dict[str, tuple[tuple[float, float], ...]]
    velocities: dict[str, tuple[float, float]]
    regions: dict[str, Box]
    parts: tuple[Part, ...]
    duty: tuple[float, float]
    errors: dict[str, float]
    options: dict[str, object]
    robots: dict[str, Adversary]
    spread: float = 0.0
    added: tuple[float, str, tuple[tuple[float, float], ...]] | None = None
    timer: str = "none"
    solids: tuple[tuple[tuple[float, float], ...], ...] = ()
    bounds: dict[str, float] = field(default_factory=dict)
    patches: tuple[tuple[tuple[tuple[float, float], ...], float, float], ...] = ()

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.step * len(self.controls)

    @property
    def task(self) -> str:
        """In the task's language."""
        return " and ".join(
            [*(part.text for part in self.parts), f"G[{self.duty[0]:g}, {self.duty[1]:.10g}] avoid(obstacles)"]
        )

    @property
    def receding(self) -> bool:
        """Whether the task is read anew at every step."""
        return self.options.get("horizon") == "receding"


def rates(scene: Scene, controls: Floats) -> Floats:
    """Speed and turn rate, counter-clockwise, that commands ask for."""
    v, second = np.asarray(controls, dtype=float).reshape(-1, 2).T
    turn = second if scene.system == "unicycle" else v * np.tan(second) / scene.wheelbase
    return np.stack([v, turn if scene.heading_from == "x" else -turn], axis=1)


@dataclass
class _Draft:
    """What has been drawn so far."""

    rng: np.random.Generator
    step: float = 0.1
    path: Floats = field(default_factory=lambda: np.zeros((1, 3)))

    def pick(self, *values: object) -> object:
        """One of some values."""
        return values[int(self.rng.integers(len(values)))]


def make(seed: int, index: int) -> Scene:
    """The loop of a number."""
    rng = np.random.default_rng([seed, index])
    draft = _Draft(rng)
    step = draft.step = float(draft.pick(0.1, 0.1, 0.2))  # type: ignore[arg-type]
    steps = int(rng.integers(10, 19))
    system = "bicycle" if rng.random() < 0.25 else "unicycle"
    heading_from = "y" if rng.random() < 0.25 else "x"
    heading = float(rng.choice([0.0, np.pi - 0.01, -np.pi + 0.02, rng.uniform(-np.pi, np.pi)]))
    bare = Scene(
        "", system, heading_from, 0.4, {}, (0.0, 0.0), heading, float(rng.choice([0.0, 0.05, 0.1])), step,
        _controls(rng, steps, system), {}, {}, {}, (), (0.0, 0.0), {}, {}, {},
    )  # fmt: skip
    draft.path = nominal(bare)
    scene = replace(_map(draft, bare), parameters=_parameters(rng))
    errors, bounds = _errors(rng)
    scene = replace(scene, errors=errors, bounds=bounds, options=_options(draft, scene))
    scene = replace(scene, robots=_robots(draft, scene), added=_added(draft, scene))
    unseen = not scene.receding and rng.random() < 0.1
    if unseen:
        scene = _unseen(scene, rng)
    uncertain = scene.errors["heading"] < 3 and rng.random() < 0.15
    timer = "slow" if rng.random() < 0.1 else "none"
    scene = scene if unseen else _disturbed(scene, rng)
    families = [
        ("unseen robot", unseen),
        ("uncertainty", "place" in scene.bounds),
        ("receding", scene.receding),
        ("added obstacle", scene.added is not None),
        ("several robots", len(scene.robots) > 1),
        ("position only", scene.errors["heading"] > 3),
        ("moving obstacle", bool(scene.velocities)),
        ("drift", scene.errors["drift"] > 0),
        ("actuators", bool(scene.bounds)),
        ("uncertain start", uncertain),
    ]
    family = next((name for name, is_so in families if is_so), "plain")
    return replace(scene, family=family, spread=0.02 if uncertain else 0.0, timer=timer)


def late(seed: int, index: int) -> Scene:
    """The loop of a number with robots that may be late, and sometimes mud on their way."""
    scene, rng = make(seed, index), np.random.default_rng([seed, index, 1])
    bounds = {"delay": scene.step * float(rng.choice([0.0, 0.3, 1.0, 1.7])), "jitter": 0.0}
    if rng.random() < 0.5:
        bounds["jitter"] = scene.step * float(rng.choice([0.05, 0.2]))
    patches: list[tuple[tuple[tuple[float, float], ...], float, float]] = []
    for _ in range(int(rng.integers(0, 3))):
        at = nominal(scene)[int(rng.integers(2, len(scene.controls))), :2] + rng.uniform(-0.2, 0.2, 2)
        shape = at + rng.uniform(0.1, 0.4) * _polygon(rng)
        low = float(rng.uniform(0.5, 0.95))
        patches.append((tuple((float(x), float(y)) for x, y in shape), low, low + float(rng.uniform(0.0, 0.5))))
    return replace(scene, family="late or muddy", bounds={**scene.bounds, **bounds}, patches=tuple(patches))


def nominal(scene: Scene) -> Floats:
    """Poses at the grid times with factors of 1, shape (steps + 1, 3)."""
    poses = [np.array([*scene.position, scene.heading])]
    for v, turn in rates(scene, np.array(scene.controls)):
        poses.append(moved(poses[-1], v, turn, scene.step))
    return np.array(poses)


def _controls(rng: np.random.Generator, steps: int, system: str) -> tuple[tuple[float, float], ...]:
    """A way in up to three bends."""
    v = float(rng.uniform(0.4, 1.0))
    bends = rng.uniform(-0.8, 0.8, 3) * (rng.random(3) < 0.7)
    turn = np.repeat(bends, -(-steps // 3))[:steps]
    if system == "bicycle":
        turn = np.arctan(turn * 0.4 / v)
    stands = int(rng.integers(0, 3))
    return tuple((0.0, 0.0) if k >= steps - stands else (v, float(turn[k])) for k in range(steps))


def _parameters(rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """Which factors vary, and how much: sometimes not at all."""
    width = float(rng.choice([0.0, 0.03, 0.1, 0.2]))
    names: list[tuple[str, ...]] = [("traction",), ("traction",), ("linear_traction",), ("angular_traction",)]
    names.append(("linear_traction", "angular_traction"))
    return {name: (1.0 - width, 1.0 + width) for name in names[int(rng.integers(len(names)))]}


def _map(draft: _Draft, bare: Scene) -> Scene:
    """Obstacles beside the way, and places on it."""
    rng, path, end = draft.rng, draft.path, bare.duration
    obstacles, velocities = {}, {}
    for i in range(int(rng.integers(1, 4))):
        k = int(rng.integers(len(path) // 3, len(path)))
        size, gap = rng.uniform(0.1, 0.4), bare.radius + rng.uniform(0.03, 0.4)
        side = float(rng.choice([-1.0, 1.0]))
        middle = path[k, :2] + side * (size + gap) * np.array([-np.sin(path[k, 2]), np.cos(path[k, 2])])
        shape = middle + size * _polygon(rng)
        if rng.random() < 0.15:
            velocity = rng.uniform(-0.3, 0.3, 2)
            shape = shape - velocity * k * bare.step
            velocities[f"o{i}"] = (float(velocity[0]), float(velocity[1]))
        obstacles[f"o{i}"] = tuple((float(x), float(y)) for x, y in shape)
    room = rng.uniform(0.1, 0.5)
    late = round(0.7 * len(bare.controls)) * bare.step
    regions = {"goal": _around(path[-3:, :2], room)}
    kinds = [
        (Part("F", "goal", late, end),),
        (Part("F", "goal", late, end),),
        (),
        (Part("G", "lane", 0.0, end), Part("F", "goal", late, end)),
        (Part("F", "mid", *_window(bare, len(path) // 2)), Part("F", "goal", late, end)),
        (Part("G", "goal", end - bare.step, end),),
    ]
    parts = kinds[int(rng.integers(len(kinds)))]
    regions |= {"lane": _around(path[:, :2], room), "mid": _around(path[len(path) // 2 :][:1, :2], room)}
    used = {part.name for part in parts}
    duty = (0.0, end) if rng.random() < 0.8 else (0.0, round(0.6 * len(bare.controls)) * bare.step)
    return replace(
        bare,
        obstacles=obstacles,
        velocities=velocities,
        regions={name: box for name, box in regions.items() if name in used},
        parts=parts,
        duty=duty,
    )


def _window(bare: Scene, k: int) -> tuple[float, float]:
    """Some steps about a grid time."""
    return (k - 2) * bare.step, (k + 2) * bare.step


def _around(places: Floats, room: float) -> Box:
    """A box about some places."""
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _polygon(rng: np.random.Generator) -> Floats:
    """A triangle to pentagon within the unit circle, counter-clockwise."""
    corners = int(rng.integers(3, 6))
    angles = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(corners) / corners
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _disturbed(scene: Scene, rng: np.random.Generator) -> Scene:
    """Sometimes any errors beside the model, and robots with a loop on their heading."""
    if rng.random() > 0.25:
        return scene
    own = {"place": float(rng.choice([0.001, 0.02])), "heading": float(rng.choice([0.002, 0.05]))}
    more = {"first": 0.01, "second": 0.01, "share": 0.02, "stray": 0.02, "hold": float(rng.choice([0.2, 1.0]))}
    kept = {name: value for name, value in more.items() if rng.random() < 0.5}
    return replace(scene, bounds={**scene.bounds, **own, **kept})


def _errors(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Bounds that are assumed, and that the robots go to: of measurements, and of errors of the commands."""
    actuators = rng.random() < 0.3
    errors = {
        "position": float(rng.choice([0.002, 0.01, 0.02])),
        "heading": 3.2 if rng.random() < 0.08 else float(np.radians(rng.uniform(0.3, 2.0))),
        "drift": float(rng.choice([0.01, 0.05])) if rng.random() < 0.35 else 0.0,
    }
    names = ("first", "second") if actuators else ()
    return errors, {name: float(rng.uniform(0.002, 0.03)) for name in names}


def _options(draft: _Draft, scene: Scene) -> dict[str, object]:
    """How the loop runs."""
    rng = draft.rng
    applied = int(rng.integers(4, 9))
    options: dict[str, object] = {
        "applied_steps": applied,
        "deadline": scene.step * int(rng.integers(1, min(applied, 4) + 1)),
        "order": int(rng.integers(1, 3)),
        "rounds": 1,
        "recovery": 0.3,
        "attempts": 1 if rng.random() < 0.03 else 0,
        "silence": 0.5 if rng.random() < 0.1 else 2.0,
        "learn": bool(rng.random() < 0.9),
    }
    if rng.random() < 0.12:
        options |= {"horizon": "receding", "run_for": scene.step * int(rng.integers(10, 19))}
    return options


def _robots(draft: _Draft, scene: Scene) -> dict[str, Adversary]:
    """One robot, or two; each with a way of its own to be the worst."""
    rng = draft.rng
    names = ["robot"] if rng.random() < 0.8 else ["red", "blue"]
    return {name: _adversary(draft, scene) for name in names}


def _unseen(scene: Scene, rng: np.random.Generator) -> Scene:
    """Two robots that drift, one of which is not seen any more after a while."""
    name = next(iter(scene.parameters))
    seen = replace(next(iter(scene.robots.values())), factors={name: 1.0}, period=1, lost=0.0, silent=np.inf, delay=0.0)
    silent = replace(seen, silent=float(rng.uniform(0.1, 0.5)) * scene.duration, drift="up", seed=seen.seed + 1)
    return replace(
        scene,
        parameters={name: (0.8, 1.2)},
        errors={**scene.errors, "position": 0.002, "heading": 0.005, "drift": 0.05},
        bounds={},
        options={**scene.options, "silence": 9.0},
        robots={"red": seen, "blue": silent},
        added=None,
    )


def _adversary(draft: _Draft, scene: Scene) -> Adversary:
    """A robot at the bounds."""
    rng = draft.rng
    factors = {
        name: float(rng.choice([low, high, rng.uniform(low, high)])) for name, (low, high) in scene.parameters.items()
    }
    silent = float(rng.uniform(0.3, 1.0)) * scene.duration if rng.random() < 0.2 else np.inf
    return Adversary(
        factors=factors,
        drift=str(draft.pick("up", "down", "back", "still", "fall")),
        slip=str(draft.pick("plus", "minus", "alternate", "random", "random")),
        noise=str(draft.pick("corner", "alternate", "random", "late corner")),
        period=int(rng.integers(1, 8)),
        offset=float(rng.choice([0.0, 0.0, 0.37, 0.8])),
        delay=float(rng.choice([0.0, 0.1, 0.25])),
        lost=float(rng.choice([0.0, 0.0, 0.4])),
        repeats=bool(rng.random() < 0.2),
        shuffles=bool(rng.random() < 0.2),
        turns=int(rng.integers(-1, 2)),
        silent=silent,
        seed=int(rng.integers(2**31)),
    )


def _added(draft: _Draft, scene: Scene) -> tuple[float, str, tuple[tuple[float, float], ...]] | None:
    """Something that comes on the way: behind the robots, before them, on them, or somewhere."""
    rng, path = draft.rng, draft.path
    if rng.random() > 0.12 or scene.receding:
        return None
    k = int(rng.integers(2, len(path) - 2))
    at = path[int(rng.integers(0, len(path))), :2] + rng.uniform(-0.3, 0.3, 2)
    shape = at + rng.uniform(0.05, 0.2) * _polygon(rng)
    return k * scene.step, "late", tuple((float(x), float(y)) for x, y in shape)
