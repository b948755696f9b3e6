"""What logs say of robots, against robots that are run with known factors and disturbances."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import yaml

from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.cli.identify import identify_log, read_log
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem.evaluation.disturbed import disturbed, drawn
from ensemble_ctrl.problem.evaluation.identified import RobotLog, identify
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.certificate.test_disturbance import CONTROLS, STEPS, problem

TRUE = Uncertainty({"position": 0.02, "heading": 0.05})


def logs(bounds: Uncertainty, robots: int = 6) -> tuple[dict[str, RobotLog], np.ndarray]:
    """Logs of robots that are disturbed, and their factors."""
    ranges = {"linear_traction": Interval(0.8, 1.0), "angular_traction": Interval(0.9, 1.2)}
    fleet = Fleet(Unicycle(), ranges, [0.3, 0.1], 0.4, uncertainty=bounds)
    whole = problem(bounds, fleet=fleet)
    members = fleet.sample(robots, 0)
    settings = drawn(whole, robots, STEPS, 0)
    paths = disturbed(whole, CONTROLS, members, settings)
    # headings from the turn rates: those of the model and the disturbance of each step
    k = 0 if bounds else None
    push = 0.0 if k is None else bounds.disturbance["heading"] * settings[:, k]
    turns = np.cumsum(whole.step * (members[:, 1:] * CONTROLS[:, 1] + push), axis=1)
    headings = 0.4 + np.concatenate([np.zeros((robots, 1)), turns], axis=1)
    poses = np.concatenate([paths, np.mod(headings, 2 * np.pi)[..., None]], axis=2)
    commands = np.concatenate([CONTROLS, CONTROLS[-1:]])
    return {str(n): RobotLog(whole.times, commands, pose) for n, pose in enumerate(poses)}, members


def test_robots_that_follow_their_model_are_known_exactly() -> None:
    found, members = logs(Uncertainty())
    result = identify(Unicycle(), found)
    np.testing.assert_allclose(result.linear, [members[:, 0].min(), members[:, 0].max()], atol=1e-7)
    np.testing.assert_allclose(result.angular, [members[:, 1].min(), members[:, 1].max()], atol=1e-7)
    assert max(result.uncertainty.disturbance.values()) < 1e-6


def test_disturbances_are_explained_by_no_more_than_they_are() -> None:
    found, members = logs(TRUE)
    result = identify(Unicycle(), found)
    for name, bound in TRUE.disturbance.items():
        assert 0.5 * bound < result.uncertainty.disturbance[name] < 1.05 * bound
    assert result.robots == 6
    # a factor is off by what a disturbance can hide at the largest rate
    slack = TRUE.disturbance["heading"] / np.abs(CONTROLS[:, 1]).max()
    np.testing.assert_allclose(result.angular, [members[:, 1].min(), members[:, 1].max()], atol=slack)


def test_a_file_becomes_a_section(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, _ = logs(TRUE, 2)
    lines = ["robot,t [s],v [m/s],omega [rad/s],x,y,heading"]
    for name, log in found.items():
        lines += [
            ",".join([name, *map(repr, [float(t), *map(float, u), *map(float, pose)])])
            for t, u, pose in zip(log.times, log.controls, log.poses, strict=True)
        ]
    path = tmp_path / "runs.csv"
    path.write_text("\n".join(lines))
    assert identify_log(path, "unicycle", None, False) == 0
    section = yaml.safe_load(capsys.readouterr().out)["fleet"]
    low, high = section["parameters"]["linear_traction"]["range"]
    whole = identify(Unicycle(), read_log(path, Unicycle()))
    assert low <= whole.linear[0] <= whole.linear[1] <= high
    assert (
        float(section["uncertainty"]["disturbance"]["position"].split()[0]) >= whole.uncertainty.disturbance["position"]
    )
    path.write_text("\n".join([*lines[:5], "0,oops,0,0,0,0,0"]))
    with pytest.raises(ProblemError, match=r"runs.csv:6: expected a (finite )?number for "):
        read_log(path, Unicycle())
    with pytest.raises(ProblemError, match=r"got none called 'delta'"):
        read_log(path, Bicycle())


def test_a_robot_that_stands_says_nothing() -> None:
    still = RobotLog(np.arange(4.0), np.zeros((4, 2)), np.zeros((4, 3)))
    with pytest.raises(ProblemError, match="never turns"):
        identify(Unicycle(), {"one": still})


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,1,0,0,0,0"], "expected 3 rows or more of the robot, got 1"),
        (
            ["1,1,0,0,0,0", "0.5,1,0,0,0,0", "2,1,0,0,0,0"],
            "expected times of the robot that increase, got 0.5 s",
        ),
        (
            ["0,0,0,0,0,0", "1,0,0,0,0,0", "2,0,0,0,0,0"],
            "expected robots that drive and turn, got one: the robot",
        ),
    ],
)
def test_a_log_that_explains_nothing_is_named(tmp_path: Path, rows: list[str], message: str) -> None:
    path = tmp_path / "short.csv"
    path.write_text("\n".join(["t,v,omega,x,y,heading", *rows]))
    with pytest.raises(ProblemError) as caught:
        identify_log(path, "unicycle", None, False)
    assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize(("name", "unit"), [("t", "ms"), ("v", "km/h"), ("omega", "deg/s"), ("heading", "deg")])
def test_a_column_in_another_unit_is_refused(tmp_path: Path, name: str, unit: str) -> None:
    path = tmp_path / "units.csv"
    header = ["t [s]", "v [m/s]", "omega [rad/s]", "x [m]", "y", "heading [rad]"]
    path.write_text(",".join(header) + "\n0,1,1,0,0,0\n")
    assert set(read_log(path, Unicycle())) == {"the robot"}
    other = [f"{name} [{unit}]" if column.split(" ")[0] == name else column for column in header]
    path.write_text(",".join(other) + "\n0,1,1,0,0,0\n")
    with pytest.raises(ProblemError, match=rf"units.csv:1: expected {name} in .*, got '{name} \[{unit}\]'"):
        read_log(path, Unicycle())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,v,omega,x,y,heading\n0,1,0,0,0,0\n0.1,1,,0.1,0,0\n", r":3: expected a number for omega, got an empty cell"),
        ("t,v,omega,x,y,heading\n0,1,0\n", r":2: expected a number for x, got no cell"),
        ("t,v,omega,x,y,heading\n0,1,0,0,nan,0\n", r":2: expected a finite number for y, got nan"),
        ("t;v;omega;x;y;heading\n0;1;0;0;0;0\n", r":1: expected columns separated by commas .*, got semicolons"),
        ("", r":1: expected the columns t, .*, got an empty file"),
    ],
)
def test_what_is_wrong_with_a_log_is_said(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProblemError, match=message):
        read_log(path, Unicycle())


def test_a_log_that_is_not_there_is_a_wrong_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["identify", str(tmp_path / "none.csv")]) == 2
    assert "none.csv: expected a log, can't read it (No such file or directory)" in capsys.readouterr().err


def test_a_log_from_standard_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found, _ = logs(TRUE, 2)
    rows = ["robot,t,v,omega,x,y,heading"]
    rows += [
        ",".join(map(str, [name, t, *u, *pose]))
        for name, log in found.items()
        for t, u, pose in zip(log.times, log.controls, log.poses, strict=True)
    ]
    path = tmp_path / "runs.csv"
    path.write_text("\n".join(rows))
    assert invoke(["identify", str(path)]) == 0
    section = capsys.readouterr().out
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    assert invoke(["identify", "-"]) == 0
    assert capsys.readouterr().out == section
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"t,v\n")))
    assert invoke(["identify", "-"]) == 2
    assert "<stdin>:1: expected the columns t, v, omega, x, y, heading" in capsys.readouterr().err


def test_a_log_that_is_too_large_is_not_read_in_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "runs.csv"
    path.write_text("t,v,omega,x,y,heading\n" + "0,1,1,0,0,0\n" * 9)
    monkeypatch.setattr("ensemble_ctrl.cli.identify.MOST_BYTES", 60)
    with pytest.raises(ProblemError, match=r"runs.csv: expected a log of at most 0 MB, got more"):
        read_log(path, Unicycle())
