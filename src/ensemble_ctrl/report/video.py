"""Pictures one after the other as a GIF or a video."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable, Iterator
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING

import numpy as np

from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.report.palette import (
    GRID,
    INSIDE,
    INSIDE_KEEP_OUT,
    INSIDE_SLOW,
    KEEP_OUT,
    OBSTACLE,
    OBSTACLE_EDGE,
    OUTLINE,
    PATCH,
    PATCH_EDGE,
    REGION,
    SLOW,
    SOFT,
    viridis,
)

if TYPE_CHECKING:
    from PIL import Image

FORMATS = ("gif", "mp4")
HOLD = 1.5
"""Seconds for which the end is shown."""
RATES = {"gif": 12.5, "mp4": 25.0}
"""Pictures a second; a GIF's are a whole number of hundredths of a second apart."""


class AnimationError(EnsembleError):
    """The animation can't be made; nothing was written."""


def require(what: str, kind: str) -> None:
    """Refuse formats that can't be written here.

    Raises
    ------
    AnimationError
        For others than `FORMATS`, and for a video without ``ffmpeg``; `what` was requested.
    """
    if kind not in FORMATS:
        raise AnimationError(f"{what}: expected an animation as .gif or .mp4")
    if kind == "mp4" and shutil.which("ffmpeg") is None:
        raise AnimationError(f"{what}: a video needs the program ffmpeg, which was not found; a .gif needs nothing")


def write_gif(frames: Iterator[Image.Image], file: IO[bytes], colours: Iterable[str] = ()) -> None:
    """Frames in one palette, so that only what changes is stored; it has `colours` beside those of every map."""
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for colour in _colours(colours) for channel in colour])
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    each = round(1000 / RATES["gif"])
    # milliseconds of each frame, the last one held
    spans = [each] * (len(small) - 1) + [each + round(1000 * HOLD)]
    small[0].save(file, format="GIF", save_all=True, append_images=small[1:], duration=spans, loop=0, disposal=1)


def _colours(more: Iterable[str]) -> list[tuple[int, ...]]:
    """What is drawn, and its blends with white along edges."""
    from PIL import ImageColor

    areas = (OBSTACLE, OBSTACLE_EDGE, PATCH, PATCH_EDGE, REGION, INSIDE, SLOW, INSIDE_SLOW, KEEP_OUT, INSIDE_KEEP_OUT)
    named = [ImageColor.getrgb(name) for name in (OUTLINE, *areas, SOFT, GRID, "black", *more)]
    pure = np.concatenate([np.array(named), viridis(np.linspace(0, 1, 21)).astype(int)])
    # blends with white, as smoothed edges have them
    blends = [np.rint(share * pure + (1 - share) * 255).astype(int) for share in (1.0, 0.7, 0.4, 0.15)]
    far = [tuple(colour) for colour in np.concatenate(blends).tolist() if sum(colour) < 735]  # from the ground's white
    return [(255, 255, 255), *far]


def write_video(frames: Iterator[Image.Image], file: IO[bytes]) -> None:
    """Frames into ffmpeg as they are drawn; the last for a moment longer. It writes by the file's name."""
    frame = next(frames)
    rate = RATES["mp4"]
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{frame.width}x{frame.height}", "-r", f"{rate:g}", "-i", "-", "-an"]
    command += ["-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", file.name]
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
            raise AnimationError(f"ffmpeg could not write the video: {lines[-1] if lines else ffmpeg.returncode}")
