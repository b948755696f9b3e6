"""Poses in problem files: what they add to the task, what is planned, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.ocp.guesses.aimed import final_heading
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from tests.paths import ROOT

FILE = ROOT / "configs" / "vehicles" / "terminal_pose.yaml"


def test_a_file_means_the_task_with_both_written_out() -> None:
    problem = ec.load(FILE)
    written = str(problem.task)
    assert written.startswith(
        "F[3,7] (in(gate) and heading within 0.26179938779914946 of 90 deg) and G avoid(obstacles)"
    )
    assert written.endswith("and heading within 10 deg of 0)")
    assert problem.objective.place == pytest.approx([2.6, 2.2])
    again = ec.load_text(dump(problem), "again")
    assert again.task == problem.task
    assert dump(again) == dump(problem)
    assert final_heading(problem) == 0.0


def test_every_member_passes_the_gate_and_ends_in_the_pose(tmp_path: Path) -> None:
    assert invoke([str(FILE), "-o", str(tmp_path / "p"), "--no-plots", "-q"]) == 0
    plan = ec.Plan.load(tmp_path / "p")
    members = np.linspace(0.97, 1.03, 7)[:, None]
    paths = trajectories(plan.problem, plan.controls, members, 10)
    turned = np.concatenate([[0.0], np.cumsum(np.repeat(plan.controls[:, 1], 10)) * 0.02])
    headings = members * turned
    assert np.abs(paths[:, -1] - [2.6, 2.2]).max() <= 0.25
    assert np.abs(np.angle(np.exp(1j * headings[:, -1]))).max() <= np.radians(10)
    window = slice(150, 351)
    low, high = [1.2, 0.9], [1.8, 1.3]
    inside = ((paths[:, window] >= low) & (paths[:, window] <= high)).all(axis=2)
    upwards = np.abs(headings[:, window] - np.pi / 2) <= np.radians(15)
    assert (inside & upwards).any(axis=1).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[75 deg, 105 deg]", "[105 deg, 75 deg]", "regions.gate.heading: expected [low, high]"),
        ("[75 deg, 105 deg]", "[0, 360 deg]", "regions.gate.heading: expected a range above 0 deg and below 360 deg"),
        ("heading: 10 deg}", "heading: 0 deg}", "a tolerance of the heading above 0 deg and below 180 deg, got 0 deg"),
        ("position: 25 cm", "position: 0 cm", "expected a tolerance of the position above 0 m, got 0"),
        (", tolerances: {position: 25 cm, heading: 10 deg}", "", "but tolerances is missing"),
        ("robustness: 1\n", "robustness: 1\n  earliest: gate\n", "and region 'gate' has a heading"),
        ("model: unicycle", "model: double_integrator", "expected none, since the double_integrator has no heading"),
        ('task: "F[3,7]', 'task: "G[9,10] heading within 5 deg of 90 deg and F[3,7]', "nothing does both at 10 s"),
    ],
)
def test_what_is_wrong_is_said_at_its_place(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = FILE.read_text().replace(old, new, 1)
    if "double_integrator" in new:
        text = text.replace("position: [0, 0], heading: 0 deg", "position: [0, 0]").replace("traction:", "mass:")
        text = text.replace("  input_bounds: {v: [-0.5, 1], omega: [-1, 1]}\n", "")
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    assert invoke(["check", str(file)]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert "bad.yaml:" in printed


def test_a_pose_from_python_is_checked() -> None:
    with pytest.raises(ProblemError, match="above 0 m, got -1"):
        ec.Pose(np.zeros(2), 0.0, -1.0, 0.1)
    with pytest.raises(ProblemError, match="below 180 deg, got 200 deg"):
        ec.Pose(np.zeros(2), 0.0, 1.0, np.radians(200))
