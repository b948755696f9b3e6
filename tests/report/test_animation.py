"""Animations: the right length, small, with the fleet where it is at each time."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from ensemble_ctrl.files.folder import result_files
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.animation import WIDTH
from ensemble_ctrl.report.map_content import map_contents
from ensemble_ctrl.report.raster import HEAD
from ensemble_ctrl.report.transform import Canvas
from ensemble_ctrl.report.video import FORMATS, AnimationError

from .plans import made


@pytest.mark.parametrize("kind", ["plain", "several", "equal", "moving", "bicycle", "unbounded", "spread", "formation"])
def test_a_gif_of_every_kind_of_plan(kind: str, tmp_path: Path) -> None:
    path = made(kind).animate(tmp_path / "a.gif", seconds=1.0)
    with Image.open(path) as picture:
        frames = picture.n_frames  # type: ignore[attr-defined]
        spans = []
        for k in range(frames):
            picture.seek(k)
            spans.append(picture.info["duration"])
    assert sum(spans) == pytest.approx(1000 + 80 + 1500, abs=90)
    assert picture.width == WIDTH["gif"]
    assert path.stat().st_size < 200_000
    assert list(tmp_path.iterdir()) == [path]


def test_robots_are_where_they_are_at_the_time(tmp_path: Path) -> None:
    """The foremost of what differs from the first picture is the robot, against its exact position."""
    plan = made("equal")
    path = plan.animate(tmp_path / "a.gif", seconds=4.0)
    way = trajectories(plan.problem, plan.controls, np.zeros((1, 0)), 2)
    (content,) = map_contents(plan.problem, way)
    canvas = content.canvas(WIDTH["gif"], top=HEAD)
    with Image.open(path) as picture:
        first = _map(picture, 0, canvas)
        for frame in (10, 25, 40):
            changed = np.abs(_map(picture, frame, canvas) - first).max(axis=2) > 40
            rows, columns = np.nonzero(changed)
            expected = canvas.at(way[0, 2 * round(40 * frame * 0.08 / 4)])
            ahead = columns > columns.max() - 8
            assert columns[ahead].mean() == pytest.approx(expected[0], abs=2)
            assert rows[ahead].mean() + HEAD == pytest.approx(expected[1], abs=2)


def _map(picture: Image.Image, frame: int, canvas: Canvas) -> NDArray[np.int64]:
    """One picture's pixels, without what is above and below the map."""
    picture.seek(frame)
    return np.asarray(picture.convert("RGB")).astype(np.int64)[HEAD : HEAD + round(canvas.height)]


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="no ffmpeg here")
def test_a_film(tmp_path: Path) -> None:
    path = made("equal").animate(tmp_path / "a.mp4", seconds=0.6)
    ask = ["ffprobe", "-v", "error", "-show_entries", "stream=nb_frames,pix_fmt", "-of", "csv=p=0", str(path)]
    pixels, frames = subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip().split(",")
    assert pixels == "yuv420p"  # what browsers and phones play
    assert int(frames) == pytest.approx(0.6 * 25 + 1 + 1.5 * 25, abs=2)
    assert list(tmp_path.iterdir()) == [path]


def test_a_film_needs_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(AnimationError, match="needs the program ffmpeg, which was not found"):
        made("equal").animate(tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_what_ffmpeg_says_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "bin" / "ffmpeg"
    broken.parent.mkdir()
    broken.write_text("#!/bin/sh\necho 'no codec here' >&2\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{broken.parent}:/bin:/usr/bin")
    with pytest.raises(AnimationError, match="no codec here"):
        made("equal").animate(tmp_path / "a.mp4", seconds=0.2)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]


@pytest.mark.parametrize(("name", "seconds"), [("a.avi", 1.0), ("a", 1.0), ("a.gif", 0.0), ("a.gif", float("nan"))])
def test_what_can_not_be_made_is_refused(tmp_path: Path, name: str, seconds: float) -> None:
    with pytest.raises(AnimationError, match=r"expected (an animation as|more than 0)"):
        made("equal").animate(tmp_path / name, seconds)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"none/a\.gif"):
        made("equal").animate(tmp_path / "none" / "a.gif", seconds=0.2)


def test_what_animate_writes_may_be_overwritten() -> None:
    assert {f"animation.{ending}" for ending in FORMATS} <= result_files()
