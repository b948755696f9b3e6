"""Random and hostile cases of the features that came later, each made anew from a seed and an index."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from .. import cases as older
from ..arcs import Motion
from ..model import Case, Node, Polygon, ends_of
from .geometry import body_distance, distance
from .paths import driven, members_of, obedient
from .world import Disc, Errors, Featured, Patch, Shape, Zone

Random = np.random.Generator
FAR = (0.0, 0.0, 0.0, 1e3, 5e5, 1e7)
"""Metres from the origin."""
CORNERED = (0.0, 1e-12, 1e-9, 1e-6, 1e-3)
"""Metres by which a corner is off the line of its neighbours."""

ALWAYS: Node = ("F", None, None, ("pred", 1.0, 0.0, 1e9))
"""What every member does."""


def make(seed: int, index: int) -> Featured:
    """The case with this index; families take turns."""
    names = list(FAMILIES)
    return of_family(names[index % len(names)], np.random.default_rng([seed, index]))


def of_family(name: str, rng: Random) -> Featured:
    """A case of one family."""
    case = FAMILIES[name](rng)
    return replace(case, base=replace(case.base, family=name))


def _fleet(rng: Random, turn: float = 2.0, kinds: tuple[dict[str, float], ...] = older.NAMES) -> Featured:
    """A fleet with controls, without a map."""
    steps = int(rng.choice([1, 2, 3, 5, 8]))
    case = older._fleet(rng, steps=steps, turn=turn, origin=older._pick(rng, FAR), kinds=kinds)
    if rng.random() < 0.25:
        controls = tuple((v, float(np.clip(w, -0.6, 0.6))) for v, w in case.controls)
        case = replace(case, system="bicycle", controls=controls)
    if rng.random() < 0.2:  # headings about a half turn from +x
        case = replace(case, heading=float(rng.choice([-1, 1])) * np.pi + float(rng.uniform(-1e-3, 1e-3)))
    if rng.random() < 0.1 and "traction" in case.parameters:
        low = float(rng.choice([0.0, 1e-12, 1e-3]))
        case = replace(case, parameters={"traction": ("uniform", low, low + float(rng.choice([0.0, 1e-9, 0.3])))})
    return Featured(case)


def _shape(rng: Random, case: Case, size: float, disc: float = 0.3) -> Shape:
    """A polygon or a disc that a member passes closely, or is driven into."""
    polygon = older._polygon(rng, case, 1.0, size)
    if rng.random() < disc:
        return _round(polygon)
    if rng.random() < 0.15:
        return _nearly_flat(rng, polygon)
    return polygon


def _round(polygon: Polygon) -> Disc:
    """The disc about a polygon's middle."""
    corners = np.array(polygon)
    middle = corners.mean(axis=0)
    return float(middle[0]), float(middle[1]), float(np.hypot(*(corners - middle).T).min())


def _nearly_flat(rng: Random, polygon: Polygon) -> Polygon:
    """The same with one more corner, which is on a side but for so little."""
    (x0, y0), (x1, y1) = polygon[-1], polygon[0]
    share, off = float(rng.uniform(0.1, 0.9)), older._pick(rng, CORNERED)
    middle = np.mean(polygon, axis=0)
    corner = np.array([x0 + share * (x1 - x0), y0 + share * (y1 - y0)])
    away = corner - middle
    corner = corner + off * away / np.hypot(*away)
    return (*polygon, (float(corner[0]), float(corner[1])))


def _with_obstacles(rng: Random, case: Featured, most: int = 2, disc: float = 0.3) -> Featured:
    """Polygons and discs, some of them touching each other."""
    shapes = [_shape(rng, case.base, float(rng.uniform(0.1, 0.6)), disc) for _ in range(int(rng.integers(1, most + 1)))]
    rounds: dict[str, Disc] = {}
    polygons: dict[str, tuple[Polygon, ...]] = {}
    for k, shape in enumerate(shapes):
        if _holds_start(case, shape):
            continue
        if isinstance(shape[0], float):
            rounds[f"d{k}"] = shape
        else:
            polygons[f"o{k}"] = (shape,)
    return replace(case, base=replace(case.base, obstacles=polygons), discs=rounds)


def _holds_start(case: Featured, shape: Shape) -> bool:
    """Whether a member may be in a shape from the beginning."""
    _, _, headings, places = (np.asarray(part, float) for part in Motion(case.base).drives(_corners(case.base)))
    if case.footprint:
        away = body_distance(shape, np.array(case.footprint), places, headings)
    else:
        away = distance(shape, places)
    return bool(away.min() <= case.base.radius)


def _corners(case: Case) -> np.ndarray:
    """Members at the corners of the ranges."""
    return np.array(list(product(*map(ends_of, case.distributions.values())))).reshape(-1, len(case.distributions))


def _duties(rng: Random, case: Featured) -> list[Node]:
    """Each obstacle through a window of its own."""
    found: list[Node] = []
    for name in (*case.base.obstacles, *case.discs):
        window: tuple[float | None, float | None] = (None, None)
        if rng.random() < 0.5:
            window = older._window(rng, case.base, case.base.duration)
        found.append(("G", *window, ("avoid", name)))
    return found or [ALWAYS]


def _tasked(case: Featured, parts: list[Node]) -> Featured:
    """With a task of these parts."""
    return replace(case, base=replace(case.base, task=parts[0] if len(parts) == 1 else ("and", *parts)))


def _body(rng: Random) -> Polygon:
    """A convex footprint: a rectangle, or any; the planned point may be outside of it."""
    length, width = float(rng.uniform(0.2, 1.5)), float(rng.choice([1e-3, rng.uniform(0.1, 0.8)]))
    behind = float(rng.uniform(0.0, length)) if rng.random() < 0.8 else -0.3
    if rng.random() < 0.6:
        return tuple(
            (x, y)
            for x, y in ((-behind, -width), (length - behind, -width), (length - behind, width), (-behind, width))
        )
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
    angles[0], angles[-1] = 0.1, 5.0
    angles = np.append(angles, 2.5)
    angles.sort()
    return tuple((float(length * np.cos(t) - behind), float(width * np.sin(t))) for t in angles)


def _bodies(rng: Random) -> Featured:
    case = _fleet(rng, turn=older._pick(rng, (2.0, 6.0, 20.0)))
    case = replace(case, footprint=_body(rng))
    case = _with_obstacles(rng, case)
    if rng.random() < 0.3 and case.base.obstacles:
        name = next(iter(case.base.obstacles))
        offsets = rng.uniform(-1, 1, (3, 2))
        times = (0.0, float(rng.uniform(0.1, 0.9)) * case.base.duration, case.base.duration)
        motion = times, tuple((float(x), float(y)) for x, y in offsets)
        case = replace(case, base=replace(case.base, motions={name: motion}))
    return _tasked(case, _duties(rng, case))


def _leaf(rng: Random, case: Featured) -> Node:
    """A predicate on signals near what a member has at some time, or on places."""
    if rng.random() < 0.3 or case.errors.delay or case.errors.jitter:
        return older._leaf(rng, replace(case.base, obstacles={}), 1.0)
    each = 16
    paths = driven(case, members_of(case, rng, 1), obedient(1, len(case.base.controls), each), each)
    n = int(rng.integers(paths.rates["v"].shape[1]))
    now = {name: float(value[0, n]) for name, value in paths.rates.items()} | {"heading": float(paths.heading[0, n])}
    named = {"v": "v", "omega": "omega", "heading": "heading"} | (
        {"delta": "second"} if case.base.system == "bicycle" else {}
    )
    name = str(rng.choice(list(named)))
    away = older._away(rng, 1.0)
    if name == "heading" and rng.random() < 0.7:
        half = float(rng.choice([1e-6, 0.1, 1.0, 3.0, 3.14159]))
        centre = now["heading"] + float(rng.choice([-1.0, 1.0])) * (half + away)
        return ("within", "heading", half, float(np.arctan2(np.sin(centre), np.cos(centre))))
    if rng.random() < 0.25:
        other = str(rng.choice([o for o in named if o != name]))
        factors: tuple[tuple[str, float], ...] = (
            (name, float(rng.choice([-1.0, 1.0, 2.0]))),
            (other, float(rng.choice([-1.0, 0.5]))),
        )
    else:
        factors = ((name, float(rng.choice([-1.0, 1.0]))),)
    return ("signal", factors, away - sum(factor * now[named[what]] for what, factor in factors))


def _formula(rng: Random, case: Featured, depth: int, most: float) -> Node:
    """A formula that looks ahead by at most `most` seconds."""
    kind = rng.random()
    if depth == 0 or kind < 0.1:
        return _leaf(rng, case)
    if kind < 0.35:
        return (str(rng.choice(["and", "or"])), *(_formula(rng, case, depth - 1, most) for _ in range(2)))
    if kind < 0.45:
        return ("not", _formula(rng, case, depth - 1, most))
    window: tuple[float | None, float | None] = (None, None)
    left = most
    if rng.random() < 0.7:
        window = older._window(rng, case.base, most if depth == 1 else most * float(rng.uniform(0.2, 0.8)))
        left = max(most - float(window[1] or 0.0) - 1e-9, 0.0)
    if kind < 0.55:
        return ("U", *window, *(_formula(rng, case, depth - 1, left) for _ in range(2)))
    return (str(rng.choice(["F", "G"])), *window, _formula(rng, case, depth - 1, left))


def _outer(rng: Random, case: Featured, depth: int) -> Node:
    """A formula that is no conjunction."""
    part = _formula(rng, case, depth, case.base.duration)
    return ("G", None, None, _leaf(rng, case)) if part[0] == "and" else part


def _signals(rng: Random) -> Featured:
    case = _fleet(rng, turn=older._pick(rng, (0.5, 2.0, 8.0)))
    return _tasked(case, [_outer(rng, case, int(rng.integers(1, 4)))])


def _with_zones(rng: Random, case: Featured, keep_out: float = 0.25) -> Featured:
    """Areas with limits near the members' own speeds."""
    zones = {}
    a = (
        max(
            abs(end)
            for name in case.base.parameters
            for end in ends_of(case.base.parameters[name])
            if "traction" in name
        )
        if any("traction" in name for name in case.base.parameters)
        else 1.0
    )
    for k in range(int(rng.integers(1, 3))):
        shapes = tuple(_shape(rng, case.base, float(rng.uniform(0.1, 1.0))) for _ in range(int(rng.integers(1, 3))))
        v = abs(case.base.controls[int(rng.integers(len(case.base.controls)))][0]) * a
        speed = None if rng.random() < keep_out else max(v + older._away(rng, 1.0), 1e-3)
        zones[f"z{k}"] = Zone(shapes, speed)
    return replace(case, zones=zones)


def _zones(rng: Random) -> Featured:
    case = _with_zones(rng, _fleet(rng))
    return _tasked(case, [ALWAYS])


def _apart(rng: Random) -> Featured:
    case = _fleet(rng, kinds=(*older.NAMES[:4], older.NAMES[5]))
    count = int(rng.integers(2, 5))
    places = rng.uniform(-1, 1, (count, 2)) * older._pick(rng, (0.3, 1.0, 1e4))
    case = replace(case, starts={f"s{k}": (float(x), float(y)) for k, (x, y) in enumerate(places)})
    least = min(float(np.hypot(*(places[i] - places[j]))) for i in range(count) for j in range(i))
    parts: list[Node] = []
    for _ in range(int(rng.integers(1, 3))):
        window: tuple[float | None, float | None] = (None, None)
        if rng.random() < 0.6:
            window = older._window(rng, case.base, case.base.duration)
        parts.append(("G", *window, ("apart", max(least - abs(older._away(rng, 1.0)), 1e-6))))
    parts.append(("F", None, None, _leaf(rng, case)) if rng.random() < 0.5 else ALWAYS)
    return _tasked(case, parts)


def _discs(rng: Random) -> Featured:
    case = _with_obstacles(rng, _fleet(rng), disc=1.0)
    parts = _duties(rng, case)
    leaf: Node = ("avoid", str(rng.choice(list(case.discs)))) if case.discs else ALWAYS
    parts.append(
        (
            str(rng.choice(["F", "G"])),
            *older._window(rng, case.base, case.base.duration),
            ("or", leaf, _leaf(rng, case)),
        )
    )
    return _tasked(case, parts)


def _errors(rng: Random, case: Featured, timely: bool) -> Errors:
    """Some errors of the model."""
    size = older._pick(rng, (1e-6, 1e-3, 1e-2, 0.1))
    step = case.base.duration / len(case.base.controls)
    kept = rng.random(8) < 0.4
    names = [name for name in case.base.parameters if "traction" in name]
    varies = {names[0]: min(size, 1.0)} if names and kept[0] else {}
    place = size if kept[1] else 0.0
    sides = (0.5 * size, size) if kept[2] else (0.0, 0.0)
    found = Errors(
        place, *sides, size if kept[3] else 0.0, size if kept[4] else 0.0, size if kept[5] else 0.0, varies=varies
    )
    found = replace(found, share=min(size, 0.3) if kept[6] else 0.0)
    kind = rng.random()
    if timely or kind < 0.5:
        return found if kind > 0.2 else replace(found, hold=older._pick(rng, (0.1, 1.0, 10.0)))
    late = min(step * older._pick(rng, (0.1, 0.25, 1.0, 2.5)), case.base.duration) if kind < 0.85 else 0.0
    return replace(found, delay=late, jitter=step * older._pick(rng, (0.1, 0.25, 0.5)) if kind > 0.7 else 0.0)


def _uncertain(rng: Random) -> Featured:
    case = _fleet(rng)
    case = _with_obstacles(rng, replace(case, errors=_errors(rng, case, timely=False)))
    parts = _duties(rng, case)
    if rng.random() < 0.6:
        parts.append(_outer(rng, case, int(rng.integers(1, 3))))
    return _tasked(case, parts)


def _patches(rng: Random, case: Featured) -> dict[str, Patch]:
    """Areas on the way, some of which overlap, with factors that may be other, also those that the fleet has not."""
    found = {}
    for k in range(int(rng.integers(1, 4))):
        shapes = tuple(_shape(rng, case.base, float(rng.uniform(0.1, 1.0))) for _ in range(int(rng.integers(1, 3))))
        name = str(rng.choice(["traction", "linear_traction", "angular_traction"]))
        low = float(rng.choice([0.3, 0.8, 0.99, 1.0, 1.05]))
        found[f"p{k}"] = Patch(shapes, {name: (low, low + float(rng.choice([0.0, 1e-6, 0.1, 0.5])))})
    return found


def _terrain(rng: Random) -> Featured:
    case = _fleet(rng)
    case = replace(case, terrain=_patches(rng, case))
    if rng.random() < 0.4:
        case = replace(case, errors=_errors(rng, case, timely=rng.random() < 0.5))
    untimely = case.errors.delay or case.errors.jitter
    if rng.random() < 0.4 and not untimely:
        case = _with_zones(rng, case)
        return _tasked(case, [_outer(rng, case, 1)])
    case = _with_obstacles(rng, case)
    parts = _duties(rng, case)
    if rng.random() < 0.5:
        parts.append(_outer(rng, case, int(rng.integers(1, 3))))
    return _tasked(case, parts)


def _drifting(rng: Random) -> Featured:
    """Straight ways to a line, or a limit of a signal, with one error: bounds are sharp."""
    steps, dt, size = int(rng.integers(1, 5)), older._pick(rng, (0.2, 0.5, 1.0)), older._pick(rng, (1e-3, 1e-2, 0.05))
    speed, angle = float(rng.uniform(0.5, 2.0)) * float(rng.choice([-1.0, 1.0])), float(rng.uniform(-3, 3))
    low = float(rng.uniform(0.8, 1.2))
    ranges = ("uniform", low, low + older._pick(rng, (0.0, 1e-3, 0.1)))
    name = str(rng.choice(["traction", "linear_traction", "angular_traction"]))
    turn = older._pick(rng, (0.0, 0.0, 0.01))
    controls = ((speed, turn),) * steps
    base = Case("", "unicycle", "x", 0.3, {name: ranges}, (0.0, 0.0), angle, 0.0, steps * dt, controls, ALWAYS)
    kind = str(
        rng.choice(["place", "x", "y", "heading", "first", "second", "share", "varies", "delay", "jitter", "ground"])
    )
    case = Featured(base)
    if kind == "ground":
        area: Polygon = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
        patch = Patch((area,), {str(rng.choice(["traction", "linear_traction"])): (low - size, low + size)})
        case = replace(case, terrain={"ground": patch})
    else:
        given: Any = {name: size} if kind == "varies" else dt * 0.4 if kind in ("delay", "jitter") else size
        case = replace(case, errors=replace(Errors(), **{kind: given}))
        if kind in ("heading", "second") and rng.random() < 0.4:
            case = replace(case, errors=replace(case.errors, hold=0.1))
    ways = [(float(np.cos(angle + k * np.pi / 2)), float(np.sin(angle + k * np.pi / 2))) for k in range(4)]
    leaf: Node = ("pred", *ways[int(rng.integers(4))], 0.0)
    if kind not in ("delay", "jitter") and rng.random() < 0.3:
        leaf = ("signal", ((str(rng.choice(["v", "omega", "heading"])), float(rng.choice([-1.0, 1.0]))),), 0.0)
    end = base.duration if rng.random() < 0.8 else 0.5 * base.duration
    return _tasked(case, [("G", end, base.duration, leaf)])


FAMILIES: dict[str, Callable[[Random], Featured]] = {
    "bodies": _bodies,
    "signals": _signals,
    "zones": _zones,
    "apart": _apart,
    "discs": _discs,
    "uncertain": _uncertain,
    "terrain": _terrain,
    "drifting": _drifting,
}
"""Families of cases."""
