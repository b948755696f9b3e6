"""Remarks on a problem's map files: how they were read, and that nothing is known beyond their edges."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.files.config.schema import ProblemFile
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import Finding

_HINT = "move it onto the map, or take a larger map"
NEAR = 1e-9
"""Metres by which a place may be beyond an edge: rounding."""


def map_notes(file: ProblemFile) -> Iterator[Finding]:
    """Warnings of how the maps of a problem file were read."""
    for name, shapes in file.obstacles.items():
        for i, shape in enumerate(shapes):
            for note in shape.content.notes if shape.content is not None else ():
                yield Finding(("obstacles", name, i, "file"), note, severity="warning")


def edge_findings(file: ProblemFile, problem: Problem) -> Iterator[Finding]:
    """A start, or a region as a whole, beyond the edge of every occupancy grid."""
    contents = [shape.content for shapes in file.obstacles.values() for shape in shapes]
    edges = [content.edge for content in contents if content is not None and content.edge is not None]
    if not edges:
        return
    import shapely

    known = shapely.union_all([shapely.Polygon(edge) for edge in edges])
    starts = _starts(problem)
    far = float(shapely.distance(known, shapely.points(starts)).max())
    if far > NEAR:
        middle = ", ".join(f"{x:g}" for x in starts.mean(axis=0))
        yield Finding(("fleet", "start", "position"), f"the start ({middle}) is {_beyond(far)}", _HINT)
    for name, region in problem.regions.items():
        if region.A.shape[1] != 2 or region.is_empty or not region.is_bounded:
            continue
        far = float(known.distance(_hull(region.vertices)))
        if far > NEAR:
            yield Finding(("regions", name), f"this region is {_beyond(far)}", _HINT, on_key=True)


def _starts(problem: Problem) -> NDArray[np.float64]:
    """Where the extreme members start, shape (members, 2), metres."""
    none = np.zeros((0, len(problem.fleet.system.controls)))
    fleets = [problem.fleet.at_start(name) for name in problem.fleet.starts] or [problem.fleet]
    begins = [fleet.trajectories(none, fleet.corners, problem.step)[:, 0][:, fleet.place_columns] for fleet in fleets]
    return np.concatenate(begins)


def _beyond(far: float) -> str:
    """How far out a place is."""
    return f"{far:.3g} m beyond the edge of the map, where nothing is known"


def _hull(corners: Any) -> Any:
    """The convex hull of some points."""
    import shapely

    return shapely.convex_hull(shapely.multipoints(np.asarray(corners)))
