"""Exit codes: what a script can tell from them, and what a person is told with them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec

from .conftest import Command
from .tools import FAST

QUICK = ("--no-plots", "-q")


def test_a_walled_in_goal_names_what_conflicts(command: Command, place: Path) -> None:
    done = command("walled.yaml", *QUICK, *FAST, "--json")
    assert (done.code, done.data["exit_code"]) == (3, 3)
    assert (done.data["status"], done.data["verified"]) == ("infeasible", False)
    worst = done.data["conflicts"][0]
    assert set(worst) == {"what", "amount", "unit", "parameters", "time", "start"}
    assert worst["amount"] > 0
    assert 0.9 <= worst["parameters"]["traction"] <= 1.1
    assert 0 <= worst["time"] <= 4
    conflict = r"(avoid\((west|east|north|south)\)|.*in\(goal\)).* by [\d.e-]+ m \(traction [\d.]+, t = [\d.]+ s\)"
    lead = "error: walled: no plan was found; violated near the best guess: "
    assert re.fullmatch(rf"{lead}.*{conflict}.*\n", done.err)
    assert ec.Plan.load(place / "plans/walled").status == "infeasible"
    again = command("show", "plans/walled")
    assert again.code == 3
    assert again.out.startswith("walled: NO PLAN FOUND")
    assert re.search(rf"\n  violated +.*{conflict}\n", again.out), again.out
    assert "\n  it works   with no obstacle west: planned and proven\n" in again.out
    assert re.search(
        "no plan was found even with a horizon of .*; traction .*; nothing kept", " ".join(again.out.split())
    )
    assert max(map(len, again.out.splitlines())) <= 120
    tried = done.data["details"]["suggestions"]
    assert [(found["change"], found["set"]) for found in tried["helps"]] == [("no obstacle west", [])]


@pytest.mark.slow
@pytest.mark.parametrize("arguments", ["--no-suggest", "--set=report.suggest=false"])
def test_without_suggestions(arguments: str, command: Command, place: Path) -> None:
    done = command("walled.yaml", *QUICK, *FAST, arguments)
    assert done.code == 3
    assert re.search("\n  try .*longer horizon.*input bounds.*narrower", done.out)


def test_a_plan_that_some_members_violate(command: Command, results: Path) -> None:
    plan = ec.Plan.load(results)
    straight = ec.Plan(plan.problem, np.tile([0.6, 0.0], (20, 1)), "planned")
    straight.save("straight.npz")
    done = command("show", "straight.npz")
    assert done.code == 4
    assert done.out.startswith("small: plan found, NOT proven for every member, 200 of 200 members VIOLATE it\n")
    assert "  violated   avoid(block) by " in done.out


def test_the_time_limit_keeps_the_best_plan(command: Command, place: Path) -> None:
    done = command("small.yaml", *QUICK, "--time-limit", "1ms")
    assert done.code == 5
    assert done.out.startswith("small: limit reached, best plan so far")
    plan = ec.Plan.load(place / "plans/small")
    assert plan.status == "limit"
    assert plan.problem.solve.time_limit == 0.001
    assert command("show", "plans/small").code == 5


def test_a_generous_time_limit_changes_nothing(command: Command) -> None:
    assert command("small.yaml", *QUICK, "--time-limit", "2 min").code == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "bad.yaml: error: no such file"),
        ("", "bad.yaml: error: this file is empty"),
        ("a: [", "bad.yaml:1:5: error: "),
        ("- 1", "bad.yaml:1:1: error: expected a problem with fleet, horizon and task"),
        ("name: a\nname: b\n", "bad.yaml:2:1: error: name: given twice, first on line 1"),
        ("\0\1\2", "bad.yaml: error: expected a text file, got a binary one"),
    ],
)
def test_a_bad_file_is_a_clear_message(command: Command, place: Path, text: str | None, words: str) -> None:
    if text is not None:
        (place / "bad.yaml").write_text(text)
    for arguments in (["bad.yaml"], ["run", "bad.yaml", "--no-plots"], ["check", "bad.yaml"]):
        done = command(*arguments)
        assert done.code == 2
        assert done.out == ""
        assert done.err.startswith(words) or f"\n{words}" in done.err
        assert "Traceback" not in done.err
        assert re.search(r"\d+ errors? in bad.yaml\n$", done.err)
    assert not (place / "plans").exists()


def test_a_folder_is_not_a_problem(command: Command, place: Path) -> None:
    (place / "sub").mkdir()
    done = command("sub")
    assert done.code == 2
    assert "sub: error: this is a folder" in done.err


def test_a_word_much_like_a_command(command: Command, place: Path) -> None:
    for typo, meant in (("rum", "run"), ("chekc", "check"), ("exmaples", "examples"), ("docter", "doctor")):
        done = command(typo)
        assert done.code == 2
        assert done.err == f"error: {typo}: there is no such command or file; did you mean {meant!r}?\n"
    assert command("missing.yaml").err.startswith("missing.yaml: error: no such file")
    assert "did you mean 'small.yaml'?" in command("smal.yaml").err


def test_an_option_much_like_another(command: Command) -> None:
    done = command("small.yaml", "--jsn")
    assert done.code == 2
    assert "--jsn" in done.err.splitlines()[0]
    assert "--json" in done.err.splitlines()[0]
    assert done.err.splitlines()[1] == "try 'ensemble-plan run --help'"


def test_without_a_file(command: Command) -> None:
    assert command().code == 2
    assert "Usage: ensemble-plan" in command().err
    missing = command("run")
    assert missing.code == 2
    assert missing.err.startswith("error: missing argument 'CONFIG'\n")
    extra = command("small.yaml", "walled.yaml")
    assert extra.code == 2
    assert "walled.yaml" in extra.err
