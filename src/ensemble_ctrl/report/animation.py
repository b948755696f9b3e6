"""The fleet on its way, as a GIF or a video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.storage import whole_file
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import all_paths, headings
from ensemble_ctrl.report.map_content import moved_bodies
from ensemble_ctrl.report.palette import shades, viridis
from ensemble_ctrl.report.raster import FINE, NARROW, Raster
from ensemble_ctrl.report.video import RATES, AnimationError, require, write_gif, write_video

if TYPE_CHECKING:
    from PIL import Image

Floats = NDArray[np.float64]

SECONDS = 6.0
"""Seconds that an animation runs, however long the plan is."""
LONGEST = 120.0
WIDTH = {"gif": NARROW, "mp4": 660}
"""Pixels."""
MEMBERS = 21
"""Robots shown."""


def animate(problem: Problem, controls: Floats, path: Path, seconds: float = SECONDS) -> Path:
    """Write an animation of the fleet under its broadcast commands.

    Parameters
    ----------
    problem : Problem
        Map and fleet.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    path : Path
        The file, ``.gif`` or ``.mp4``; written whole or not at all.
    seconds : float
        How long it runs, whatever the plan's own duration; the end is shown for a moment longer.

    Raises
    ------
    AnimationError
        For another ending, a length that is none, and for a video where there is no ``ffmpeg``.
    """
    path = Path(path)
    kind = path.suffix[1:].lower()
    require(str(path), kind)
    if not 0 < seconds <= LONGEST:
        raise AnimationError(f"seconds: expected more than 0 and at most {LONGEST:g}, got {seconds:g}")
    times = np.linspace(0.0, problem.duration, max(2, round(seconds * RATES[kind]) + 1))
    frames = _frames(problem, controls, times, WIDTH[kind])
    with whole_file(path) as file:
        (write_gif if kind == "gif" else write_video)(frames, file)
    return path


def _frames(problem: Problem, controls: Floats, times: Floats, width: int) -> Iterator[Image.Image]:
    """A picture for each time; trails grow on one that is kept."""
    from PIL import ImageDraw

    fleet = problem.fleet
    paths, members = all_paths(problem, controls, fleet.spread(MEMBERS if fleet.names else 1), 2)
    turned = headings(problem, controls, members, 2)
    bodies = [] if turned is None else moved_bodies(problem, paths, turned)
    raster = Raster.of(problem, paths, width, more=bodies)
    colours = [tuple(colour) for colour in viridis(shades(fleet, members)).tolist()]
    ground = raster.ground()
    grid = np.linspace(0.0, problem.duration, raster.panels[0].content.paths.shape[1])
    along = [(panel, panel.content.paths, _along(panel.content.paths, grid, times)) for panel in raster.panels]
    seen = 0
    for k, time in enumerate(times):
        # trails are added to the ground, which is kept; robots are drawn on a copy of it
        upto = int(np.searchsorted(grid, time, side="right"))
        pen = ImageDraw.Draw(ground)
        for panel, paths, places in along:
            for i, colour in enumerate(colours):
                # grid positions since the previous frame, and the interpolated one at `time`
                trail = np.concatenate([paths[i, max(seen - 1, 0) : upto], places[i, k : k + 1]])
                pen.line(panel.points(trail), fill=colour, width=FINE, joint="curve")
        seen = upto
        frame = ground.copy()
        pen = ImageDraw.Draw(frame)
        raster.draw_now(pen, float(time))
        for panel, _, places in along:
            for i, (place, colour) in enumerate(zip(places[:, k], colours, strict=True)):
                heading = None if turned is None else float(np.interp(time, grid, turned[i]))
                panel.robot(pen, place, colour, heading)
        yield frame.reduce(FINE)


def _along(paths: Floats, grid: Floats, times: Floats) -> Floats:
    """Places at some times, shape (members, times, 2), linear between those of the grid."""
    # p(t_n) + share (p(t_n+1) - p(t_n)) on the grid's interval of each time
    at = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, len(grid) - 2)
    share = ((times - grid[at]) / (grid[at + 1] - grid[at]))[:, None]
    return np.asarray(paths[:, at] + share * (paths[:, at + 1] - paths[:, at]))
