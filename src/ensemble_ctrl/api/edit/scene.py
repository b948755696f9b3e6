"""A problem's map as data that a page draws without editing it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ensemble_ctrl.api.edit.drawing import FRAMES, surroundings
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.starts import places
from ensemble_ctrl.report.map_content import map_contents

Data = dict[str, Any]


def scene(problem: Problem) -> Data:
    """A drawing without a plan: the views of a map as `ensemble_ctrl.api.edit.drawing.drawing` has them."""
    times = np.linspace(0.0, problem.duration, FRAMES)
    standing = np.array([[place] for place in places(problem).values()])
    still: Data = {"ways": [], "tube": [], "marks": [], "counter": None}
    return {
        "duration": problem.duration,
        "times": times.tolist(),
        "colours": [],
        "members": [],
        "scale": None,
        "radius": problem.fleet.radius,
        "views": [{**still, **surroundings(content, times)} for content in map_contents(problem, standing)],
    }


def ground(problem: Problem, areas: Sequence[Data]) -> Data:
    """The map below everything else, in the first view.

    Parameters
    ----------
    problem : Problem
    areas : sequence of dict
        Areas of a view, each with its ``kind``, ``name`` and ``corners``.
    """
    pieces: dict[tuple[str, str], list[Any]] = {}
    for area in areas:
        pieces.setdefault((area["kind"], area["name"]), []).append(area["corners"])
    standing = np.array([[place] for place in places(problem).values()])
    content = map_contents(problem, standing)[0]
    start, target = next(iter(content.starts.values())), content.target
    plane = len(problem.fleet.places) != 1
    return {
        "name": problem.name,
        "shapes": [
            {"kind": kind, "name": name, "form": "fixed", "points": [], "pieces": several}
            for (kind, name), several in pieces.items()
        ],
        "start": {"at": start.tolist(), "heading": content.heading} if plane and len(content.starts) == 1 else None,
        "target": None if target is None or not plane else {"at": target.tolist()},
        "plane": plane,
    }
