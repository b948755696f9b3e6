"""The other commands: check, show, models, examples, doctor, and the help."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.results import LIBRARIES
from ensemble_ctrl.cli.app import app
from tests.paths import CONFIGS, ROOT

from .conftest import Command
from .tools import SMALL, environment

NAMES = ["run", "check", "show", "replay", "report", "plot", "animate", "verify", "compare", "widest"]
NAMES += ["channels", "tolerance", "identify", "import", "export", "online", "sweep", "paper", "edit", "view", "models"]
NAMES += ["examples", "init", "schema", "doctor"]


def loaded(err: str) -> set[str]:
    """Modules that ``-X importtime`` reports."""
    return {line.split("|")[-1].strip() for line in err.splitlines() if line.startswith("import time:")}


def test_check_says_what_is_good_and_what_is_not(command: Command, place: Path) -> None:
    (place / "bad.yaml").write_text(SMALL.replace("unicycle", "unicicle"))
    done = command("check", "small.yaml", "bad.yaml", "walled.yaml", "missing.yaml")
    assert done.code == 2
    assert done.out == "small.yaml: ok\nwalled.yaml: ok\n"
    assert "bad.yaml:4:10: error: fleet.model: 'unicicle' is not one of unicycle" in done.err
    assert "     |          ^\n" in done.err
    assert "hint: did you mean 'unicycle'?" in done.err
    assert "missing.yaml: error: no such file" in done.err


def test_check_of_good_files(command: Command, place: Path) -> None:
    done = command("check", "small.yaml", "walled.yaml")
    assert (done.code, done.err) == (0, "")
    done = command("check", "-q", "small.yaml", "walled.yaml")
    assert (done.code, done.out, done.err) == (0, "", "")


def test_check_with_changed_fields(command: Command) -> None:
    done = command("check", "small.yaml", "--set", "fleet.radius=10 cm")
    assert (done.code, done.out) == (0, "small.yaml: ok\n")
    done = command("check", "small.yaml", "walled.yaml", "--set", "fleet.radius=10 s")
    assert done.code == 2
    assert done.err.count("--set fleet.radius=10 s: error: fleet.radius: expected a length in m, cm, mm or km") == 2


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (("--method", "nlpp"), "--method nlpp: error: solve.method: 'nlpp' is not one of nlp, minlp"),
        (("--time-limit", "60 m"), "--time-limit 60 m: error: solve.time_limit: expected a time in s, ms, min or h"),
        (("--time-limit", "[1"), "--time-limit [1: error: "),
        (("--set", "solve.method=nlpp"), "--set solve.method=nlpp: error: solve.method: 'nlpp' is not one of"),
    ],
)
def test_errors_name_the_option_that_was_typed(command: Command, typed: tuple[str, str], message: str) -> None:
    done = command("small.yaml", *typed)
    assert done.code == 2
    assert done.err.startswith(message)


def test_check_shows_warnings(command: Command, place: Path) -> None:
    (place / "small.yaml").write_text(SMALL.replace("obstacles:", "  spare: {box: [[3, 4], [3, 4]]}\nobstacles:"))
    done = command("check", "small.yaml")
    assert done.code == 0
    assert done.out == "small.yaml: ok (1 warning)\n"
    assert "warning: regions.spare" in done.err
    assert command("check", "small.yaml", "-q").err == ""


def test_check_as_json(command: Command, place: Path) -> None:
    (place / "bad.yaml").write_text(SMALL.replace("unicycle", "unicicle"))
    done = command("check", "--json", "small.yaml", "bad.yaml")
    assert (done.code, done.err) == (2, "")
    facts = done.data
    assert (facts["schema"], facts["ok"], facts["exit_code"]) == (1, False, 2)
    good, bad = facts["files"]
    assert good == {"file": "small.yaml", "ok": True, "diagnostics": []}
    [found] = bad["diagnostics"]
    assert (found["source"], found["line"], found["column"], found["severity"]) == ("bad.yaml", 4, 10, "error")
    assert found["path"] == "fleet.model"


def test_check_of_stdin(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(SMALL.encode())))
    done = command("check", "-")
    assert (done.code, done.out) == (0, "-: ok\n")


@pytest.mark.parametrize("arguments", [["small.yaml"], ["--json", "missing.yaml"]])
def test_check_loads_no_solver(place: Path, arguments: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "ensemble_ctrl.cli", "check", *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        env=environment(),
    )
    modules = loaded(done.stderr)
    assert "ensemble_ctrl.files.config.load" in modules
    packages = {name.split(".")[0] for name in modules}
    assert not packages & {"casadi", "scipy", "matplotlib", "shapely", "rich"}


def test_show_loads_no_solver(results: Path, place: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "ensemble_ctrl.cli", "show", "results"],
        cwd=place,
        capture_output=True,
        text=True,
        env=environment(),
    )
    assert done.stdout.startswith("small: plan found")
    packages = {name.split(".")[0] for name in loaded(done.stderr)}
    assert not packages & {"casadi", "scipy", "matplotlib", "shapely"}


def test_show_a_folder_or_a_file(command: Command, results: Path) -> None:
    folder, file = command("show", "results"), command("show", "results/plan.npz")
    assert folder.code == file.code == 0
    assert folder.err == file.err == ""
    assert folder.out.splitlines()[0] == "small: plan found, proven for every member, no member of 200 violates"
    assert folder.out.splitlines()[-1] == "  files      results"
    more = command("show", "results", "--members", "300", "--substeps", "5", "--json")
    assert (more.data["replay"]["members"], more.data["replay"]["substeps"]) == (300, 5)
    assert more.data["exit_code"] == 0
    wrong = command("show", "results", "--members", "99999999999")
    assert wrong.code == 2
    assert "verify.members: expected a whole number from 1 to " in wrong.err


def corrupted(results: Path, kind: str) -> Path:
    """A file that is no plan any more."""
    file = results / "plan.npz"
    content = file.read_bytes()
    match kind:
        case "empty":
            file.write_bytes(b"")
        case "truncated":
            file.write_bytes(content[: len(content) // 2])
        case "flipped":
            file.write_bytes(content[:200] + bytes(255 - b for b in content[200:900]) + content[900:])
        case "text":
            file.write_text("hello")
        case "array":
            with file.open("wb") as stream:
                np.save(stream, np.zeros(3))
        case "other":
            np.savez(file, a=np.zeros(3))
        case "pickle":
            np.savez(file, controls=np.array([{}], dtype=object), problem=np.array(""), facts=np.array("{}"))
        case "facts":
            np.savez(file, controls=np.zeros((20, 2)), problem=np.array(SMALL), facts=np.array('{"status": 3}'))
    return file


@pytest.mark.parametrize("kind", ["empty", "truncated", "flipped", "text", "array", "other", "pickle", "facts"])
def test_show_a_file_that_is_no_plan(command: Command, results: Path, kind: str) -> None:
    corrupted(results, kind)
    done = command("show", "results")
    assert done.code == 2
    assert done.out == ""
    assert done.err == (
        "error: results/plan.npz: expected a plan.npz of this package, got another file or a damaged one\n"
    )


def test_show_a_plan_of_other_content(command: Command, results: Path) -> None:
    facts = np.array(json.dumps({"status": "planned", "details": {}}))
    np.savez(results / "plan.npz", controls=np.zeros((19, 2)), problem=np.array(SMALL), facts=facts)
    assert "results/plan.npz: controls: expected (20, 2) finite numbers" in command("show", "results").err
    np.savez(results / "plan.npz", controls=np.zeros((20, 2)), problem=np.array("a: 1"), facts=facts)
    done = command("show", "results")
    assert done.code == 2
    assert "results/plan.npz: problem:1:1: error: a: unknown field" in done.err


def test_show_what_is_not_there(command: Command, place: Path) -> None:
    done = command("show", "nowhere")
    assert (done.code, done.err) == (2, "error: nowhere: expected a saved plan, found no such file\n")
    (place / "empty").mkdir()
    done = command("show", "empty")
    assert (done.code, done.err) == (2, "error: empty/plan.npz: expected a saved plan, found a folder without one\n")


def test_verify_what_is_no_plan(command: Command, place: Path) -> None:
    done = command("verify", ".")
    assert (done.code, done.out) == (2, "")
    assert (
        done.err == f"error: {place.resolve()}: expected plan.npz, or controls.csv and problem.yaml, in this folder\n"
    )


def test_kinds_of_pictures_that_do_not_exist(command: Command) -> None:
    done = command("plot", "results", "trajectory")
    assert done.code == 2
    assert "trajectory: expected kinds among trajectories, controls" in done.err
    assert "did you mean 'trajectories'?" in done.err


def test_models(command: Command) -> None:
    done = command("models")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("unicycle ")
    assert "v [m/s], omega [rad/s]" in done.out
    assert "traction" in done.out


def test_examples(command: Command, place: Path) -> None:
    listed = command("examples")
    assert listed.code == 0
    names = [line.split()[0] for line in listed.out.splitlines()]
    assert "five_obstacles" in names
    assert all(len(line.split(maxsplit=1)) == 2 for line in listed.out.splitlines())
    titles = [line.split(maxsplit=1)[1] for line in listed.out.splitlines()]
    assert max(map(len, titles)) <= 120, "first sentences, none of them cut off"
    assert titles[names.index("minimum_time")].endswith("as soon as the slowest robot can")
    assert names == sorted(path.stem for path in CONFIGS.rglob("*.yaml"))
    assert ec.load_text(command("examples", "five_obstacles").out).name == "five_obstacles"
    for name in names:
        assert command("examples", name).out.startswith("# ")


def test_examples_copy(command: Command, place: Path) -> None:
    done = command("examples", "five_obstacles", "--copy")
    assert done.out == "wrote five_obstacles.yaml; now run: ensemble-plan five_obstacles.yaml\n"
    assert command("check", "five_obstacles.yaml").code == 0
    (place / "five_obstacles.yaml").write_text("mine")
    again = command("examples", "five_obstacles", "--copy")
    assert (again.code, again.out) == (2, "")
    assert again.err == "error: five_obstacles.yaml: this file exists already; nothing was written\n"
    assert (place / "five_obstacles.yaml").read_text() == "mine"


def test_examples_that_do_not_exist(command: Command) -> None:
    done = command("examples", "five_obstacle")
    assert done.code == 2
    assert "got 'five_obstacle'; did you mean 'five_obstacles'?" in done.err
    done = command("examples", "--copy")
    assert done.code == 2
    assert "--copy needs a name" in done.err


def test_doctor(command: Command) -> None:
    done = command("doctor")
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines()[0].startswith(f"ensemble_ctrl {ec.__version__}, Python 3.")
    for name in LIBRARIES:
        assert f"  {name} " in done.out
    assert "MISSING" not in done.out
    assert done.out.endswith("all works\n")


def test_doctor_lists_every_extra(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    from ensemble_ctrl.cli import doctor

    monkeypatch.setattr(doctor, "installed_version", lambda name: None if name in doctor.EXTRAS else "1.2")
    done = command("doctor")
    assert (done.code, done.err) == (0, "")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extra in set(project["optional-dependencies"]) - {"dev", "docs"}:
        assert f": ensemble-ctrl[{extra}]\n" in done.out
    monkeypatch.setattr(doctor, "installed_version", lambda name: "1.2")
    assert "  ompl        1.2\n" in command("doctor").out


def test_doctor_where_something_is_wrong(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    from ensemble_ctrl.cli import doctor
    from ensemble_ctrl.planning import planner

    def broken(*_: object, **__: object) -> None:
        raise ImportError("libipopt.so: not found")

    monkeypatch.setattr(planner, "solve", broken)
    done = command("doctor")
    assert done.code == 1
    assert "planning    FAILED: ImportError: libipopt.so: not found" in done.out
    monkeypatch.setattr(doctor, "installed_version", lambda name: None if name == "scipy" else "1")
    done = command("doctor")
    assert done.code == 1
    assert "problem: scipy not installed" in done.out


def test_every_command_has_help_that_fits_80_columns(command: Command) -> None:
    listing = command("--help").out
    assert "..." not in listing.split("Commands:")[1]
    assert [c.name or c.callback.__name__ for c in app.registered_commands if c.callback] == NAMES
    for name in NAMES:
        assert f"\n  {name} " in listing
    for arguments in ([], *([name] for name in NAMES)):
        for flag in ("--help", "-h"):
            done = command(*arguments, flag)
            assert (done.code, done.err) == (0, "")
            assert done.out.startswith("Usage: ensemble-plan")
            assert max(map(len, done.out.splitlines())) <= 80
    for name in set(NAMES) - {"models", "doctor"}:
        assert (
            f"Examples:\n    ensemble-plan {name if name != 'run' else 'problem.yaml'}" in command(name, "--help").out
        )
    assert "Exit codes:" in command("run", "--help").out
    assert "Exit codes:" in command("small.yaml", "--help").out


@pytest.mark.parametrize(
    "name",
    [
        "run",
        "check",
        "show",
        "report",
        "plot",
        "animate",
        "verify",
        "compare",
        "widest",
        "channels",
        "export",
        "online",
    ],
)
def test_consent_can_be_given_wherever_it_may_be_asked_for(command: Command, name: str) -> None:
    assert "--trust" in command(name, "--help").out


def test_version(command: Command) -> None:
    assert command("--version").out == f"ensemble-plan {ec.__version__}\n"
