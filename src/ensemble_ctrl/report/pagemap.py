"""The map of a page as SVG: the certified tube, members that a script moves along, obstacles that move with them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import Conflict
from ensemble_ctrl.problem.evaluation.sampled import all_paths, headings
from ensemble_ctrl.report.errors import patch_text
from ensemble_ctrl.report.map_content import MapContent, View, map_contents, moved_bodies
from ensemble_ctrl.report.pagecharts import ticks
from ensemble_ctrl.report.palette import hexadecimal, shades, viridis
from ensemble_ctrl.report.text import conflict_text
from ensemble_ctrl.report.transform import Canvas, some
from ensemble_ctrl.report.tube import Ribbon

Floats = NDArray[np.float64]

WIDTH = 560
"""Width of the map in its own units; the page scales it."""
MARGIN = (46, 40)
"""Room for numbers at the left and below."""
MEMBERS = 15
"""Members drawn."""
POINTS = 800
"""Points of a way at most."""
FRAMES = 200
"""Times between which the script interpolates, at most."""


def map_and_motion(
    problem: Problem,
    controls: Floats,
    tubes: Mapping[View | None, Sequence[Ribbon]],
    marks: Sequence[tuple[Conflict, Floats]] = (),
) -> tuple[str, str]:
    """The map as ``<svg>`` elements, one for each view, and what moves on them as JSON for the page's script.

    Parameters
    ----------
    problem : Problem
        Whose map.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    tubes : mapping of (int, int) or None to sequence of Ribbon
        The tube in each view, if there is one.
    marks : sequence of (Conflict, ndarray of shape (d,))
        What goes wrong, and where.
    """
    members = problem.fleet.spread(MEMBERS if problem.fleet.names else 1)
    paths, members = all_paths(problem, controls, members, 2)
    shown = some(paths.shape[1], POINTS)
    times = np.linspace(0.0, problem.duration, paths.shape[1])[shown]
    colours = [hexadecimal(c) for c in viridis(shades(problem.fleet, members))]
    turned = headings(problem, controls, members, 2)
    ends = [None] * len(paths) if turned is None else turned[:, -1].tolist()
    drawings, tracks, offsets = [], [], dict[str, Any]()
    keep = some(len(shown), FRAMES)
    for content in map_contents(problem, paths):
        ribbons = tubes.get(content.view, ())
        ways = content.paths[:, shown]
        areas = [outline for ribbon in ribbons for outline in ribbon.outlines]
        areas += [] if turned is None else moved_bodies(problem, ways, turned[:, shown])
        canvas = content.canvas(WIDTH - MARGIN[0], MARGIN[0], more=areas)
        drawings.append(_svg(content, canvas, ways, colours, ribbons, marks, ends))
        # whole tenths of a drawing unit keep the JSON short
        tracks += np.rint(10 * canvas.at(ways[:, keep])).astype(int).tolist()
        for shape in content.obstacles:
            if shape.motion is not None:
                # displacements in tenths of a drawing unit, y downwards
                moved = 10 * canvas.scale * shape.motion.at(times[keep]) * [1, -1]
                offsets[shape.name] = np.rint(moved).astype(int).tolist()
    data: dict[str, Any] = {"duration": problem.duration, "times": times[keep].round(4).tolist()}
    data |= {"members": tracks, "obstacles": offsets}
    if turned is not None:
        # tenths of a degree, clockwise as the drawing turns
        data["headings"] = np.rint(-10 * np.degrees(turned[:, shown][:, keep])).astype(int).tolist()
    return "".join(drawings), json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _svg(
    content: MapContent,
    canvas: Canvas,
    paths: Floats,
    colours: Sequence[str],
    ribbons: Sequence[Ribbon],
    marks: Sequence[tuple[Conflict, Floats]],
    turns: Sequence[float | None],
) -> str:
    """One view of the map."""
    parts = [*_grid(content, canvas), *_places(content, canvas), *_tube(ribbons, canvas)]
    parts += [
        f'<polyline class="path" points="{_text(canvas, path)}" stroke="{colour}"/>'
        for path, colour in zip(paths, colours, strict=True)
    ]
    parts += [*_obstacles(content, canvas), *_names(content, canvas), *_start(content, canvas)]
    radius = max(4.0, content.radius * canvas.scale)
    kind = "member" if radius < 8 else "member large"
    for path, colour, heading in zip(paths, colours, turns, strict=True):
        x, y = canvas.at(path[-1]).tolist()
        if heading is None:
            parts.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{colour}"/>')
        else:
            parts.append(_body(content, canvas, (x, y), heading, colour))
    for conflict, place in marks:
        x, y = canvas.at(content.at(place, conflict.time)).tolist()
        title = f"<title>{escape(conflict_text(conflict))}</title>"
        parts.append(f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="9">{title}</circle>')
    size = f'viewBox="0 0 {WIDTH} {canvas.height + MARGIN[1]:.0f}"'
    seen = f", seen along {content.hidden}" if content.hidden else ""
    label = escape(f"Map of {content.problem.name} with the ways of {len(paths)} robots{seen}")
    return f'<svg class="map" {size} role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _body(content: MapContent, canvas: Canvas, place: tuple[float, float], heading: float, colour: str) -> str:
    """A robot's body, which the script moves by its transform."""
    body = content.problem.fleet.footprint
    corners = [] if body is None else (body.corners * [canvas.scale, -canvas.scale]).tolist()
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    turn = f"translate({place[0]:.1f} {place[1]:.1f}) rotate({-np.degrees(heading):.1f})"
    return f'<polygon class="member body" transform="{turn}" points="{points}" fill="{colour}"/>'


def _text(canvas: Canvas, points: Floats) -> str:
    """Drawing coordinates as SVG text."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in canvas.at(points).tolist())


def _grid(content: MapContent, canvas: Canvas) -> list[str]:
    """Lines every so many metres or seconds, with their numbers and labels."""
    # upper right corner of the map in metres, for round ticks
    high = canvas.low + np.array([(WIDTH - MARGIN[0]) / canvas.across, canvas.height / canvas.scale])
    parts = []
    for value in ticks(float(canvas.low[0]), float(high[0]), 6):
        x = canvas.at(np.array([value, 0.0]))[0]
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{canvas.height:.1f}"/>')
        parts.append(f'<text class="mid" x="{x:.1f}" y="{canvas.height + 16:.1f}">{value:g}</text>')
    for value in ticks(float(canvas.low[1]), float(high[1]), 6):
        y = canvas.at(np.array([0.0, value]))[1]
        parts.append(f'<line class="grid" x1="{MARGIN[0]}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="end" x="{MARGIN[0] - 6}" y="{y + 4:.1f}">{value:g}</text>')
    across, up = map(escape, content.labels)
    parts.append(f'<text class="mid" x="{(WIDTH + MARGIN[0]) / 2}" y="{canvas.height + 34:.1f}">{across}</text>')
    parts.append(f'<text class="mid" transform="translate(12 {canvas.height / 2:.1f}) rotate(-90)">{up}</text>')
    return parts


def _places(content: MapContent, canvas: Canvas) -> list[str]:
    """Patches of terrain, regions and the target."""
    parts = _patches(content, canvas)
    for name, corners in content.regions.items():
        rule, points = _rule(content, name), _text(canvas, corners)
        kind = f"zone {rule}" if rule else "region"
        parts.append(f'<polygon class="{kind}" points="{points}"><title>{escape(name)}</title></polygon>')
    parts += [f'<polyline class="target" points="{_text(canvas, line)}"/>' for line in content.lines]
    if content.target is not None:
        x, y = canvas.at(content.target).tolist()
        parts.append(
            f'<path class="target" d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10"><title>target</title></path>'
        )
    return parts


def _rule(content: MapContent, name: str) -> str:
    """The class of a zone's rule in the style sheet; empty for a region without one."""
    zone = content.zones.get(name)
    if zone is None:
        return ""
    return "keep-out" if zone.speed is None else "slow"


def _patches(content: MapContent, canvas: Canvas) -> list[str]:
    """Patches of terrain with their names, and the ranges in them as titles."""
    parts = []
    for shape in content.patches:
        title = escape("; ".join([shape.name, *patch_text(content.problem.terrain[shape.name])]))
        polygons = "".join(f'<polygon points="{_text(canvas, corners)}"/>' for corners in shape.pieces)
        x, y = canvas.at(shape.largest.mean(axis=0)).tolist()
        name = f'<text class="mid" x="{x:.1f}" y="{y + 4:.1f}">{escape(shape.name)}</text>'
        parts.append(f'<g class="patch"><title>{title}</title>{polygons}{name}</g>')
    return parts


def _names(content: MapContent, canvas: Canvas) -> list[str]:
    """Names of regions above them, of zones in them at the top, drawn over everything that lies still."""
    parts = []
    for name, place in content.tags.items():
        x, y = canvas.at(place).tolist()
        rule = _rule(content, name)
        kind, y = (f"mid name {rule}", y + 17) if rule else ("mid name", max(y - 4, 12))
        parts.append(f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{escape(name)}</text>')
    return parts


def _tube(ribbons: Sequence[Ribbon], canvas: Canvas) -> list[str]:
    """The areas of the tube."""
    return [
        f'<path class="tube" fill="{hexadecimal(viridis(ribbon.share))}" d="'
        + "".join(f"M{_text(canvas, outline)}Z" for outline in ribbon.outlines)
        + '"/>'
        for ribbon in ribbons
    ]


def _obstacles(content: MapContent, canvas: Canvas) -> list[str]:
    """Obstacles with their names; those that move are groups that the script moves, with their way dotted."""
    parts = []
    for shape in content.obstacles:
        name, moves = escape(shape.name), ""
        if shape.motion is not None:
            times = np.linspace(0.0, content.problem.duration, 61)
            way = shape.pieces[0].mean(axis=0) + shape.motion.at(times)
            parts.append(f'<polyline class="way" points="{_text(canvas, way)}"/>')
            moves = f' data-moves="{name}"'
        kinds = (' class="beside"' if beside else "" for beside in shape.beside)
        polygons = "".join(
            f'<polygon{kind} points="{_text(canvas, corners)}"/>'
            for corners, kind in zip(shape.pieces, kinds, strict=True)
        )
        x, y = canvas.at(shape.largest.mean(axis=0)).tolist()
        room = float(np.ptp(shape.largest, axis=0).min()) * canvas.scale > 16 and not all(shape.beside)
        text = f'<text class="mid" x="{x:.1f}" y="{y + 4:.1f}">{name}</text>' if room else ""
        parts.append(f'<g class="obstacle"{moves}><title>{name}</title>{polygons}{text}</g>')
    return parts


def _start(content: MapContent, canvas: Canvas) -> list[str]:
    """An arrow head at each start, in the direction of the heading, with the body; a disk where there is none."""
    parts = [f'<polygon class="standing" points="{_text(canvas, corners)}"/>' for corners in content.standing]
    for name, place in content.starts.items():
        (x, y), title = canvas.at(place).tolist(), f"<title>{escape(name)}</title>"
        if content.heading is None:
            parts.append(f'<circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="5">{title}</circle>')
        else:
            turn = f'transform="translate({x:.1f} {y:.1f}) rotate({-np.degrees(content.heading):.1f})"'
            parts.append(f'<path class="start" {turn} d="M9 0L-6 6L-3 0L-6 -6Z">{title}</path>')
    for name, place in content.named_starts.items():
        x, y = canvas.at(place).tolist()
        parts.append(f'<text class="mid begin" x="{x:.1f}" y="{y + 20:.1f}">{escape(name)}</text>')
    return parts
