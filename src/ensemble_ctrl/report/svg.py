"""A small drawing for notebooks, written as text so that no plotting library is loaded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.replay import trajectories

Floats = NDArray[np.float64]

WIDTH = 320
"""Width of the drawing in pixels."""


def map_svg(problem: Problem, controls: Floats | None = None) -> str:
    """The map, and with `controls` the paths of seven members, as one SVG element."""
    paths = _paths(problem, controls)
    shapes = [p.vertices for _, p in problem.pieces] + [r.vertices for r in problem.regions.values()]
    everything = np.concatenate([problem.fleet.position[None, :], *shapes, *paths])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1e-6)
    low, span = low - 0.06 * span.max(), span + 0.12 * span.max()
    height = round(WIDTH * span[1] / span[0])

    def text(points: Floats) -> str:
        scaled = (points - low) / span * [WIDTH, -height] + [0, height]
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in scaled)

    parts = [f'<polygon points="{text(p.vertices)}" fill="#8a8f98"/>' for _, p in problem.pieces]
    parts += [
        f'<polygon points="{text(r.vertices)}" fill="#2166ac22" stroke="#2166ac"/>' for r in problem.regions.values()
    ]
    colours = [f"hsl({250 - 30 * i}, 60%, 45%)" for i in range(len(paths))]
    parts += [
        f'<polyline points="{text(path)}" fill="none" stroke="{c}"/>' for path, c in zip(paths, colours, strict=True)
    ]
    x, y = text(problem.fleet.position[None, :]).split(",")
    parts.append(f'<circle cx="{x}" cy="{y}" r="4"/>')
    body = "".join(parts)
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}">{body}</svg>'


def _paths(problem: Problem, controls: Floats | None) -> Sequence[Floats]:
    """Paths of seven members spread over the range."""
    if controls is None:
        return []
    law = problem.fleet.parameter
    return list(trajectories(problem, controls, np.linspace(law.lower, law.upper, 7)))
