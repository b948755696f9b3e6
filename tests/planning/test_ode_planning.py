"""Plans for fleets that follow a differential equation, from Python and from files, and what is said of them."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.files.export import export
from ensemble_ctrl.files.folder import ResultsFolder
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.problem.evaluation.sampled import replay, states
from ensemble_ctrl.report import summary_lines
from tests.paths import ROOT

Floats = NDArray[np.float64]
QUADROTOR = ROOT / "configs" / "systems" / "quadrotor_delivery.yaml"
MASSES = ROOT / "configs" / "systems" / "unknown_mass.yaml"
OWN = ROOT / "examples" / "own_system.py"
CRANE = OWN.with_suffix(".yaml")


@cache
def plan_of(path: Path) -> ec.Plan:
    """The plan of a problem file."""
    return ec.plan(ec.load(path, trust=True))


@pytest.mark.parametrize("path", [MASSES, CRANE], ids=lambda path: path.stem)
def test_every_member_does_the_task(path: Path) -> None:
    """More members than the plan was made with, looked at more often."""
    plan = plan_of(path)
    run = plan.replay(parameters=plan.problem.fleet.grid(301), substeps=4)
    assert plan.status == "planned"
    assert not run.violating.any()
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert plan.verified


@pytest.mark.slow
def test_the_delivery_goes_through_the_window_hovers_and_spreads_as_gravity_says() -> None:
    """Unequal masses under one thrust must differ by the relative mass times climb and fall."""
    plan = plan_of(QUADROTOR)
    problem = plan.problem
    assert plan.status == "planned"
    assert not plan.replay(parameters=problem.fleet.grid(101), substeps=4).violating.any()
    found = states(problem, plan.controls, problem.fleet.grid(21), 8)
    path, speed = found[..., :3], np.linalg.norm(found[:, -1, 3:6], axis=-1)
    inside = (path[..., 0] > 1.4) & (path[..., 0] < 1.6)
    assert inside.any(axis=1).all()
    assert (np.abs(path[inside][:, 1]) < 0.6).all()
    assert ((path[inside][:, 2] > 0.9) & (path[inside][:, 2] < 2.1)).all()
    assert (speed < 1.2).all()
    apart = path[0, :, 2] - path[-1, :, 2]
    times = np.linspace(0, problem.duration, len(apart))
    lift = path[10, :, 2] - 1.5 + 9.81 * times**2 / 2
    expected = lift * 6.25 * (1 / 6.0 - 1 / 6.5)
    np.testing.assert_allclose(apart, expected, atol=0.25 * expected.max())
    assert plan._repr_html_().count("<polyline") == 9


def test_a_better_plan_costs_less_than_a_seed() -> None:
    """The optimum is no worse than pushing as hard as the mean mass would need."""
    plan = plan_of(MASSES)
    assert plan.details["cost"] <= 5.6
    assert plan.details["gap"] >= 0
    assert plan.details["orders"] == [3]


def test_the_same_from_python_with_nodes() -> None:
    fleet = ec.Fleet(ec.DoubleIntegrator(), {"mass": ec.Interval(0.9, 1.1)}, start={"x": 0.0})
    problem = ec.Problem(
        name="push",
        fleet=fleet,
        duration=3.0,
        steps=15,
        task=parse("F[2.5, 3] (in(goal) and vx <= 0.5)"),
        regions={"goal": ec.Polyhedron.box([[1.0, 2.0], [-0.5, 0.5]])},
        solve=ec.SolveOptions(guarantee="nodes"),
    )
    plan = ec.plan(problem)
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0
    text = "\n".join(summary_lines(plan))
    assert "proven for every member" in text
    assert "proven     for every mass 0.9..1.1, every instant: rest of the task >= " in text
    again = ec.plan(problem, guess=plan)
    assert again.details["cost"] <= plan.details["cost"] + 0.02


def test_a_system_that_branches_on_its_state_is_refused() -> None:
    class Choosing(ec.DoubleIntegrator):
        name = "choosing"

        def xdot(self, x: Any, u: Any, psi: Any) -> Any:
            return super().xdot(x, u, psi) if float(np.max(x[0])) < 5 else [0.0] * 4

    fleet = ec.Fleet(Choosing(), {"mass": ec.Interval(0.9, 1.1)})
    problem = ec.Problem("choosing", fleet, 1.0, 5, parse("F x >= 0.1"))
    with pytest.raises(ec.ProblemError, match=r"Choosing.xdot: expected arithmetic .* without choices on states"):
        ec.plan(problem)


def test_a_task_that_is_out_of_reach_has_no_plan() -> None:
    problem = ec.load(MASSES, ["task=F[0, 2] in(goal)", "solve.max_iterations=60"])
    with pytest.raises(ec.SolveError, match=r"no plan was found; violated near the best guess: F\[0,2\] in\(goal\) by"):
        ec.plan(problem)


def test_a_plan_is_proven_and_one_made_unsafe_is_refuted() -> None:
    """The proven clearance is just below the smallest one of many members; commands that lead past the goal are refuted
    by a member that misses it.
    """
    problem = ec.load(MASSES, ["verify.members=50"])
    plan = ec.plan(problem)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert plan.verified
    seen = min(c.distance for c in plan.replay(members=2000, substeps=10).clearances)
    assert seen - 1e-3 < plan.certificate.clearance <= seen
    late = ec.certify(problem, plan.controls * 0.9)
    assert late.proven == "no"
    assert late.counter_example is not None
    member = np.array([[late.counter_example.parameters["mass"]]])
    assert replay(problem, plan.controls * 0.9, parameters=member).violating.all()


def test_the_example_is_at_most_20_lines_and_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    source = OWN.read_text()
    kind = source[source.index("class CartPole") : source.index("def problem")].strip()
    assert len(kind.splitlines()) <= 20
    monkeypatch.syspath_prepend(str(OWN.parent))
    own_system = import_module("own_system")
    problem = own_system.problem()
    assert problem.fleet.system.states == ("x", "v", "angle", "rate")
    plan = ec.plan(problem)
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0
    sys.modules.pop("own_system")


def test_what_needs_arcs_says_so_at_once() -> None:
    problem = ec.load(MASSES)
    with pytest.raises(ec.UnsupportedError, match="expected a system on arcs, got the double_integrator"):
        Receding(problem)


def test_states_of_members_are_exported() -> None:
    problem, controls = ec.load(MASSES), np.ones((40, 2))
    header, *rows = (export(problem, controls, None, "csv", members=2) or "").splitlines()
    assert header.endswith("x [m] (mass=1.2),y [m] (mass=1.2),vx [m/s] (mass=1.2),vy [m/s] (mass=1.2)")
    found = states(problem, controls, problem.fleet.corners)
    np.testing.assert_allclose([float(x) for x in rows[-1].split(",")[3:]], found[:, -1].ravel(), rtol=1e-12)
    data = json.loads(export(problem, controls, None, "json", members=1) or "")
    assert set(data["members"][0]) == {"parameters", "x", "y", "vx", "vy"}


def test_files_and_problems_are_the_same() -> None:
    for path in (QUADROTOR, MASSES, CRANE):
        text = dump(ec.load(path, trust=True))
        assert dump(ec.load_text(text, str(path), trust=True)) == text


def test_the_command_plans_saves_shows_and_verifies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From a file with a system of one's own to a folder, and back from it."""
    target = tmp_path / "crane"
    small = ["--set", "verify.members=100", "--set", "horizon.steps=20", "--trust", "-q"]
    assert invoke(["run", str(CRANE), "-o", str(target), "--json", *small]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["status"], facts["certificate"]["proven"]) == ("planned", "yes")
    names = {file.name for file in target.iterdir()}
    assert {"own_system.py", "plan.npz", "trajectories.png", "controls.png", "spread.png", "report.html"} <= names
    assert "Proven: every robot with load from 0.1 to 0.2" in (target / "report.html").read_text()
    assert invoke(["show", str(target)]) == 2
    assert "expected your consent to run own_system.py" in capsys.readouterr().err
    assert invoke(["show", str(target), "--trust"]) == 0
    assert "for every load 0.1..0.2" in capsys.readouterr().out
    assert invoke(["verify", str(target), "--trust"]) == 0
    assert "crane: proven" in capsys.readouterr().out
    assert invoke(["report", str(target)]) == 2
    for command in (["report"], ["animate", "--seconds", "0.2"], ["plot", "trajectories"], ["export"]):
        verb, *rest = command
        more = ["--to", "csv", "-o", str(target / "controls.csv"), "--overwrite"] if verb == "export" else []
        assert invoke([verb, str(target), *rest, *more, "--trust"]) == 0
    capsys.readouterr()
    ResultsFolder(target, overwrite=True).discard()
    plan = ec.Plan.load(target, trust=True)
    assert plan.problem.steps == 20


@pytest.mark.parametrize("path", [MASSES, CRANE], ids=lambda path: path.stem)
def test_a_notebook_shows_its_map(path: Path) -> None:
    plan = plan_of(path)
    assert plan._repr_html_().count("<polyline") == 9
    assert plan.plot() is not None
    import matplotlib.pyplot as plt

    plt.close("all")


class Escape(ec.OdeSystem):
    """x runs off to infinity whatever the command, from some start on."""

    name, states, positions = "escape", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("u",), ("1",), ((-2.0, 2.0),)
    parameters: Mapping[str, float] = {"k": 1.0}

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        return [psi["k"] * x[0] ** 2 + u[0], 0 * x[1]]


def escape(start: float, bound: float) -> ec.Problem:
    """Keep x small; it can be kept where ``k x^2`` is below the bound of the command."""
    fleet = ec.Fleet(
        Escape(),
        {"k": ec.Interval(0.9, 1.2)},
        start={"x": start},
        input_lower=np.array([-bound]),
        input_upper=np.array([bound]),
    )
    return ec.Problem("escape", fleet, duration=2.0, steps=20, task=parse("G (x <= 3 and y <= 1)"))


def test_a_fleet_that_runs_away_is_no_plan_and_says_what_when_and_for_whom(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    problem = escape(0.9, 0.2).with_(solve=ec.SolveOptions(max_iterations=30))
    plan = ec.plan(problem, check=False, log=tmp_path / "solver.log")
    (conflict,) = plan.conflicts()
    assert (plan.status, plan.replayed, plan.verified) == ("infeasible", None, False)
    assert conflict.what == "x leaves all bounds at t = 1.3 s for k = 0.9"
    assert conflict.time == pytest.approx(1.3)
    assert [line for line in summary_lines(plan) if line.startswith("  violated")] == [f"  violated   {conflict.what}"]
    with pytest.raises(ec.SolveError, match=r"no plan was found.*x leaves all bounds at t = 1\.3 s for k = 0\.9"):
        ec.plan(problem)
    written = capfd.readouterr()
    assert written.out == written.err == ""


@pytest.mark.parametrize("guess", [np.full((20, 1), 2.0), np.full((7, 1), 2.0)])
def test_a_guess_that_runs_away_is_one_guess_less(guess: Floats) -> None:
    plan = ec.plan(escape(0.9, 2.0), guess=guess)
    assert plan.verified


@pytest.mark.slow
def test_the_command_finds_no_plan_for_a_fleet_that_runs_away(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    head = "from collections.abc import Mapping\nfrom typing import Any\nimport ensemble_ctrl as ec\n\n"
    (tmp_path / "own.py").write_text(head + inspect.getsource(Escape))
    (tmp_path / "a.yaml").write_text("""
fleet:
  model: {python: own.py:Escape}
  parameters: {k: {range: [0.9, 1.2]}}
  start: {x: 0.9}
  input_bounds: {u: [-0.2, 0.2]}
horizon: {duration: 2 s, steps: 20}
task: "G (x <= 3 and y <= 1)"
solve: {max_iterations: 30}
""")
    assert invoke(["run", str(tmp_path / "a.yaml"), "--trust", "-q", "-o", str(tmp_path / "out")]) == 3
    written = capfd.readouterr()
    assert written.err == (
        "error: a: no plan was found; violated near the best guess: x leaves all bounds at t = 1.3 s for k = 0.9; "
        "tried: 1 route; 4 guesses with random commands\n"
    )
    assert not list((tmp_path / "out").glob("*.png"))


ESCAPE = """
import ensemble_ctrl as ec

class Escape(ec.OdeSystem):
    name, states, positions = "escape", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("push",), ("m/s",), ((-1.0, 1.0),)
    parameters = {"k": 1.0}

    def xdot(self, x, u, psi):
        return [psi["k"] * x[0] ** 2 + u[0], 0 * x[1]]
"""


def test_commands_under_which_a_state_runs_away_are_judged_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "escape.py").write_text(ESCAPE)
    (tmp_path / "problem.yaml").write_text(
        "name: escape\n"
        "fleet: {model: {python: escape.py:Escape}, parameters: {k: {range: [0.9, 1.1]}}, start: {position: [1, 0]}}\n"
        "horizon: {duration: 2 s, steps: 10}\n"
        "task: G x >= -1\n"
    )
    (tmp_path / "controls.csv").write_text("t [s],push [m/s]\n" + "".join(f"{k / 5},0\n" for k in range(10)))
    assert invoke(["verify", str(tmp_path), "--trust", "--members", "20"]) == 4
    said = capsys.readouterr().out
    assert "UNDECIDED: x runs away or is no number" in said
    assert "replay     x leaves all bounds at t = " in said
    ec.Plan(ec.load(tmp_path / "problem.yaml", trust=True), np.zeros((10, 1)), "planned").save(tmp_path / "plan.npz")
    assert invoke(["show", str(tmp_path), "--trust"]) == 3
    assert "violated   x leaves all bounds at t = " in capsys.readouterr().out
