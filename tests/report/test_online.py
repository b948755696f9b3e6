"""Pictures of a loop: the robot is where it was at the time, with the plan that it had then."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageColor

from ensemble_ctrl.report.map_content import map_contents
from ensemble_ctrl.report.online import DRIVEN, PLANNED, Reported, Run, write_run
from ensemble_ctrl.report.palette import LINES
from ensemble_ctrl.report.raster import HEAD, NARROW

from .plans import made


def run() -> Run:
    """One metre a second along x for 4 s; the plan of the second half leads away from that."""
    plan = made("plain")
    driven = np.column_stack([np.linspace(0, 4, 81), np.zeros(81)])
    ahead, away = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([[2.0, 0.0], [3.5, -2.0]])
    reported = [
        Reported(0.0, {"robot": ahead}, {"traction": (0.9, 1.1)}, 0.1, "new"),
        Reported(2.0, {"robot": away}, {"traction": (1, 1.1)}, 0.2, "kept"),
    ]
    paths = {"robot": driven}
    return Run(plan.problem, plan.controls, reported, paths, paths, 4.0, 0.2, {"traction": 1.0}, "how it ended")


def test_the_robot_and_its_newest_plan(tmp_path: Path) -> None:
    done = run()
    assert write_run(done, tmp_path) == ["online.png", "online.gif"]
    driven = done.driven["robot"]
    (content,) = map_contents(done.problem, driven[None])
    canvas = content.canvas(NARROW, top=HEAD, more=[path for step in done.reported for path in step.paths.values()])
    with Image.open(tmp_path / "online.gif") as video:
        frames = video.n_frames  # type: ignore[attr-defined]
        assert frames == 80
        for k in (10, 30, 60):
            video.seek(k)
            pixels = np.asarray(video.convert("RGB")).astype(int)
            x = canvas.at(driven[int(k * 80 / 79)])[0]
            dark = np.abs(pixels - ImageColor.getrgb(DRIVEN)).max(axis=2) < 30
            foremost = np.argwhere(dark[HEAD:-34])[:, 1].max()
            assert foremost == pytest.approx(x + 4, abs=2)  # a robot's dot is 4 wide
            side = canvas.at(np.array([3.0, -4 / 3])).round().astype(int)
            near = pixels[side[1] - 2 : side[1] + 3, side[0] - 2 : side[0] + 3]
            assert (np.abs(near - ImageColor.getrgb(PLANNED)).max(axis=2) < 60).any() == (k == 60)
    with Image.open(tmp_path / "online.png") as figure:
        assert figure.width == round(150 * (7.2 + 4.2))


def test_robots_have_colours_of_their_own_and_names(tmp_path: Path) -> None:
    alone = run()
    driven = {"ada": alone.driven["robot"], "ben": alone.driven["robot"] + [0.0, 0.5]}
    reported = [replace(step, paths=driven, ranges={"ada.traction": (0.9, 1.1)}) for step in alone.reported]
    write_run(replace(alone, driven=driven, reported=reported), tmp_path)
    with Image.open(tmp_path / "online.gif") as video:
        video.seek(40)
        pixels = np.asarray(video.convert("RGB")).astype(int)
    for colour in LINES[:2]:
        here = np.abs(pixels - ImageColor.getrgb(colour)).max(axis=2) < 30
        assert here[HEAD:-34].any()
        assert here[-30:].any()  # its name, below the map


def test_without_an_animation_there_is_a_figure(tmp_path: Path) -> None:
    assert write_run(run(), tmp_path, animated=False) == ["online.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["online.png"]
