"""What a new user types first: init, schema, completion."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from ensemble_ctrl.cli.init import schema_text, starter_text
from ensemble_ctrl.files.config import read_text
from tests.paths import CONFIGS

from .conftest import Command
from .tools import COMMAND, environment, left


def test_init_writes_a_problem_that_is_planned_and_proven(command: Command, place: Path) -> None:
    done = command("init")
    assert (done.code, done.out, done.err) == (
        0,
        "wrote problem.yaml; now run: ensemble-plan problem.yaml\n",
        "",
    )
    assert command("check", "problem.yaml").out == "problem.yaml: ok\n"
    planned = command("problem.yaml", "-q", "--no-plots")
    assert planned.code == 0, planned.err
    assert planned.out.startswith("problem: plan found, proven for every member, no member of 10000 violates\n")


def test_every_part_of_the_starter_is_explained() -> None:
    text = starter_text()
    assert read_text(text, "problem.yaml").warnings == ()
    before = text.splitlines()[0]
    for line in text.splitlines()[1:]:
        if line and line[0].isalpha() and not line.startswith("version"):
            assert before.startswith("# "), line
        before = line


def test_init_never_writes_over_anything(command: Command, place: Path) -> None:
    (place / "mine.yaml").write_text("mine")
    (place / "folder").mkdir()
    before = left(place)
    for name, why in (
        ("mine.yaml", "this file exists already; nothing was written"),
        ("folder", "a folder of this name exists already; nothing was written"),
        ("nowhere/new.yaml", "can't be written (No such file or directory)"),
    ):
        done = command("init", name, "--schema")
        assert (done.code, done.out, done.err) == (2, "", f"error: {name}: {why}\n")
    assert (place / "mine.yaml").read_text() == "mine"
    assert left(place) == before


def test_init_with_a_name_of_its_own(command: Command, place: Path) -> None:
    assert command("init", "my fleet.yaml").out.endswith("now run: ensemble-plan 'my fleet.yaml'\n")
    text = (place / "my fleet.yaml").read_text(encoding="utf-8")
    assert "ensemble-plan check my fleet.yaml" in text
    assert "plans/my fleet/" in text
    assert command("init", "-").out == starter_text()


def test_init_with_the_schema_beside_it(command: Command, place: Path) -> None:
    done = command("init", "--schema")
    assert done.out.splitlines()[1] == "wrote problem.schema.json, for editors"
    first = (place / "problem.yaml").read_text(encoding="utf-8").splitlines()[0]
    assert first == "# yaml-language-server: $schema=problem.schema.json"
    assert (place / "problem.schema.json").read_text(encoding="utf-8") == schema_text()
    assert command("init", "other.yaml", "--schema").out.count("wrote") == 1


def test_schema(command: Command, place: Path) -> None:
    assert json.loads(command("schema").out)["required"] == ["fleet", "horizon", "task"]
    assert command("schema", "-o", "s.json").out.startswith("wrote s.json; ")
    assert (place / "s.json").read_text(encoding="utf-8") == schema_text()
    (place / "s.json").write_text((place / "s.json").read_text(encoding="utf-8").replace("horizon", "time"))
    assert command("schema", "-o", "s.json").code == 0
    assert (place / "s.json").read_text(encoding="utf-8") == schema_text()
    done = command("schema", "-o", "small.yaml")
    assert (done.code, done.err) == (2, "error: small.yaml: this file exists already; nothing was written\n")


def test_an_example_is_copied_with_its_tables(command: Command, place: Path) -> None:
    done = command("examples", "measured", "--copy")
    assert done.out == "wrote measured.yaml, measured.csv; now run: ensemble-plan measured.yaml\n"
    assert command("check", "measured.yaml").out == "measured.yaml: ok\n"
    assert "$schema" not in (place / "measured.yaml").read_text(encoding="utf-8")
    (place / "measured.yaml").unlink()
    done = command("examples", "measured", "--copy")
    assert (done.code, done.err) == (2, "error: measured.csv: this file exists already; nothing was written\n")
    assert not (place / "measured.yaml").exists()


@pytest.mark.parametrize("name", sorted(path.stem for path in CONFIGS.rglob("*.yaml")))
def test_every_example_is_whole_when_it_is_copied(command: Command, place: Path, name: str) -> None:
    assert command("examples", name, "--copy").code == 0
    done = command("check", f"{name}.yaml")
    assert (done.code, done.err) == (0, ""), done.err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["che"], ["check"]),
        (["verify", "--r"], ["--range"]),
        (["small.yaml", "--ov"], ["--overwrite"]),
        (["chec", "--ov"], ["--overwrite"]),
        (["small.yaml", ""], []),
        (["examples", "six"], ["six_obstacles"]),
        (["plot", "results", "c"], ["controls", "clearance", "certificate"]),
        (["plot", "results", "--format", "p"], ["png", "pdf"]),
        (["small.yaml", "--method", ""], ["nlp", "minlp"]),
        (["small.yaml", "--animate", "m"], ["mp4"]),
        (["check", "small.yaml", "--set", "hor"], ["horizon.duration=", "horizon.steps="]),
        (["export", "results", "--to", "g"], ["geojson"]),
    ],
)
def test_bash_completes(place: Path, words: list[str], expected: list[str]) -> None:
    line = "\n".join(["ensemble-plan", *words])
    asked = {"_ENSEMBLE_PLAN_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    done = subprocess.run(COMMAND, capture_output=True, text=True, env=environment(**asked), cwd=place)
    assert done.stderr == ""
    assert done.stdout.split() == expected


def test_the_script_for_completion(place: Path) -> None:
    arguments = [*COMMAND, "--show-completion", "bash"]
    test = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run(arguments, capture_output=True, text=True, env=environment(**test), cwd=place)
    assert "_ENSEMBLE_PLAN_COMPLETE=complete_bash" in done.stdout
