"""What is wrong with a task about headings and rates, each at its column; the command, the file and the checker."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.remaining import of_one_robot
from ensemble_ctrl.planning.tolerance.measure import measure
from ensemble_ctrl.problem import Problem, SolveOptions
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, PlanarQuadrotor, Unicycle
from tests.paths import ROOT


def refused(task: str, system: Any = None, bounds: Uncertainty | None = None, **changes: Any) -> tuple[str, int | None]:
    """The one error of a task, and the column it is at."""
    system = Unicycle() if system is None else system
    ranges = {"traction": Interval(0.9, 1.1)} if system.on_arcs else {"mass": Interval(0.9, 1.1)}
    fleet = Fleet(system, ranges, uncertainty=bounds, **changes.pop("fleet", {}))
    with pytest.raises(ProblemError) as refusal:
        Problem(name="n", fleet=fleet, duration=10.0, steps=40, task=parse(task), **changes)
    (error,) = refusal.value.findings
    return str(error), error.offset


@pytest.mark.parametrize(
    ("task", "column", "message"),
    [
        ("G v within 1 deg of 0", 2, "expected the name of an angle before 'within', got v, in m/s"),
        ("G delta <= 1", 2, "expected the name of a state"),
        ("G x + heading >= 1", 2, "expected an inequality of x or of heading, got both: heading \\+ x >= 1"),
        ("mean(F heading >= 1)", 7, "mean.f. is about the mean position, and heading >= 1 is about heading"),
        ("G[1,5] heading <= 1 and F[2,3] heading >= 2", 31, "nothing does both from 2 to 3 s"),
        ("G[1,5] heading within 5 deg of 0 and G[5,7] heading within 5 deg of 180 deg", 44, "both at 5 s"),
        ("G[1,5] v >= 1 and G[0,9] v <= 0.5", 25, "expected what v >= 1 leaves possible, got -v >= -0.5"),
    ],
)
def test_what_makes_no_sense_is_refused_at_its_column(task: str, column: int, message: str) -> None:
    text, offset = refused(task)
    assert offset == column
    with pytest.raises(ProblemError, match=message):
        raise ProblemError(text)


def test_angles_that_touch_or_are_wanted_one_after_the_other_are_no_error() -> None:
    fleet = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)})
    for task in (
        "G[1,5] heading within 10 deg of 0 and G[2,7] heading within 10 deg of 20 deg",
        "G[1,5] heading within 10 deg of 175 deg and G[2,7] heading within 10 deg of -175 deg",
        "G[1,5] heading within 5 deg of 0 and G[6,7] heading within 5 deg of 90 deg",
        "F[1,5] heading within 5 deg of 0 and F[1,5] heading within 5 deg of 90 deg",
    ):
        Problem(name="n", fleet=fleet, duration=10.0, steps=40, task=parse(task))


def test_what_no_proof_or_program_knows_is_refused() -> None:
    late, held = Uncertainty(delay=0.1), Uncertainty({"heading": 0.1}, heading_hold=0.5)
    assert "may be late or early" in refused("G v <= 1", bounds=late)[0]
    assert "loop of their own" in refused("G omega <= 1", bounds=held)[0]
    assert "use hull" in refused("G heading <= 1", solve=SolveOptions(guarantee="moment"))[0]
    assert "use nodal" in refused("G heading <= 1", coordinates="modal")[0]
    fast = {"input_lower": [-1.0, -1e3], "input_upper": [1.0, 1e3]}
    assert "turns at most 100 times" in refused("G heading within 1 deg of 0", fleet=fast)[0]
    assert "how often tilt turns is not known" in refused("G not tilt within 1 deg of 0", PlanarQuadrotor())[0]


def test_a_loop_refuses_headings() -> None:
    fleet = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)})
    one = Problem(name="n", fleet=fleet, duration=10.0, steps=40, task=parse("G heading <= 1"))
    with pytest.raises(UnsupportedError, match="the proofs of a loop are about positions"):
        of_one_robot(one)


def test_the_tilt_of_a_quadrotor_may_be_wrapped() -> None:
    fleet = Fleet(PlanarQuadrotor(), {"mass": Interval(0.99, 1.01)})
    one = Problem(name="n", fleet=fleet, duration=0.5, steps=5, task=parse("G tilt within 40 deg of 360 deg"))
    controls = np.array([[9.81, 0.001 * k] for k in range(5)])
    (part,) = certify(one, controls).parts
    assert part.proven > 0.5
    assert part.unit == "rad"


def test_a_bicycle_may_be_asked_for_its_steering() -> None:
    fleet = Fleet(Bicycle(), {"traction": Interval(0.9, 1.1)})
    one = Problem(name="n", fleet=fleet, duration=1.0, steps=2, task=parse("G delta within 20 deg of 0"))
    (part,) = certify(one, np.array([[1.0, 0.1], [1.0, -0.2]])).parts
    assert part.proven == pytest.approx(np.radians(20) - 0.2, abs=1e-9)


@pytest.mark.parametrize("name", ["parallel_parking", "turn_and_dock"])
def test_the_command_plans_and_proves_it_and_the_checker_agrees(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / name
    file = ROOT / "configs" / "vehicles" / f"{name}.yaml"
    assert invoke([str(file), "-o", str(folder), "--no-plots", "-q", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["certificate"]["proven"] == "yes"
    command = [sys.executable, "-m", "ensemble_ctrl.certificate", str(folder)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_a_mistake_is_shown_at_its_place_in_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "configs" / "vehicles" / "turn_and_dock.yaml").read_text()
    file = tmp_path / "bad.yaml"
    file.write_text(text.replace("v <= 0.3", "speed <= 0.3"))
    assert invoke(["check", str(file)]) == 2
    printed = capsys.readouterr().err
    assert "bad.yaml:21:76: error: task: expected the name of a state" in printed
    assert "(x, y, heading, v, omega), got 'speed'" in printed


def test_a_tolerance_of_delays_is_not_asked_of_a_plan_whose_task_is_about_speeds() -> None:
    fleet = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)})
    controls = np.tile([0.2, 0.1], (4, 1))
    for task, timed in (("G v <= 0.5", False), ("G heading <= 0.5", True)):
        one = Problem(name="n", fleet=fleet, duration=1.0, steps=4, task=parse(task))
        kinds = [each.kind for each in measure(one, controls).kinds]
        assert ("delay" in kinds) == timed
        assert ("jitter" in kinds) == timed
        assert "error of v" in kinds
