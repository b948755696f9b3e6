"""The fleet on its way, as a GIF or a film: drawn with Pillow at twice the size and made smaller, which is fast."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.drawing import highest, outlines, target_lines
from ensemble_ctrl.errors import EnsembleError
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.palette import OBSTACLE, OBSTACLE_EDGE, REGION, shades, viridis
from ensemble_ctrl.report.text import unit_of
from ensemble_ctrl.report.view import Canvas, require_map, ways, window

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont

Floats = NDArray[np.float64]

FORMATS = ("gif", "mp4")
SECONDS = 6.0
"""Seconds that an animation runs, however long the plan is."""
LONGEST = 120.0
HOLD = 1.5
"""Seconds for which the end is shown."""
RATES = {"gif": 12.5, "mp4": 25.0}
"""Pictures a second; a GIF's are a whole number of hundredths of a second apart."""
WIDTH = {"gif": 440, "mp4": 660}
"""Pixels."""
HEAD, FOOT = 26, 34
"""Pixels above the map, for name and time, and below it, for the scales; at a width of 440."""
MEMBERS = 21
"""Robots shown."""
FINE = 2
"""Times the size at which is drawn."""
OUTLINE, INSIDE = "#33373d", "#dfe8f2"
"""Of robots, and of regions."""


class AnimationError(EnsembleError):
    """The animation can't be made; nothing was written."""


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
        For another ending, a length that is none, and for a film where there is no ``ffmpeg``.
    UnsupportedError
        For a fleet that follows a differential equation.
    """
    require_map(problem, "an animation")
    path = Path(path)
    kind = path.suffix[1:].lower()
    require(str(path), kind)
    if not 0 < seconds <= LONGEST:
        raise AnimationError(f"seconds: expected more than 0 and at most {LONGEST:g}, got {seconds:g}")
    times = np.linspace(0.0, problem.duration, max(2, round(seconds * RATES[kind]) + 1))
    frames = _frames(problem, controls, times, WIDTH[kind])
    part = path.with_name(f".{path.name}.part")
    try:
        (_write_gif if kind == "gif" else _write_film)(frames, part)
        os.replace(part, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        part.unlink(missing_ok=True)
    return path


def require(what: str, kind: str) -> None:
    """Refuse formats that can't be written here.

    Raises
    ------
    AnimationError
        For others than `FORMATS`, and for a film without ``ffmpeg``; `what` was asked for.
    """
    if kind not in FORMATS:
        raise AnimationError(f"{what}: expected an animation as .gif or .mp4")
    if kind == "mp4" and shutil.which("ffmpeg") is None:
        raise AnimationError(f"{what}: a film needs the program ffmpeg, which was not found; a .gif needs nothing")


@dataclass(frozen=True, eq=False)
class _Stage:
    """What the drawing functions share: the canvas in fine pixels, a unit of the layout, and the font."""

    canvas: Canvas
    unit: float
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont
    size: tuple[int, int]

    def points(self, places: Floats) -> list[tuple[float, float]]:
        """Fine pixels of places of shape (n, 2)."""
        return [(x, y) for x, y in self.canvas.at(places).tolist()]


def _frames(problem: Problem, controls: Floats, times: Floats, width: int) -> Iterator[Image.Image]:
    """A picture for each time; trails grow on one that is kept."""
    from PIL import ImageDraw

    fleet = problem.fleet
    members = fleet.spread(MEMBERS if fleet.names else 1)
    paths = ways(problem, controls, members, 2)
    grid = np.linspace(0.0, problem.duration, paths.shape[1])
    stage = _stage(problem, paths, width)
    colours = [tuple(colour) for colour in viridis(shades(fleet, members)).tolist()]
    ground = _ground(problem, stage, list(paths))
    places = _along(paths, grid, times)
    seen = 0
    for k, time in enumerate(times):
        upto = int(np.searchsorted(grid, time, side="right"))
        pen = ImageDraw.Draw(ground)
        for i, colour in enumerate(colours):
            trail = np.concatenate([paths[i, max(seen - 1, 0) : upto], places[i, k : k + 1]])
            pen.line(stage.points(trail), fill=colour, width=FINE, joint="curve")
        seen = upto
        frame = ground.copy()
        pen = ImageDraw.Draw(frame)
        _draw_moving(problem, stage, pen, float(time))
        radius = max(4.0 * stage.unit, fleet.radius * stage.canvas.scale)
        for (x, y), colour in zip(stage.points(places[:, k]), colours, strict=True):
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), colour, OUTLINE, 1)
        text = f"t = {time:.1f} s"
        pen.text((stage.size[0] - 8 * stage.unit, 5 * stage.unit), text, "black", stage.font, anchor="ra")
        yield frame.reduce(FINE)


def _stage(problem: Problem, paths: Floats, width: int) -> _Stage:
    """The layout; film and GIF need even sizes."""
    from PIL import ImageFont

    unit = FINE * width / WIDTH["gif"]
    low, size = window(problem, list(paths))
    canvas = Canvas.around(low, size, FINE * width, top=HEAD * unit)
    height = 2 * ceil((canvas.height + (HEAD + FOOT) * unit) / FINE / 2)
    return _Stage(canvas, unit, ImageFont.load_default(13 * unit), (FINE * width, FINE * height))


def _ground(problem: Problem, stage: _Stage, paths: Sequence[Floats]) -> Image.Image:
    """What does not move."""
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", stage.size, "white")
    pen = ImageDraw.Draw(picture)
    for corners in outlines(problem, paths).values():
        pen.polygon(stage.points(corners), INSIDE, REGION, FINE)
    for name, pieces in problem.obstacles.items():
        if name not in problem.motions:
            for piece in pieces:
                pen.polygon(stage.points(piece.vertices), OBSTACLE, OBSTACLE_EDGE, FINE)
    for name, corners in outlines(problem, paths).items():
        ((x, y),) = stage.points(highest(corners)[None])
        low = y - 3 * stage.unit > (HEAD + 10) * stage.unit
        pen.text(
            (x, y - 3 * stage.unit if low else y + 3 * stage.unit), name, REGION, stage.font, "mb" if low else "mt"
        )
    for line in target_lines(problem):
        pen.line(stage.points(line), "black", FINE)
    _draw_start(problem, stage, pen)
    _draw_frame(problem, stage, pen)
    return picture


def _draw_start(problem: Problem, stage: _Stage, pen: ImageDraw.ImageDraw) -> None:
    """An arrow head in the direction of the heading."""
    heading, unit = problem.fleet.heading, stage.unit
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    head = np.array([[8.0, 0.0], [-6.0, 5.0], [-6.0, -5.0]]) * unit @ turn.T
    ((x, y),) = stage.points(problem.fleet.position[None])
    pen.polygon([(x + dx, y - dy) for dx, dy in head.tolist()], "black")


def _draw_frame(problem: Problem, stage: _Stage, pen: ImageDraw.ImageDraw) -> None:
    """The name above, and below the colours of the first parameter and a length."""
    unit, (width, height) = stage.unit, stage.size
    pen.rectangle((0, 0, width, (HEAD - 1) * unit), "white")
    pen.rectangle((0, height - (FOOT - 1) * unit, width, height), "white")
    pen.text((8 * unit, 5 * unit), _short(problem.name), "black", stage.font, anchor="la")
    y = height - 12 * unit
    metres = _round_length(0.25 * width / stage.canvas.scale)
    x = width - 10 * unit
    pen.line((x - metres * stage.canvas.scale, y, x, y), "black", 2 * FINE)
    pen.text((x - metres * stage.canvas.scale - 6 * unit, y), f"{metres:g} m", "black", stage.font, anchor="rm")
    fleet = problem.fleet
    if fleet.names and fleet.upper[0] > fleet.lower[0]:
        name, post = fleet.names[0], unit_of(fleet.names[0])
        pen.text((8 * unit, y), f"{name} {fleet.lower[0]:.3g}", "black", stage.font, anchor="lm")
        begin = 16 * unit + pen.textlength(f"{name} {fleet.lower[0]:.3g}", stage.font)
        steps = 16
        for k, colour in enumerate(viridis(np.linspace(0, 1, steps)).tolist()):
            left = begin + k * 5 * unit
            pen.rectangle((left, y - 5 * unit, left + 5 * unit, y + 5 * unit), tuple(colour))
        right = begin + (5 * steps + 8) * unit
        pen.text((right, y), f"{fleet.upper[0]:.3g}{post}", "black", stage.font, anchor="lm")


def _draw_moving(problem: Problem, stage: _Stage, pen: ImageDraw.ImageDraw, time: float) -> None:
    """Obstacles that move, where they are, and the names of all."""
    for name, pieces in problem.obstacles.items():
        motion = problem.motions.get(name)
        offset = np.zeros(2) if motion is None else motion.at(time)
        for piece in pieces if motion is not None else ():
            pen.polygon(stage.points(piece.vertices + offset), OBSTACLE, OBSTACLE_EDGE, FINE)
        largest = max(pieces, key=lambda piece: float(np.ptp(piece.vertices, axis=0).prod()))
        if float(np.ptp(largest.vertices, axis=0).min()) * stage.canvas.scale > 14 * stage.unit:
            ((x, y),) = stage.points((largest.vertices.mean(axis=0) + offset)[None])
            pen.text((x, y), name, "white", stage.font, anchor="mm")


def _along(paths: Floats, grid: Floats, times: Floats) -> Floats:
    """Places at some times, shape (members, times, 2), linear between those of the grid."""
    at = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, len(grid) - 2)
    share = ((times - grid[at]) / (grid[at + 1] - grid[at]))[:, None]
    return np.asarray(paths[:, at] + share * (paths[:, at + 1] - paths[:, at]))


def _round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a length."""
    size = 10.0 ** floor(log10(metres))
    return next(m * size for m in (5, 2, 1) if m * size <= metres * (1 + 1e-9))


def _short(name: str) -> str:
    """A name that leaves room for the time."""
    return name if len(name) <= 40 else name[:39] + "…"


def _write_gif(frames: Iterator[Image.Image], path: Path) -> None:
    """Frames in one palette, so that only what changes is stored."""
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for colour in _colours() for channel in colour])
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    each = round(1000 / RATES["gif"])
    spans = [each] * (len(small) - 1) + [each + round(1000 * HOLD)]
    small[0].save(path, format="GIF", save_all=True, append_images=small[1:], duration=spans, loop=0, disposal=1)


def _colours() -> list[tuple[int, ...]]:
    """What is drawn, and its blends with white along edges."""
    from PIL import ImageColor

    named = [ImageColor.getrgb(name) for name in (OUTLINE, OBSTACLE, OBSTACLE_EDGE, REGION, INSIDE, "black")]
    pure = np.concatenate([np.array(named), viridis(np.linspace(0, 1, 21)).astype(int)])
    blends = [np.rint(share * pure + (1 - share) * 255).astype(int) for share in (1.0, 0.7, 0.4, 0.15)]
    far = [tuple(colour) for colour in np.concatenate(blends).tolist() if sum(colour) < 735]  # from the ground's white
    return [(255, 255, 255), *far]


def _write_film(frames: Iterator[Image.Image], path: Path) -> None:
    """Frames into ffmpeg as they are drawn; the last for a moment longer."""
    frame = next(frames)
    rate = RATES["mp4"]
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{frame.width}x{frame.height}", "-r", f"{rate:g}", "-i", "-", "-an"]
    command += ["-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(path)]
    with (
        TemporaryFile() as said,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said) as ffmpeg,
    ):
        assert ffmpeg.stdin is not None
        try:
            ffmpeg.stdin.write(frame.tobytes())
            for frame in frames:
                ffmpeg.stdin.write(frame.tobytes())
            ffmpeg.stdin.write(frame.tobytes() * round(HOLD * rate))
            ffmpeg.stdin.close()
        except BrokenPipeError:
            pass  # it has ended, and says why
        if ffmpeg.wait():
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines()
            raise AnimationError(f"ffmpeg could not write the film: {lines[-1] if lines else ffmpeg.returncode}")
