"""``ensemble-plan CONFIG``: what it writes, and what its options change."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli.app import invoke

from .conftest import Command
from .tools import SMALL, environment, process

DATA = {
    *("certificate.json", "controls.csv", "plan.npz", "problem.yaml", "proof_input.json", "provenance.json"),
    *("solver.log", "summary.json"),
}
FIGURES = {"trajectories.png", "controls.png", "routes.png"}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_writes_its_folder_and_a_summary(place: Path) -> None:
    done = process("small.yaml", cwd=place)
    assert done.code == 0, done.err
    folder = place / "plans" / "small"
    assert names(folder) == DATA | FIGURES | {"report.html"}
    assert names(place / "plans") == {"small"}
    lines = done.out.splitlines()
    assert lines[0] == "small: plan found, proven for every member, no member of 200 violates"
    assert 8 <= len(lines) <= 14
    assert max(map(len, lines)) <= 120
    for label in ("fleet", "horizon", "task", "robustness", "clearance", "replay", "proven", "work"):
        assert any(line.startswith(f"  {label} ") for line in lines), label
    assert lines[-1] == "  files      plans/small"
    for phase in ("check", "guess", "solve", "replay", "write"):
        assert re.search(rf"\b{phase} \d+\.\d\d s", done.err), done.err
    for figure in FIGURES:
        assert_png(folder / figure)


def test_the_baseline_is_planned_for_the_figures_only(command: Command, place: Path) -> None:
    done = command("small.yaml", "--set", "report.baseline=true", "--no-plots")
    assert (done.code, " baseline " in done.err) == (0, False)
    done = command("small.yaml", "--set", "report.baseline=true")
    assert (done.code, bool(re.search(r"\bbaseline \d+\.\d\d s", done.err))) == (0, True)
    assert names(place / "plans" / "small-2") == DATA | FIGURES | {"report.html"}


def test_a_baseline_that_fails_is_a_warning(command: Command, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ValueError("no way")

    monkeypatch.setattr("ensemble_ctrl.cli.run.with_baseline", broken)
    done = command("small.yaml", "--set", "report.baseline=true")
    assert done.code == 0
    assert "warning: the unconstrained baseline could not be planned (ValueError: no way)" in done.err
    assert names(place / "plans" / "small") == DATA | FIGURES | {"report.html"}


def assert_png(path: Path) -> None:
    from PIL import Image

    with Image.open(path) as image:
        image.load()
        assert image.format == "PNG"
        assert min(image.size) > 300
        assert len(image.convert("RGB").getcolors(1_000_000) or []) > 20


def test_the_files_say_the_same(results: Path) -> None:
    plan = ec.Plan.load(results)
    table = list(csv.reader(io.StringIO((results / "controls.csv").read_text())))
    assert table[0] == ["t [s]", "v [m/s]", "omega [rad/s]"]
    numbers = np.array(table[1:], dtype=float)
    assert np.array_equal(numbers[:, 0], plan.times.round(9))
    assert np.array_equal(numbers[:, 1:], plan.controls)
    facts = json.loads((results / "summary.json").read_text())
    assert facts["schema"] == 1
    assert (facts["name"], facts["status"], facts["verified"]) == ("small", "planned", True)
    assert facts["replay"]["members"] == 200
    origin = json.loads((results / "provenance.json").read_text())
    assert origin["ensemble_ctrl"] == ec.__version__
    assert origin["seed"] == 0
    assert origin["command"][0] == "ensemble-plan"
    assert origin["command"][1].endswith("small.yaml")
    assert all(origin["libraries"].values())
    assert "Ipopt" in (results / "solver.log").read_text() or "iter " in (results / "solver.log").read_text()


def test_the_problem_as_solved_repeats_the_plan(command: Command, place: Path) -> None:
    first = command("small.yaml", "--no-plots", "--set", "fleet.radius=5 cm", "--seed", "3", "-o", "a")
    again = command("a/problem.yaml", "--no-plots", "-o", "b")
    assert (first.code, again.code) == (0, 0)
    a, b = ec.Plan.load(place / "a"), ec.Plan.load(place / "b")
    assert a.problem.fleet.radius == b.problem.fleet.radius == 0.05
    assert a.problem.solve.seed == b.problem.solve.seed == 3
    assert np.allclose(a.controls, b.controls, atol=1e-6)
    assert (place / "a/problem.yaml").read_text() == (place / "b/problem.yaml").read_text()


def test_set_is_applied_before_validation_and_the_last_word_counts(command: Command, place: Path) -> None:
    text = SMALL.replace("model: unicycle", "model: unicicle")
    (place / "small.yaml").write_text(text)
    done = command(
        "small.yaml", "--no-plots", "--json", "--set", "fleet.model=unicycle", "--set", "name=other",
        "--set", "solve.seed=1", "--seed", "2", "--members", "50", "--set", "verify.members=70",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert (done.data["name"], done.data["folder"]) == ("other", "plans/other")
    assert done.data["replay"]["members"] == 50
    assert json.loads((place / "plans/other/provenance.json").read_text())["seed"] == 2


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        (["--set", "fleet.radis=1"], ["--set fleet.radis=1: error: fleet.radis: unknown field", "'radius'"]),
        (["--set", "radius"], ["--set radius: error: expected KEY=VALUE", "for example  fleet.radius=0.3"]),
        (["--set", "horizon.steps=[1"], ["--set horizon.steps=[1: error: not YAML"]),
        (["--set", "horizon.steps=0"], ["horizon.steps: expected", "got 0"]),
        (["--set", "fleet.model.x=1"], ["expected a section above 'x', got 'unicycle'"]),
        (["--time-limit", "soon"], ["solve.time_limit: expected a time in s, ms, min or h, got 'soon'"]),
        (["--time-limit", "-5"], ["solve.time_limit: expected"]),
        (["--set", "solve.routes=0"], ["solve.routes: expected a whole number from 1 to 1000 (or all), got 0"]),
        (["--method", "magic"], ["solve.method: 'magic' is not one of nlp"]),
        (["--seed", "-1"], ["'--seed'", "0"]),
        (["--members", "0"], ["'--members'", "1"]),
        (["--members", "many"], ["'--members'", "integer"]),
        (["-q", "-v"], ["expected one of -q and -v, got both"]),
        (["--guess", "nowhere"], ["nowhere: expected a saved plan, found no such file"]),
        (["--guess", "small.yaml"], ["small.yaml: expected a plan.npz of this package"]),
    ],
)
def test_bad_options_are_refused_before_any_work(
    command: Command, place: Path, changes: list[str], wanted: list[str]
) -> None:
    done = command("small.yaml", *changes)
    assert done.code == 2
    assert done.out == ""
    for words in wanted:
        assert words in done.err
    assert not (place / "plans").exists()


def test_a_guess_replaces_the_routes(command: Command, results: Path) -> None:
    for guess, steps in (("results", 20), ("results/plan.npz", 40)):
        changed = f"horizon.steps={steps}"
        done = command("small.yaml", "--no-plots", "--json", "--guess", guess, "--set", changed)
        assert done.code == 0, done.err
        assert len(done.data["details"]["routes"]) == 1


def test_every_route_is_listed_drawn_and_saved(command: Command, place: Path) -> None:
    done = command("small.yaml", "-v", "--set", "solve.routes=all")
    assert done.code == 0, done.err
    title, header, *rows = done.out.splitlines()[-4:]
    assert title == "routes tried: 2 (X left: obstacle X lies to the left of the route)"
    assert header.split() == ["length", "coarse", "cost", "fine", "cost", "clearance", "time", "outcome", "route"]
    assert {row.partition(" block ")[2] for row in rows} == {"left", "right"}
    saved = json.loads((place / "plans/small/summary.json").read_text())["details"]["routes"]
    assert sorted(route["name"] for route in saved) == ["block left", "block right"]
    assert sum(route["outcome"] == "kept" for route in saved) == 1
    for route, row in zip(saved, rows, strict=True):
        assert row.endswith(f"  {route['outcome']:<9}{route['name']}")
        assert f"{route['length']:.2f} m" in row
        assert route["corners"][0] == [0, 0]
    assert (place / "plans/small/routes.png").stat().st_size > 10_000
    assert "routes tried" not in command("small.yaml", "--no-plots").out


def test_json_is_one_object_and_nothing_else(command: Command, place: Path) -> None:
    done = command("small.yaml", "--no-plots", "--json", "-q")
    assert done.err == ""
    facts = done.data
    assert (facts["schema"], facts["exit_code"], facts["status"]) == (1, 0, "planned")
    saved = json.loads((place / "plans/small/summary.json").read_text())
    assert {**saved, "exit_code": 0, "folder": "plans/small"} == facts


@pytest.mark.parametrize(
    "arguments",
    [
        ["missing.yaml"],
        ["small.yaml", "--set", "fleet.radis=1"],
        ["small.yaml", "--wrong"],
        ["small.yaml", "-o", "small.yaml"],
        ["small.yaml", "--guess", "nowhere"],
        ["show", "nowhere"],
        ["rum"],
        ["check"],
        [],
    ],
)
def test_json_is_one_object_on_failure_too(command: Command, arguments: list[str]) -> None:
    done = command(*arguments, "--json")
    assert done.code == 2
    assert (done.data["schema"], done.data["status"], done.data["exit_code"]) == (1, "error", 2)
    assert done.data["message"] in done.err


def test_json_holds_each_diagnostic(command: Command) -> None:
    done = command("small.yaml", "--json", "--set", "fleet.radis=1")
    [found] = done.data["diagnostics"]
    assert found["path"] == "fleet.radis"
    assert found["message"] == "unknown field"
    assert found["hint"] == "did you mean 'radius'?"


def test_quiet_says_only_the_result(command: Command, place: Path) -> None:
    text = SMALL.replace("obstacles:", "  spare: {box: [[3, 4], [3, 4]]}\nobstacles:")
    (place / "small.yaml").write_text(text)
    loud = command("small.yaml", "--no-plots")
    assert "warning: regions.spare" in loud.err
    quiet = command("small.yaml", "--no-plots", "-q")
    assert quiet.err == ""
    assert quiet.out.splitlines()[0] == loud.out.splitlines()[0]


def test_verbose_keeps_a_line_for_each_phase_and_iteration(command: Command) -> None:
    err = command("small.yaml", "--no-plots", "-v").err.splitlines()
    for phase in ("check ...", "guess ...", "solve ...", "replay ...", "write ..."):
        assert phase in err
    iterations = [line for line in err if ": iteration " in line]
    assert len(iterations) > 5
    assert all("cost" in line and "violation" in line for line in iterations)


def test_the_log_has_decisions_with_v_and_phases_with_vv(command: Command) -> None:
    def logged(*options: str) -> list[str]:
        err = command("small.yaml", "--no-plots", "--overwrite", *options).err
        return [line for line in err.splitlines() if line.startswith("log: ")]

    assert logged() == []
    decisions, everything = logged("-v"), logged("-vv")
    assert any("certificate: proven yes" in line for line in decisions)
    assert any(": kept, cost" in line for line in decisions)
    assert not any("phase" in line for line in decisions)
    assert any("phase solve" in line for line in everything)


def test_without_plots_no_drawing_library_is_loaded(place: Path) -> None:
    code = (
        "import sys; from ensemble_ctrl.cli.app import invoke;"
        "code = invoke(['small.yaml', '--no-plots', '-q']); print('matplotlib' in sys.modules, code)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=place, env=environment(), capture_output=True, text=True)
    assert done.stdout.endswith("False 0\n")
    assert names(place / "plans/small") == DATA


def test_stdin(place: Path) -> None:
    done = process("-", "--no-plots", "-q", cwd=place, stdin=SMALL.replace("name: small\n", ""))
    assert done.code == 0, done.err
    [folder] = (place / "plans").iterdir()
    assert done.out.splitlines()[-1].endswith(f"plans/{folder.name}")


def test_a_file_named_like_a_command(command: Command, place: Path) -> None:
    (place / "check").write_text(SMALL)
    assert command("./check", "--no-plots", "-q").code == 0
    assert command("run", "check", "--no-plots", "-q").code == 0
    assert command("check").code == 2


def test_options_may_stand_before_the_file(command: Command) -> None:
    assert command("--no-plots", "-q", "--json", "small.yaml").data["folder"] == "plans/small"


def test_an_unbounded_region_is_drawn_as_far_as_the_map(place: Path) -> None:
    text = SMALL.replace("{box: [[1.5, 2.5], [-0.5, 0.5]]}", "{halfspaces: [x >= 1.5]}")
    (place / "half.yaml").write_text(text)
    assert invoke(["half.yaml", "-q"]) == 0
    assert_png(place / "plans/small/trajectories.png")
