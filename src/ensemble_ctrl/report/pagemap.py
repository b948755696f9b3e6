"""The map of a page as SVG: the certified tube, members that a script moves along, obstacles that move with them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import highest, outlines, target_lines
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.pagecharts import ticks
from ensemble_ctrl.report.palette import hexadecimal, shades, viridis
from ensemble_ctrl.report.tube import Ribbon
from ensemble_ctrl.report.view import Canvas, some, ways, window

Floats = NDArray[np.float64]

WIDTH = 560
"""Width of the map in its own units; the page scales it."""
MARGIN = (46, 34)
"""Room for numbers at the left and below."""
MEMBERS = 15
"""Members drawn."""
POINTS = 800
"""Points of a way at most."""
FRAMES = 200
"""Times between which the script interpolates, at most."""


def map_and_motion(
    problem: Problem, controls: Floats, ribbons: Sequence[Ribbon], marks: Sequence[tuple[str, Floats]] = ()
) -> tuple[str, str]:
    """The map as an ``<svg>`` element, and what moves on it as JSON for the page's script.

    Parameters
    ----------
    problem : Problem
        Whose map.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    ribbons : sequence of Ribbon
        The tube, if there is one.
    marks : sequence of (str, ndarray of shape (2,))
        What goes wrong, and where.
    """
    members = problem.fleet.spread(MEMBERS if problem.fleet.names else 1)
    paths = ways(problem, controls, members, 2)
    shown = some(paths.shape[1], POINTS)
    paths, times = paths[:, shown], np.linspace(0.0, problem.duration, paths.shape[1])[shown]
    areas = [outline for ribbon in ribbons for outline in ribbon.outlines]
    canvas = Canvas.around(*window(problem, [*paths, *areas]), WIDTH - MARGIN[0], MARGIN[0])
    colours = [hexadecimal(c) for c in viridis(shades(problem.fleet, members))]
    parts = [*_grid(canvas), *_places(problem, canvas, paths), *_tube(ribbons, canvas)]
    parts += [
        f'<polyline class="path" points="{_text(canvas, path)}" stroke="{colour}"/>'
        for path, colour in zip(paths, colours, strict=True)
    ]
    parts += [*_obstacles(problem, canvas), *_names(problem, canvas, paths), *_start(problem, canvas)]
    radius = max(4.0, problem.fleet.radius * canvas.scale)
    kind = "member" if radius < 8 else "member large"
    for path, colour in zip(paths, colours, strict=True):
        x, y = canvas.at(path[-1]).tolist()
        parts.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{colour}"/>')
    for text, place in marks:
        x, y = canvas.at(place).tolist()
        parts.append(f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="9"><title>{escape(text)}</title></circle>')
    size = f'viewBox="0 0 {WIDTH} {canvas.height + MARGIN[1]:.0f}"'
    label = escape(f"Map of {problem.name} with the ways of {len(members)} robots")
    svg = f'<svg id="map" {size} role="img" aria-label="{label}">{"".join(parts)}</svg>'
    return svg, _motion(problem, canvas, paths, times)


def _text(canvas: Canvas, points: Floats) -> str:
    """Drawing coordinates as SVG text."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in canvas.at(points).tolist())


def _motion(problem: Problem, canvas: Canvas, paths: Floats, times: Floats) -> str:
    """Duration, and tenths of a unit for every member and moving obstacle at every frame."""
    keep = some(paths.shape[1], FRAMES)
    paths, times = paths[:, keep], times[keep]
    members = np.rint(10 * canvas.at(paths)).astype(int)
    offsets = {
        name: np.rint(10 * canvas.scale * motion.at(times) * [1, -1]).astype(int).tolist()
        for name, motion in problem.motions.items()
    }
    data: dict[str, Any] = {"duration": problem.duration, "times": times.round(4).tolist()}
    data |= {"members": members.tolist(), "obstacles": offsets}
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _grid(canvas: Canvas) -> list[str]:
    """Lines every so many metres, with their numbers."""
    high = canvas.low + np.array([WIDTH - MARGIN[0], canvas.height]) / canvas.scale
    parts = []
    for value in ticks(float(canvas.low[0]), float(high[0]), 6):
        x = canvas.at(np.array([value, 0.0]))[0]
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{canvas.height:.1f}"/>')
        parts.append(f'<text class="mid" x="{x:.1f}" y="{canvas.height + 15:.1f}">{value:g}</text>')
    for value in ticks(float(canvas.low[1]), float(high[1]), 6):
        y = canvas.at(np.array([0.0, value]))[1]
        parts.append(f'<line class="grid" x1="{MARGIN[0]}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="end" x="{MARGIN[0] - 6}" y="{y + 4:.1f}">{value:g}</text>')
    parts.append(f'<text class="mid" x="{(WIDTH + MARGIN[0]) / 2}" y="{canvas.height + 31:.1f}">x [m]</text>')
    parts.append(f'<text class="mid" transform="translate(12 {canvas.height / 2:.1f}) rotate(-90)">y [m]</text>')
    return parts


def _places(problem: Problem, canvas: Canvas, paths: Floats) -> list[str]:
    """Regions and the target."""
    parts = []
    for name, corners in outlines(problem, list(paths)).items():
        points = _text(canvas, corners)
        parts.append(f'<polygon class="region" points="{points}"><title>{escape(name)}</title></polygon>')
    parts += [f'<polyline class="target" points="{_text(canvas, line)}"/>' for line in target_lines(problem)]
    if problem.objective.place is not None:
        x, y = canvas.at(problem.objective.place).tolist()
        parts.append(
            f'<path class="target" d="M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10"><title>target</title></path>'
        )
    return parts


def _names(problem: Problem, canvas: Canvas, paths: Floats) -> list[str]:
    """Names of regions above them, drawn over everything that lies still."""
    parts = []
    for name, corners in outlines(problem, list(paths)).items():
        x, y = canvas.at(highest(corners)).tolist()
        parts.append(f'<text class="mid name" x="{x:.1f}" y="{max(y - 4, 12):.1f}">{escape(name)}</text>')
    return parts


def _tube(ribbons: Sequence[Ribbon], canvas: Canvas) -> list[str]:
    """The areas of the tube."""
    return [
        f'<path class="tube" fill="{hexadecimal(viridis(ribbon.share))}" d="'
        + "".join(f"M{_text(canvas, outline)}Z" for outline in ribbon.outlines)
        + '"/>'
        for ribbon in ribbons
    ]


def _obstacles(problem: Problem, canvas: Canvas) -> list[str]:
    """Obstacles with their names; those that move are groups that the script moves, with their way dotted."""
    parts = []
    for name, pieces in problem.obstacles.items():
        motion = problem.motions.get(name)
        if motion is not None:
            way = pieces[0].vertices.mean(axis=0) + motion.at(np.linspace(0.0, problem.duration, 61))
            parts.append(f'<polyline class="way" points="{_text(canvas, way)}"/>')
        moves = "" if motion is None else f' data-moves="{escape(name)}"'
        shapes = "".join(f'<polygon points="{_text(canvas, piece.vertices)}"/>' for piece in pieces)
        largest = max(pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
        x, y = canvas.at(largest.vertices.mean(axis=0)).tolist()
        room = float(np.ptp(largest.vertices, axis=0).min()) * canvas.scale > 16
        text = f'<text class="mid" x="{x:.1f}" y="{y + 4:.1f}">{escape(name)}</text>' if room else ""
        parts.append(f'<g class="obstacle"{moves}><title>{escape(name)}</title>{shapes}{text}</g>')
    return parts


def _start(problem: Problem, canvas: Canvas) -> list[str]:
    """An arrow head at the start, in the direction of the heading."""
    x, y = canvas.at(problem.fleet.position).tolist()
    turn = f'transform="translate({x:.1f} {y:.1f}) rotate({-np.degrees(problem.fleet.heading):.1f})"'
    return [f'<path class="start" {turn} d="M9 0L-6 6L-3 0L-6 -6Z"><title>start</title></path>']
