"""What a drawing of a map shows, and the map as SVG text, so that a notebook shows it without a plotting library."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.target import Formation, SpreadTarget

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

WIDTH = 320
"""Width of the drawing in pixels."""
TALLEST, FLATTEST = 2.0, 0.3
"""Most and least height, in widths."""


def map_svg(problem: Problem, paths: Sequence[Floats] = ()) -> str:
    """Obstacles, regions and start, and the paths of some members.

    Parameters
    ----------
    problem : Problem
        Whose map.
    paths : sequence of ndarray, shape (times, 2)
        Positions of one member each, in metres.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    start = problem.fleet.position[None, :]
    obstacles = [piece.vertices for _, piece in problem.pieces]
    regions = list(outlines(problem, paths).values())
    low, span = frame([start, *obstacles, *regions, *paths])
    height = round(WIDTH * span[1] / span[0])

    def text(points: Floats) -> str:
        scaled = (points - low) / span * [WIDTH, -height] + [0, height]
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in scaled)

    parts = [f'<polygon points="{text(corners)}" fill="#8a8f98"/>' for corners in obstacles]
    parts += [
        f'<polygon points="{text(corners)}" fill="#2166ac" fill-opacity="0.13" stroke="#2166ac"/>'
        for corners in regions
    ]
    parts += [
        f'<polyline points="{text(path)}" fill="none" stroke="hsl({250 - 30 * i}, 60%, 45%)"/>'
        for i, path in enumerate(paths)
    ]
    x, y = text(start).split(",")
    parts.append(f'<circle cx="{x}" cy="{y}" r="4"/>')
    size = f'width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}"'
    ground = f'<rect width="{WIDTH}" height="{height}" fill="white"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{ground}{"".join(parts)}</svg>'


def outlines(problem: Problem, paths: Sequence[Floats] = ()) -> dict[str, Floats]:
    """Corners of every region by name; of an unbounded one, the part near everything else that is drawn.

    Parameters
    ----------
    problem : Problem
        Whose regions.
    paths : sequence of ndarray, shape (times, 2)
        What else is drawn, in metres.

    Returns
    -------
    dict of str to ndarray, shape (corners, 2)
        Without regions that are nowhere near.
    """
    bounded = {name: region.vertices for name, region in problem.regions.items() if region.is_bounded}
    drawn = [piece.vertices for _, piece in problem.pieces] + [*bounded.values(), *paths]
    low, size = frame([problem.fleet.position[None, :], *drawn])
    window = (low - 0.1 * size - 0.5, low + 1.1 * size + 0.5)
    parts = {name: region if name in bounded else _within(region, *window) for name, region in problem.regions.items()}
    return {name: part.vertices for name, part in parts.items() if not part.is_empty}


def target_lines(problem: Problem) -> list[Floats]:
    """Where the fleet should end, as lines of shape (points, 2) in metres.

    A formation's places; of mean and covariance the ellipse of one standard deviation. One place, and moments, have no
    line.
    """
    target = problem.objective.target
    if isinstance(target, Formation):
        return [target.places]
    if isinstance(target, SpreadTarget):
        values, vectors = np.linalg.eigh(target.covariance)
        turn = np.linspace(0, 2 * np.pi, 65)
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return [target.mean + circle * np.sqrt(np.maximum(values, 0.0)) @ vectors.T]
    return []


def highest(corners: Floats) -> Floats:
    """The middle of an area's highest corners, where its name belongs, shape (2,)."""
    top = corners[:, 1].max()
    return np.asarray(corners[corners[:, 1] > top - 1e-3 * np.ptp(corners[:, 1])].mean(axis=0))


def _within(region: Polyhedron, low: Floats, high: Floats) -> Polyhedron:
    """The part of a region in a box."""
    A = np.vstack([region.A, np.eye(2)])
    return Polyhedron(A, np.concatenate([region.lower, low]), np.concatenate([region.upper, high]))


def frame(shapes: Iterable[Floats]) -> tuple[Floats, Floats]:
    """Lower left corner and size of what is drawn: everything with a border, neither too tall nor too flat."""
    points = np.concatenate(list(shapes))
    low, high = points.min(axis=0), points.max(axis=0)
    border = 0.06 * max(float((high - low).max()), 1e-3)
    middle, size = (low + high) / 2, high - low + 2 * border
    size = np.array([max(size[0], size[1] / TALLEST), max(size[1], size[0] * FLATTEST)])
    return middle - size / 2, size
