"""What of a problem file can be dragged: areas, start and target as places of the file with numbers in metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.problem.drawing import shadow

Data = dict[str, Any]
Place = list[str | int]
SECTIONS = {"obstacles": "obstacle", "regions": "region", "zones": "zone", "terrain": "patch"}
"""Sections of areas, and what one of them is called."""
FORMS = ("box", "polygon")
"""Forms that are lists of numbers."""
STATES = ("x", "y", "z")
"""States that are coordinates of the position, for systems whose start is given state by state."""
_LENGTH, _ANGLE = quantity("length"), quantity("angle")


def shapes(data: Any, problem: Problem | None) -> list[Data]:
    """The areas of a file.

    Parameters
    ----------
    data : plain data
        Of the file's text, whether or not it is a problem.
    problem : Problem or None
        The problem, for what is in files or half-planes.

    Returns
    -------
    list of dict
        ``kind``, ``name``, ``path`` of the form's numbers in the file; ``form``: box, polygon, disc, or fixed for what
        the text alone can change; ``points``: for a box ``[[low, high], ...]``, for a polygon its corners, for a disc
        its centre, metres; ``radius`` of a disc; ``pieces``: what is drawn of fixed ones.
    """
    found = []
    for section, kind in SECTIONS.items():
        named = _section(data, section)
        for name, given in named.items():
            several = [_form(shape, path) for shape, path in _listed(given, [section, name])]
            if any(shape["form"] == "fixed" for shape in several):
                found.append(_fixed(kind, section, name, problem))
            else:
                found += [{"kind": kind, "name": name, **shape} for shape in several]
    return found


def start(data: Any) -> Data | None:
    """Where the fleet starts, if that is in the file as numbers.

    Returns
    -------
    dict or None
        ``at``, metres; ``path`` of the position, and ``paths`` of its coordinates where each has its own entry;
        ``heading`` in radians from +x, or None; whether the file counts it ``clockwise`` from +y.
    """
    given = _section(_section(data, "fleet"), "start")
    alone = [name for name in STATES if name in given] if "position" not in given else []
    at = _numbers([given[name] for name in alone] or given.get("position"), _LENGTH)
    if at is None or len(at) < 2:
        return None
    above = ["fleet", "start"]
    paths = [[*above, name] for name in alone] or None
    turned = _number(given.get("heading"), _ANGLE)
    clockwise = given.get("heading_from") == "y"
    if turned is not None and clockwise:
        turned = np.pi / 2 - turned
    place = {"at": at, "path": [*above, "position"], "paths": paths}
    return {**place, "heading": turned, "clockwise": clockwise}


def starts(data: Any) -> list[Data]:
    """Where members start beside the fleet's own start, if both are in the file as numbers.

    Returns
    -------
    list of dict
        ``name``, as the planner calls it; ``at``, metres; ``by``: the fleet's start, from which the file counts it;
        ``path`` of the offset, which is its ``entry`` too.
    """
    own, given = start(data), _section(data, "fleet").get("starts")
    named = {f"s{k + 1}": (k, row) for k, row in enumerate(given)} if isinstance(given, list) else {}
    if isinstance(given, dict):
        named = {str(name): (name, row) for name, row in given.items()}
    found = []
    for name, (key, row) in named.items():
        offset = _numbers(row, _LENGTH)
        if own is None or offset is None or len(offset) != len(own["at"]):
            return []
        path: Place = ["fleet", "starts", key]
        at = [round(a + b, 9) for a, b in zip(own["at"], offset, strict=True)]
        found.append({"name": name, "at": at, "by": own["at"], "path": path, "entry": path})
    return found


def target(data: Any) -> Data | None:
    """Where the fleet should end, if that is one place in the file."""
    terminal = _section(_section(data, "objective"), "terminal")
    at = _numbers(terminal.get("target"), _LENGTH)
    return None if at is None or len(at) < 2 else {"at": at, "path": ["objective", "terminal", "target"]}


def _listed(given: Any, path: Place) -> list[tuple[Any, Place]]:
    """The shapes of one name with their paths: one, a list, or a section's ``areas``."""
    if isinstance(given, dict) and isinstance(given.get("areas"), list):
        given, path = given["areas"], [*path, "areas"]
    if isinstance(given, list):
        return [(shape, [*path, i]) for i, shape in enumerate(given)]
    return [(given, path)]


def _form(shape: Any, path: Place) -> Data:
    """An area's form with its numbers; fixed, where they can't be read."""
    shape = shape if isinstance(shape, dict) else {}
    for form in FORMS:
        rows = shape.get(form)
        points = [_numbers(row, _LENGTH) for row in rows] if isinstance(rows, list) else [None]
        if all(row is not None and len(row) == 2 for row in points) and len(points) > 1:
            return {"form": form, "entry": path, "path": [*path, form], "points": points}
    disc = _section(shape, "disc")
    center, radius = _numbers(disc.get("center"), _LENGTH), _number(disc.get("radius"), _LENGTH)
    if center is not None and len(center) == 2 and radius is not None:
        return {"form": "disc", "entry": path, "path": [*path, "disc"], "points": [center], "radius": radius}
    return {"form": "fixed"}


def _fixed(kind: str, section: str, name: str, problem: Problem | None) -> Data:
    """An area that only the text can change, with what is drawn of it."""
    pieces = [] if problem is None else [corners.tolist() for corners in _corners(problem, kind, name)]
    entry = [section, name]
    return {"kind": kind, "name": name, "entry": entry, "path": entry, "form": "fixed", "points": [], "pieces": pieces}


def _corners(problem: Problem, kind: str, name: str) -> Iterator[Any]:
    """Outlines of the convex pieces from above."""
    if kind == "region":
        region = problem.regions.get(name)
        if region is not None and region.is_bounded and region.vertices.shape[1] > 1:
            yield shadow(region.vertices)
        return
    zone, patch = problem.zones.get(name), problem.terrain.get(name)
    pieces: Any = {
        "obstacle": problem.obstacles.get(name, ()),
        "zone": () if zone is None else zone.pieces,
        "patch": () if patch is None else patch.pieces,
    }[kind]
    yield from (shadow(piece.vertices) for piece in pieces)


def _section(data: Any, key: str) -> Data:
    """A section of the data; empty where there is none."""
    found = data.get(key) if isinstance(data, dict) else None
    return found if isinstance(found, dict) else {}


def _numbers(values: Any, read: Any) -> list[float] | None:
    """A list of numbers in SI units; None where one can't be read."""
    numbers = [_number(value, read) for value in values] if isinstance(values, list) else [None]
    return None if not numbers or None in numbers else [float(n) for n in numbers if n is not None]


def _number(value: Any, read: Any) -> float | None:
    """A number in SI units."""
    try:
        return float(read(value))
    except (EnsembleError, ValueError, TypeError):
        return None
