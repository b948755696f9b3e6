"""Random and hostile cases, each made anew from a seed and an index."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .arcs import Motion
from .distributions import is_exact
from .model import Case, Distribution, Floats, Long, Node, Polygon, ends_of, reach

Random = np.random.Generator
AWAY = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 2e-3, 1e-2, 0.1, 0.3)
"""Metres, at scale 1, by which something is moved to either side of touching."""
NUDGES = (0.0, 2.0**-52, 1e-12, 5e-10, 1e-9, 3e-9, 1e-8, 9e-7, 1e-6, 1e-4)
"""Seconds by which times miss the grid."""
WIDTHS = (0.0, 1e-12, 5e-10, 5e-9, 9e-7, 1e-5, 1e-3)
"""Seconds that tiny windows last."""
NAMES: tuple[dict[str, float], ...] = (
    {"traction": 0.1},
    {"linear_traction": 0.1},
    {"angular_traction": 0.1},
    {"start_heading": 0.1},
    {"start_x": 0.2},
    {"linear_traction": 0.1, "angular_traction": 0.05},
    {"traction": 0.1, "start_x": 0.1, "start_y": 0.05},
    {"start_heading": 0.05, "start_y": 0.1},
    {"linear_traction": 0.05, "angular_traction": 0.03, "start_heading": 0.02},
)
"""Parameters of a fleet with their half ranges."""

TIGHT: tuple[dict[str, float], ...] = (
    {"start_heading": 0.1},
    {"angular_traction": 0.1},
    {"linear_traction": 0.1, "start_heading": 0.02},
    {"angular_traction": 0.05, "start_heading": 0.05},
    {"linear_traction": 0.1, "angular_traction": 0.02},
    {"traction": 0.1},
)
"""Parameters under which remainders are as large as they say."""


def make(seed: int, index: int) -> Case:
    """The case with this index."""
    rng = np.random.default_rng([seed, index])
    weights = np.array([weight for weight, _ in FAMILIES.values()], dtype=float)
    name = list(FAMILIES)[int(rng.choice(len(FAMILIES), p=weights / weights.sum()))]
    return of_family(name, rng)


def of_family(name: str, rng: Random) -> Case:
    """A case of one family."""
    return replace(FAMILIES[name][1](rng), family=name)


def _pick(rng: Random, values: tuple[float, ...]) -> float:
    """One of some numbers."""
    return float(values[int(rng.integers(len(values)))])


def _away(rng: Random, scale: float) -> float:
    """A distance to either side of touching; mostly one that shows."""
    size = _pick(rng, AWAY) if rng.random() < 0.4 else float(rng.uniform(2e-3, 0.4))
    return float(rng.choice([-1.0, 1.0])) * size * scale


def _fleet(
    rng: Random,
    scale: float = 1.0,
    steps: int = 0,
    turn: float = 2.0,
    origin: float = 0.0,
    kinds: tuple[dict[str, float], ...] = NAMES,
    equal: float = 0.2,
) -> Case:
    """A fleet with controls and no task yet."""
    steps = steps or int(rng.choice([1, 2, 3, 5, 8, 12]))
    dt = _pick(rng, (0.1, 0.25, 0.5, 1.0, 1 / 3, 0.7))
    controls = rng.uniform([-2.0, -turn], [2.0, turn], (steps, 2)) * (rng.random((steps, 2)) < [0.9, 0.65])
    if rng.random() < 0.3:
        controls = np.round(controls * 4) / 4
    controls[:, 0] *= scale
    kind = kinds[int(rng.integers(len(kinds)))]
    width = 0.0 if rng.random() < equal else _pick(rng, (1e-6, 0.01, 0.3, 1.0, 2.0))
    parameters: dict[str, Distribution] = {}
    for name, half in kind.items():
        unit = scale if name in ("start_x", "start_y") else 1.0
        middle, size = (0.0 if name.startswith("start") else 1.0), half * width * unit
        if rng.random() < 0.4:
            middle += float(rng.uniform(-0.3, 0.3)) * unit
        parameters[name] = ("uniform", middle - size, middle + size)
    place = rng.uniform(-1, 1, 2) * scale + origin * rng.choice([-1.0, 1.0], 2)
    if rng.random() < 0.3:
        place = np.round(place)
    heading = 0.0 if rng.random() < 0.3 else float(rng.uniform(-np.pi, np.pi))
    radius = float(rng.uniform(0.01, 0.2)) * scale if rng.random() < 0.3 else 0.0
    rows = tuple((float(v), float(w)) for v, w in controls)
    axis = "y" if rng.random() < 0.2 else "x"
    start = float(place[0]), float(place[1])
    task = ("pred", 1.0, 0.0, 0.0)
    return Case("", "unicycle", axis, 0.3, parameters, start, heading, radius, dt * steps, rows, task)


def _seen(case: Case, rng: Random) -> tuple[Floats, Floats, float]:
    """Where a member is at some time, its direction there, and the time."""
    ends = np.array([ends_of(distribution) for distribution in case.distributions.values()]).reshape(-1, 2)
    member = np.where(rng.random(len(ends)) < 0.5, ends[:, 0], ends[:, 1])[None]
    time = float(rng.random()) * case.duration
    if rng.random() < 0.4:
        time = case.duration / len(case.controls) * int(rng.integers(len(case.controls) + 1))
    path = Motion(case).paths(member, np.array([time, time + 1e-3 * case.duration], dtype=Long))[0]
    along = (path[1] - path[0]).astype(float)
    size = float(np.hypot(*along))
    return path[0].astype(float), along / size if size > 0 else np.array([1.0, 0.0]), time


def _polygon(rng: Random, case: Case, scale: float, size: float) -> Polygon:
    """A convex polygon that a member passes at about the distance of `_away`, or one that it is driven into."""
    place, along, _ = _seen(case, rng)
    normal = np.array([-along[1], along[0]]) * rng.choice([-1.0, 1.0])
    gap = case.radius + _away(rng, scale)
    if rng.random() < 0.4:
        low = place + gap * np.abs(normal) + np.where(normal < 0, -size * scale, 0.0)
        low = low + np.where(normal < 0, -2 * gap * np.abs(normal), 0.0)
        (x0, y0), (x1, y1) = low, low + size * scale * rng.uniform(0.5, 1.0, 2)
        return tuple((float(x), float(y)) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
    corners = int(rng.choice([3, 4, 6, 24]))
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False) + rng.uniform(0, 2 * np.pi)
    centre = place + (gap + size * scale * np.cos(np.pi / corners) * rng.choice([0.0, 1.0], p=[0.1, 0.9])) * normal
    points = centre + size * scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return tuple((float(x), float(y)) for x, y in points)


def _time(rng: Random, case: Case, most: float) -> float:
    """A time up to `most`: on the grid, next to it, or anywhere."""
    dt = case.duration / len(case.controls)
    kind = rng.random()
    if kind < 0.35:
        return float(rng.uniform(0, most))
    time = dt * int(rng.integers(int(most / dt) + 1))
    if kind < 0.7:
        time += float(rng.choice([-1.0, 1.0])) * _pick(rng, NUDGES)
    return float(min(max(time, 0.0), most))


def _window(rng: Random, case: Case, most: float) -> tuple[float, float]:
    """A window that ends by `most`: of any size, tiny, or one instant."""
    first = _time(rng, case, most)
    if rng.random() < 0.3:
        return first, min(first + _pick(rng, WIDTHS), most)
    second = _time(rng, case, most)
    return min(first, second), max(first, second)


def _leaf(rng: Random, case: Case, scale: float) -> Node:
    """A predicate whose line a member passes closely, or a region or an obstacle of the map."""
    kind = rng.random()
    if kind < 0.2 and case.regions:
        leaf: Node = ("in", str(rng.choice(list(case.regions))))
        return ("not", leaf) if rng.random() < 0.3 else leaf
    if kind < 0.3 and case.obstacles and not case.motions:
        return ("avoid", str(rng.choice(list(case.obstacles))))
    place, _, _ = _seen(case, rng)
    angle = float(rng.uniform(0, 2 * np.pi))
    row = rng.choice([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [np.cos(angle), np.sin(angle)], [2.0, -3.0]])
    cx, cy = float(row[0]), float(row[1])
    offset = -(cx * place[0] + cy * place[1]) + _away(rng, scale)
    return ("pred", cx, cy, float(offset))


def _formula(rng: Random, case: Case, scale: float, depth: int, most: float) -> Node:
    """A formula that looks ahead by at most `most` seconds."""
    kind = rng.random()
    if depth == 0 or kind < 0.1:
        return _leaf(rng, case, scale)
    if kind < 0.25:
        parts = [_formula(rng, case, scale, depth - 1, most) for _ in range(2)]
        return (str(rng.choice(["and", "or"])), *parts)
    if kind < 0.32:
        return ("not", _formula(rng, case, scale, depth - 1, most))
    window: tuple[float | None, float | None] = (None, None)
    left = most
    if rng.random() < 0.7:
        share = most if depth == 1 else most * float(rng.uniform(0.2, 0.8))
        window = _window(rng, case, share)
        left = max(most - float(window[1] or 0.0) - 1e-9, 0.0)
    if kind < 0.42:
        parts = [_formula(rng, case, scale, depth - 1, left) for _ in range(2)]
        return ("U", *window, *parts)
    return (str(rng.choice(["F", "G"])), *window, _formula(rng, case, scale, depth - 1, left))


def _with_map(rng: Random, case: Case, scale: float, size: float = 0.4, obstacles: int = 2) -> Case:
    """Obstacles and a region that members come close to."""
    count = int(rng.integers(obstacles + 1))
    found: dict[str, tuple[Polygon, ...]] = {
        f"o{k}": (_polygon(rng, case, scale, size * float(rng.uniform(0.3, 1.5))),) for k in range(count)
    }
    place, _, _ = _seen(case, rng)
    half = rng.uniform(0.1, 1.0, 2) * scale
    low, high = place - half * rng.random(2), place + half
    return replace(
        case, obstacles=found, regions={"r": ((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))}
    )


def _duties(rng: Random, case: Case) -> list[Node]:
    """What is kept out of, each through a window of its own."""
    found: list[Node] = []
    for name in case.obstacles:
        window: tuple[float | None, float | None] = (None, None)
        if rng.random() < 0.6:
            window = _window(rng, case, case.duration)
        found.append(("G", *window, ("avoid", name)))
    return found


def _tasked(rng: Random, case: Case, scale: float, depth: int = 2) -> Case:
    """The case with duties and perhaps another part, which keeps within the horizon."""
    parts = _duties(rng, case)
    if not parts or rng.random() < 0.5:
        part = _formula(rng, case, scale, depth, case.duration)
        if reach(part) <= case.duration:
            parts.append(part)
    parts = parts or [("G", None, None, _leaf(rng, replace(case, obstacles={}), scale))]
    flat: list[Node] = []
    for part in parts:
        flat += part[1:] if part[0] == "and" else (part,)
    return replace(case, task=flat[0] if len(flat) == 1 else ("and", *flat))


def _plain(rng: Random) -> Case:
    return _tasked(rng, _with_map(rng, _fleet(rng), 1.0), 1.0)


def _windows(rng: Random) -> Case:
    case = _with_map(rng, _fleet(rng, kinds=NAMES[:5]), 1.0, obstacles=1)
    return _tasked(rng, case, 1.0, depth=1)


def _nested(rng: Random) -> Case:
    case = _with_map(rng, _fleet(rng, kinds=NAMES[:4], equal=0.5), 1.0, obstacles=0)
    return _tasked(rng, case, 1.0, depth=3)


def _far(rng: Random) -> Case:
    case = _fleet(rng, scale=_pick(rng, (0.01, 0.1, 1.0)), origin=_pick(rng, (1e3, 5e5, 5e6, 1e7)))
    return _tasked(rng, _with_map(rng, case, 1.0, size=_pick(rng, (0.02, 0.05, 0.3)), obstacles=1), 0.2)


def _scaled(rng: Random) -> Case:
    scale = _pick(rng, (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6))
    return _tasked(rng, _with_map(rng, _fleet(rng, scale=scale, kinds=NAMES[:6], equal=0.5), scale), scale)


def _turning(rng: Random) -> Case:
    case = _fleet(rng, turn=_pick(rng, (6.0, 20.0, 100.0)), kinds=NAMES[:5], equal=0.4)
    if rng.random() < 0.3:  # full circles, or halves of them, in each step
        dt = case.duration / len(case.controls)
        turn = float(rng.choice([1.0, 2.0])) * np.pi / dt
        case = replace(case, controls=tuple((v, turn) for v, _ in case.controls))
    return _tasked(rng, _with_map(rng, case, 1.0, obstacles=1), 1.0)


def _ranged(rng: Random) -> Case:
    case = _fleet(rng, kinds=NAMES[:4])
    name = next(iter(case.parameters))
    low = _pick(rng, (-1.0, -0.2, 0.0, 0.0, 0.5))
    case = replace(case, ranges={name: (low, low + _pick(rng, (0.0, 0.2, 1.0, 2.0)))})
    return _tasked(rng, _with_map(rng, case, 1.0, obstacles=1), 1.0)


def _starts(rng: Random) -> Case:
    return _tasked(rng, _with_map(rng, _fleet(rng, kinds=NAMES[4:], equal=0.0), 1.0), 1.0, depth=1)


def _moving(rng: Random) -> Case:
    case = _fleet(rng, kinds=NAMES[:7])
    _, _, time = _seen(case, rng)
    case = replace(case, obstacles={"o0": (_polygon(rng, case, 1.0, 0.3),)})
    count = int(rng.integers(2, 5))
    times = [0.0, *np.sort(rng.uniform(0, case.duration, count - 2)).tolist(), case.duration]
    offsets = rng.uniform(-1, 1, (count, 2)) * _pick(rng, (0.01, 0.5, 3.0))
    if rng.random() < 0.5:  # where it is when a member is there
        offsets = offsets - np.array([np.interp(time, times, offsets[:, k]) for k in (0, 1)])
    motion = tuple(times), tuple((float(x), float(y)) for x, y in offsets)
    case = replace(case, motions={"o0": motion})
    return replace(case, task=_duties(rng, case)[0])


def _cars(rng: Random) -> Case:
    case = _fleet(rng, turn=float(rng.uniform(0.1, 1.4)))
    return _tasked(rng, _with_map(rng, replace(case, system="bicycle"), 1.0, obstacles=1), 1.0)


def _spread(rng: Random, case: Case) -> Case:
    """The same fleet under other distributions."""
    distributions: dict[str, Distribution] = {}
    for name, distribution in case.parameters.items():
        low, high = ends_of(distribution)
        if high - low < 1e-3:
            low, high = low - 0.05, high + 0.05
        distributions[name] = _distribution(rng, low, high)
    cloud: tuple[str, ...] = ()
    bends = [name for name in distributions if name not in ("start_x", "start_y")]
    if bends and rng.random() < 0.4:
        count, cloud = int(rng.integers(2, 8)), tuple(bends)
        for name in bends:
            distributions[name] = ("samples", tuple(rng.uniform(*ends_of(distributions[name]), count).tolist()))
    return replace(case, parameters=distributions, cloud=cloud)


def _distribution(rng: Random, low: float, high: float) -> Distribution:
    """Any distribution on a range."""
    middle = (low + high) / 2
    simple: list[Distribution] = [
        ("uniform", low, high),
        ("beta", low, high, float(rng.uniform(0.5, 5)), float(rng.uniform(0.5, 5))),
        ("normal", low, high, float(rng.uniform(low, high)), float(rng.uniform(0.1, 1.0)) * (high - low)),
        ("samples", tuple(rng.uniform(low, high, int(rng.integers(1, 8))).tolist())),
    ]
    if rng.random() < 0.15:
        parts = ("uniform", low, low + 0.3 * (high - low)), ("beta", middle, high, 2.0, 2.0)
        return ("mixture", tuple((part, float(rng.uniform(0.2, 2.0))) for part in parts))
    return simple[int(rng.integers(len(simple)))]


def _shares(rng: Random) -> Case:
    case = _spread(rng, _fleet(rng, kinds=(NAMES[0], NAMES[1], NAMES[3], NAMES[5])))
    case = _with_map(rng, case, 1.0, obstacles=1)
    child = ("G", None, None, _leaf(rng, replace(case, obstacles={}), 1.0))
    if case.obstacles and rng.random() < 0.5:
        child = _duties(rng, case)[0]
    share = _pick(rng, (0.2, 0.5, 0.75, 0.9, 1 / 3, 1.0))
    if rng.random() < 0.4 and is_exact(case):
        temporal = str(rng.choice(["F", "G"]))
        inner: Node = ("share", share, _leaf(rng, replace(case, obstacles={}), 1.0))
        return replace(case, task=(temporal, None, None, ("not", inner) if rng.random() < 0.3 else inner))
    return replace(case, task=("share", share, child))


def _means(rng: Random) -> Case:
    case = _spread(rng, _fleet(rng, kinds=NAMES[:6]))
    case = _with_map(rng, case, 1.0, obstacles=0)
    part = _formula(rng, case, 1.0, 2, case.duration)
    if reach(part) > case.duration:
        part = ("G", None, None, _leaf(rng, case, 1.0))
    return replace(case, task=("mean", part))


def _reweighed(rng: Random) -> Case:
    """The mean of a fleet of which one range was asked for, and the other distribution is its own."""
    case = _with_map(rng, _spread(rng, _fleet(rng, kinds=NAMES[5:6])), 1.0, obstacles=0)
    name = str(rng.choice(list(case.parameters)))
    low = float(rng.uniform(0.5, 1.5))
    task = ("mean", ("G", None, None, _leaf(rng, case, 1.0)))
    return replace(case, ranges={name: (low, low + float(rng.uniform(0.1, 0.5)))}, task=task)


def _cornered(rng: Random) -> Case:
    """Two of three robots pass a square on either side, at its corners, where its sides' lines are too close."""
    far, half, radius = float(rng.uniform(3, 5)), float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.1, 0.3))
    away = radius * float(rng.uniform(1.05, 1.35))
    turn = np.arctan2(np.sqrt(2) * half, far) + np.arcsin(away / np.hypot(far, np.sqrt(2) * half))
    distributions: dict[str, Distribution] = {"start_heading": ("samples", (0.0, float(turn), -float(turn)))}
    steps, (x, y) = int(far) + 3, np.full(2, far / np.sqrt(2))
    square = tuple((float(x + a * half), float(y + b * half)) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    task = ("share", 0.6, ("G", None, None, ("avoid", "o0")))
    start, controls = (0.0, 0.0), ((1.0, 0.0),) * steps
    case = Case("", "unicycle", "x", 0.3, distributions, start, np.pi / 4, radius, float(steps), controls, task)
    return replace(case, obstacles={"o0": (square,)})


def _long(rng: Random) -> Case:
    case = _fleet(rng, steps=int(rng.choice([200, 500, 2000])), kinds=NAMES[:2], equal=0.6)
    return _tasked(rng, _with_map(rng, case, 1.0, obstacles=1), 1.0, depth=1)


def _touching(rng: Random) -> Case:
    """Straight ways of equal robots to a line that is touched but for roundings; some of them long and back."""
    kinds: tuple[dict[str, float], ...] = ({}, {}, NAMES[0])
    case = _fleet(rng, turn=0.0, equal=1.0, kinds=kinds, origin=_pick(rng, (0.0, 0.0, 1e3, 1e6)))
    window: tuple[float | None, float | None] = (None, None)
    if rng.random() < 0.5:
        speeds = rng.uniform(-1, 1, int(rng.integers(2, 12))) * _pick(rng, (10.0, 1000.0))
        controls = tuple((float(v), 0.0) for v in (*speeds, -speeds.sum()))
        case = replace(case, position=(0.0, 0.0), controls=controls, duration=float(len(controls)))
        window = case.duration, case.duration
    end = Motion(case).paths(np.ones((1, len(case.parameters))), np.array([case.duration], dtype=Long))[0, 0]
    row = (-float(np.cos(case.heading)), -float(np.sin(case.heading)))
    offset = -(Long(row[0]) * end[0] + Long(row[1]) * end[1])
    nudge = float(rng.choice([-1, 0, 1])) * float(np.spacing(float(abs(offset))))
    return replace(case, task=("G", *window, ("pred", *row, float(offset) + nudge)))


def _together(rng: Random) -> Case:
    """Several parts of which one is touched but for a rounding, and so left open."""
    case = _touching(rng)
    far = ("pred", 1.0, 0.0, 1e9), ("not", ("pred", 0.0, 1.0, -1e9))
    parts: list[Node] = [case.task, *(("F", None, None, leaf) for leaf in far[: int(rng.integers(1, 3))])]
    if rng.random() < 0.5:
        parts.reverse()
    return replace(case, task=("and", *parts))


def _implied(rng: Random) -> Case:
    """The same within several windows, some of which hold others."""
    case = _with_map(rng, _fleet(rng, kinds=NAMES[:5]), 1.0, obstacles=1)
    leaf, parts = _leaf(rng, replace(case, obstacles={}), 1.0), _duties(rng, case)
    for _ in range(int(rng.integers(2, 4))):
        window = _window(rng, case, case.duration) if rng.random() < 0.8 else (None, None)
        parts.append((str(rng.choice(["F", "F", "G"])), *window, leaf))
    return replace(case, task=("and", *parts))


def _returning(rng: Random) -> Case:
    """Out and back, of which only the way back counts: members are spread most when it begins."""
    slow, speed = -_pick(rng, (0.01, 0.02, 0.04)), float(rng.uniform(0.01, 0.05))
    angle, dt = float(rng.uniform(-3, 3)), _pick(rng, (0.5, 1.0))
    distributions: dict[str, Distribution] = {"linear_traction": ("uniform", 0.5, 1.0)}
    controls = ((speed, 0.0), (-speed, 0.0))
    case = Case("", "unicycle", "x", 0.3, distributions, (0.0, 0.0), angle, 0.0, 2 * dt, controls, ())
    case = replace(case, ranges={"linear_traction": (slow, 1.0)})
    row = np.array([np.cos(angle), np.sin(angle)])
    case = _blocked(case, row, slow * speed * dt + 1e-2 - _pick(rng, (1e-5, 1e-4, 1e-3, 1e-2)))
    return replace(case, task=("G", dt, 2 * dt, ("avoid", "o")))


def _overtaken(rng: Random) -> Case:
    """An obstacle that follows at the same mean speed, and comes close where its own speed changes."""
    dt, steps, speed = _pick(rng, (0.1, 0.5, 1.0)), int(rng.integers(1, 4)), float(rng.uniform(-2, 2))
    angle, way = float(rng.uniform(-3, 3)), speed * dt * steps
    distributions: dict[str, Distribution] = {"linear_traction": ("uniform", 1.0, 1.0 + _pick(rng, (0.0, 1e-3)))}
    case = Case(
        "",
        "unicycle",
        "x",
        0.3,
        distributions,
        (0.0, 0.0),
        angle,
        0.0,
        dt * steps,
        ((speed, 0.0),) * steps,
        ("avoid", "o"),
    )
    row = np.array([np.cos(angle), np.sin(angle)])
    share, gap = float(rng.uniform(0.05, 0.95)), float(rng.uniform(1e-3, 0.2))
    case = _blocked(case, row, 1e-2 - gap)
    ahead = share * way + gap + _away(rng, 0.1)
    places = ((0.0, 0.0), *((float(far * row[0]), float(far * row[1])) for far in (ahead, way)))
    return replace(case, motions={"o": ((0.0, share * case.duration, case.duration), places)})


def _spinning(rng: Random) -> Case:
    """Many turns on the spot, then straight ahead to beside a line: what is lost of the angle shows across the way."""
    turn, speed = _pick(rng, (1e3, 1e5, 1e7)) * float(rng.uniform(0.5, 2)), float(rng.uniform(1, 2))
    ahead = int(rng.integers(1, 4))
    controls = ((0.0, 0.0), (0.0, turn), *((speed, 0.0),) * ahead)
    case = Case("", "unicycle", "x", 0.3, {}, (0.0, 0.0), float(rng.uniform(-3, 3)), 0.0, 2.0 + ahead, controls, ())
    end = Motion(case).paths(np.ones((1, 0)), np.array([case.duration], dtype=Long))[0, 0]
    across = np.array([-end[1], end[0]], dtype=float) / float(np.hypot(*end)) * rng.choice([-1.0, 1.0])
    offset = -(Long(across[0]) * end[0] + Long(across[1]) * end[1])
    window = case.duration, case.duration
    return replace(case, task=("G", *window, ("pred", float(across[0]), float(across[1]), float(offset))))


def _huge(rng: Random) -> Case:
    """Speeds whose squares are no floating-point numbers, or whose sums are not."""
    case = _with_map(rng, _fleet(rng, kinds=NAMES[:6]), 1.0)
    fast = _pick(rng, (1e100, 1e155, 1e200, 1e300, 2e307))
    return _tasked(rng, replace(case, controls=tuple((v * fast, w) for v, w in case.controls)), 1.0, depth=1)


def _tight(rng: Random) -> Case:
    """Ways on which the remainders of the proof are as large as they say: turns on the spot, then straight ahead."""
    turn, angle = float(rng.uniform(-2, 2)), float(rng.uniform(-np.pi, np.pi))
    ahead = int(rng.integers(1, 4))
    speed = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.5, 2.0))
    kind = TIGHT[int(rng.integers(len(TIGHT)))]
    width = _pick(rng, (0.2, 0.5, 1.0, 2.0))
    distributions: dict[str, Distribution] = {}
    for name, half in kind.items():
        middle = 0.0 if name == "start_heading" else 1.0
        distributions[name] = ("uniform", middle - half * width, middle + half * width)
    controls = ((0.0, turn), *((speed, 0.0),) * ahead)
    case = Case(
        "", "unicycle", "x", 0.3, distributions, (0.0, 0.0), angle, 0.0, 1.0 + ahead, controls, ("pred", 1.0, 0.0, 0.0)
    )
    # the worst corner's second derivatives are along the way and across it
    corner = np.array([[end[int(rng.integers(2))] for end in map(ends_of, distributions.values())]])
    place = Motion(case).paths(corner, np.array([case.duration], dtype=Long))[0, 0].astype(float)
    row = place / np.hypot(*place)
    quarter = int(rng.integers(4))
    for _ in range(quarter):
        row = np.array([-row[1], row[0]])
    task = _tight_task(rng, row, float(row @ place))
    return (
        _blocked(replace(case, task=task), row, float(row @ place)) if rng.random() < 0.4 else replace(case, task=task)
    )


def _pieces(rng: Random) -> Case:
    """Obstacles of several convex pieces, which members pass at different distances."""
    case = _with_map(rng, _fleet(rng), 1.0, obstacles=1)
    some = tuple(_polygon(rng, case, 1.0, float(rng.uniform(0.05, 0.4))) for _ in range(int(rng.integers(2, 4))))
    return _tasked(rng, replace(case, obstacles={**case.obstacles, "several": some}), 1.0)


def _skewed(rng: Random) -> Case:
    """Parallelograms beside the way that are no rectangles."""
    case = _fleet(rng)
    place, along, _ = _seen(case, rng)
    first = rng.uniform(0.1, 0.5) * along
    second = rng.uniform(0.1, 0.5) * (np.array([-along[1], along[0]]) + float(rng.uniform(-2, 2)) * along)
    middle = place + second / 2 + (case.radius + _away(rng, 1.0)) * np.array([-along[1], along[0]])
    corners = [middle + a * first + b * second for a, b in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    case = replace(case, obstacles={"o0": (tuple((float(x), float(y)) for x, y in corners),)})
    return replace(case, task=_duties(rng, case)[0])


def _tight_task(rng: Random, row: Floats, level: float) -> Node:
    """A line across `row`; for all, or for the mean of the fleet."""
    leaf = ("pred", float(row[0]), float(row[1]), -level + float(rng.uniform(-1e-3, 1e-3)))
    task: Node = ("G", None, None, leaf)
    return ("mean", task) if rng.random() < 0.25 else task


def _blocked(case: Case, row: Floats, level: float) -> Case:
    """The same with the wide side of an obstacle in place of the line."""
    along, middle = np.array([-row[1], row[0]]), row * (level - 1e-2)
    corners = [middle + 50 * along, middle - 50 * along, middle - 50 * along - 9 * row, middle + 50 * along - 9 * row]
    polygon = tuple((float(x), float(y)) for x, y in corners)
    if min(row @ np.array(case.position) - (level - 1e-2), 1.0) <= 0:
        return case
    return replace(case, obstacles={"o": (polygon,)}, task=("G", None, None, ("avoid", "o")))


def _bulging(rng: Random) -> Case:
    """Arcs whose chords are parallel to a line or an obstacle's side that only their bulges come close to."""
    bulge = _pick(rng, (1e-5, 1e-4, 4e-4, 4.9e-4, 2e-3, 2e-2))
    dt, speed = _pick(rng, (0.1, 0.5, 1.0)), float(rng.uniform(0.5, 2.0))
    turn = 8 * bulge / (dt**2 * speed)
    steps, n = int(rng.integers(1, 4)), 0
    n = int(rng.integers(steps))
    kind = ({"linear_traction": 0.1}, {"angular_traction": 0.1}, {"start_heading": 0.02}, {"traction": 0.05})
    name, half = next(iter(kind[int(rng.integers(4))].items()))
    half *= _pick(rng, (0.0, 0.1, 1.0))
    middle = 0.0 if name == "start_heading" else 1.0
    distribution: Distribution = ("uniform", middle - half, middle + half)
    controls = tuple((speed, turn if k == n or rng.random() < 0.5 else 0.0) for k in range(steps))
    case = Case(
        "",
        "unicycle",
        "x",
        0.3,
        {name: distribution},
        (0.0, 0.0),
        float(rng.uniform(-3, 3)),
        0.0,
        dt * steps,
        controls,
        (),
    )
    ends = Motion(case).paths(np.array([[middle + half]]), dt * np.array([n, n + 1], dtype=Long))[0].astype(float)
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    row = np.array([-along[1], along[0]]) * (1.0 if rng.random() < 0.85 else -1.0)
    level = float(row @ ends[0]) - bulge
    leaf = ("pred", float(row[0]), float(row[1]), -level + float(rng.uniform(-1e-3, 1e-3)))
    window = (n * dt, (n + 1) * dt) if rng.random() < 0.7 else (None, None)
    case = replace(case, task=("G", *window, leaf))
    return _blocked(case, row, level) if rng.random() < 0.5 else case


FAMILIES: dict[str, tuple[float, Callable[[Random], Case]]] = {
    "plain": (14, _plain),
    "windows": (18, _windows),
    "nested": (14, _nested),
    "far": (8, _far),
    "scaled": (8, _scaled),
    "turning": (8, _turning),
    "ranged": (6, _ranged),
    "starts": (6, _starts),
    "moving": (7, _moving),
    "cars": (5, _cars),
    "shares": (5, _shares),
    "means": (4, _means),
    "touching": (5, _touching),
    "tight": (5, _tight),
    "bulging": (5, _bulging),
    "long": (0.2, _long),
    "together": (1, _together),
    "implied": (2, _implied),
    "returning": (0.5, _returning),
    "overtaken": (1, _overtaken),
    "reweighed": (0, _reweighed),
    "pieces": (0, _pieces),
    "cornered": (0, _cornered),
    "skewed": (0, _skewed),
    "spinning": (0, _spinning),
    "huge": (0, _huge),
}
"""Families of cases with how many of each there are, in parts; those with none are for faults put into the proof."""
