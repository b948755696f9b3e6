"""The benchmark of finding plans: what it draws is sound, and its record of best costs only improves."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, member_robustness
from ensemble_ctrl.core.jobs import Cluster

families: Any = importlib.import_module("benchmarks.finding.families")
best: Any = importlib.import_module("benchmarks.finding.best")
judge: Any = importlib.import_module("benchmarks.finding.judge")
run: Any = importlib.import_module("benchmarks.finding.run")
plain: Any = importlib.import_module("benchmarks.finding.plain")

ONE_OF_EACH = [
    *[(family, seed) for family in ("parking", "doors", "plants", "stlplanning") for seed in (0, 1)],
    *[("mazes", seed) for seed in (1, 2)],
    *[("stlpy", seed) for seed in range(7)],
    *[("plants", 2), ("plants", 3), ("stlplanning", 2), ("visits", 0), ("moving", 2), ("poles", 0)],
]
"""Every scenario at least once; those that are quick to draw."""


def test_there_are_a_hundred_problems_and_more() -> None:
    assert sum(count for count, _ in families.FAMILIES.values()) >= 100


@pytest.mark.parametrize("family", ["parking", "mazes", "stlpy", "moving", "plants", "impossible"])
def test_the_same_seed_draws_the_same_problem(family: str) -> None:
    first, again, other = (families.drawn(family, seed) for seed in (1, 1, 2))
    assert first.text == again.text
    assert first.digest == again.digest != other.digest
    if first.controls is not None:
        np.testing.assert_array_equal(first.controls, again.controls)


@pytest.mark.parametrize(("family", "seed"), ONE_OF_EACH)
def test_known_plans_are_proven(family: str, seed: int) -> None:
    case = families.drawn(family, seed)
    certificate = ec.certify(case.problem(), case.controls)
    assert certificate.proven == "yes"
    assert certificate.clearance >= 0.03


@pytest.mark.slow
@pytest.mark.parametrize("family", list(families.FAMILIES))
def test_every_problem_passes_the_check_and_every_known_plan_is_proven(family: str) -> None:
    for seed in range(families.FAMILIES[family][0]):
        case = families.drawn(family, seed)
        if not case.refused:
            problem = case.problem()
            assert case.reason or ec.certify(problem, case.controls).proven == "yes", case.name


@pytest.mark.parametrize("family", ["doors", "visits", "moving", "stlplanning", "plants"])
def test_other_seeds_draw_further_problems(family: str) -> None:
    case = families.drawn(family, 1003)
    assert ec.certify(case.problem(), case.controls).proven == "yes"
    assert len(case.problem().obstacles) <= 12


def test_obstacles_stand_in_the_way_closely() -> None:
    """Of a maze's rectangles, each is within 15 cm and a bit of the known way."""
    case = families.drawn("mazes", 7)
    closest = [c.distance for c in ec.replay(case.problem(), case.controls, members=20).clearances]
    assert len(closest) == 13
    assert max(closest) <= 0.16


@pytest.mark.parametrize("seed", range(6))
def test_impossible_problems_are_refused_where_the_check_can_prove_it(seed: int) -> None:
    case = families.drawn("impossible", seed)
    assert case.reason
    assert case.controls is None
    if case.refused:
        with pytest.raises(ec.ConfigError):
            case.problem()
    else:
        case.problem()


def test_the_best_known_only_improves(tmp_path: Path) -> None:
    file = tmp_path / "best.json"
    best.write(best.improved({}, "mazes-00", "a", 2.0, "known plan"), file)
    best.write(best.improved({}, "mazes-00", "a", 3.0, "planner"), file)
    assert best.read(file)["mazes-00"] == {"problem": "a", "cost": 2.0, "by": "known plan"}
    best.write(best.improved({}, "mazes-00", "a", 1.0, "planner"), file)
    assert best.read(file)["mazes-00"] == {"problem": "a", "cost": 1.0, "by": "planner"}
    best.write(best.improved({}, "mazes-00", "b", 5.0, "planner"), file)
    assert best.read(file)["mazes-00"]["cost"] == 5.0, "another problem of the same name"


def test_the_record_is_of_the_problems_that_are_drawn() -> None:
    record = best.read()
    for family in ("parking", "stlpy"):
        case = families.drawn(family, 1)
        assert record[case.name]["problem"] == case.digest


def test_a_half_written_line_is_tried_again(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    file.write_text(json.dumps({"name": "mazes-00"}) + '\n{"name": "maz', encoding="utf-8")
    assert run.kept(file) == [{"name": "mazes-00"}]


def test_a_killed_run_goes_on_where_it_stopped() -> None:
    cases = [families.drawn("impossible", seed) for seed in range(3)]
    wanted = [run.key(case, "planner", 60.0, "v1") for case in cases]
    done = {**wanted[1], "outcome": "none", "seconds": 1.0, "cost": None}
    assert run.untried(wanted, [done]) == [wanted[0], wanted[2]]
    for change in ({"limit": 30.0}, {"version": "v2"}, {"problem": "another"}, {"program": "plain"}):
        assert run.untried(wanted, [{**done, **change}]) == wanted, change


def test_problems_are_tried_in_processes_of_their_own(tmp_path: Path) -> None:
    about = run.key(families.drawn("impossible", 0), "planner", 60.0, "v1")
    file = tmp_path / "results.jsonl"
    file.write_text('{"name": "maz', encoding="utf-8")
    run.try_all([about, {**about, "family": "nothing"}], Cluster.parse("local:1"), file)
    row, wrong = run.kept(file)
    assert run.about_of(row, about) == about
    assert row["outcome"] == "refused"
    assert (wrong["outcome"], wrong["message"]) == ("error", "KeyError: 'nothing'")
    assert run.untried([about], run.kept(file)) == []


def test_a_problem_that_takes_far_too_long_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "MORE", -59.9)
    about = run.key(families.drawn("mazes", 5), "planner", 60.0, "v1")
    (row,) = run.attempts([about], Cluster.parse("local:1"))
    assert (row["outcome"], row["cost"]) == ("killed", None)
    assert row["seconds"] == pytest.approx(0.1)


def test_what_counts_as_right_and_wrong() -> None:
    maze = {"family": "mazes", "name": "mazes-00", "program": "planner", "seconds": 1.0, "cost": 1.0}
    rows = [{**maze, "outcome": outcome} for outcome in ("proven", "found", "none", "refused", "killed")]
    none = {"family": "impossible", "name": "impossible-00", "program": "planner", "seconds": 1.0, "cost": None}
    rows += [{**none, "outcome": outcome} for outcome in ("refused", "none", "proven", "error")]
    first, last = run.summary(rows)
    assert [first[name] for name in ("tried", "found", "proven", "wrong")] == [5, 2, 1, 1]
    assert [last[name] for name in ("tried", "found", "proven", "wrong")] == [4, 2, 1, 1]


@pytest.mark.parametrize(("family", "seed"), [("visits", 0), ("stlpy", 4), ("stlpy", 6), ("plants", 0), ("moving", 0)])
def test_the_plain_program_reads_every_kind_of_task(family: str, seed: int) -> None:
    """Its smooth robustness of a known plan is below the exact one, by little, and its clearances are positive."""
    case = families.drawn(family, seed)
    problem, fleet = case.problem(), case.problem().fleet
    step = plain.one_step(problem).mapaccum(problem.steps)
    start = fleet.start_states(fleet.center[None])
    states = ca.horzcat(start, step(start, case.controls.T))
    signals = StateSignals(np.asarray(states).T[None], fleet.system.states, problem.duration / problem.steps)
    parts = [member_robustness(part.formula, signals, ExactOps())[0, 0] for part in problem.specification.rest]
    assert min(parts) - 0.8 <= float(plain.task_value(problem)(states)) <= min(parts)
    replayed = ec.replay(problem, case.controls, parameters=fleet.center[None], substeps=1)
    exact = {c.obstacle: c.distance for c in replayed.clearances}
    smooth = [float(np.asarray(row).min()) for row in plain.clearances(problem, states)]
    for avoid, value in zip(problem.specification.avoid, smooth, strict=True):
        assert exact[avoid.name] / 2 - 0.02 <= value <= exact[avoid.name], avoid.name


def test_guesses_and_plans_that_run_away_are_judged() -> None:
    case = families.drawn("plants", 2)
    problem = case.problem(20.0)
    assert judge.verdict(problem, np.full_like(case.controls, 2.0)) == "none"
    assert judge.cost(problem, np.full_like(case.controls, 2.0)) == np.inf
    assert judge.verdict(problem, case.controls) == "proven"
    assert plain.plain(problem, 20.0)["outcome"] in ("none", "found", "proven")


def test_the_plain_program_finds_what_is_easy() -> None:
    case = families.drawn("impossible", 2)
    easy = ec.load_text(case.text, "<text>", ["regions.goal.box=[[2, 3], [-0.5, 0.5]]"])
    found = plain.plain(easy, 20.0)
    assert found["outcome"] in ("found", "proven")
    assert found["seconds"] <= 20.0
