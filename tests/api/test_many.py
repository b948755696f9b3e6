"""Many problems at once: plans as texts, the same wherever they are made, kept and resumed."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.planned import FACTS, row_of
from ensemble_ctrl.api.portable import plan_of, plan_text
from ensemble_ctrl.certificate import as_data
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.files.config.portable import problem_of, problem_text
from tests.paths import CONFIGS

SMALL = """
name: small
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s, steps: 10}
regions: {goal: {box: [[1.5, 2.5], [-0.5, 0.5]]}}
task: F[3, 4] in(goal)
verify: {members: 50}
"""


def small(*overrides: str) -> ec.Problem:
    return ec.load_text(SMALL, overrides=overrides)


def alike(one: ec.Plan, other: ec.Plan) -> None:
    """Two plans are the same, but for what they took."""
    np.testing.assert_array_equal(one.controls, other.controls)
    assert (one.status, one.details["cost"], dump(one.problem)) == (
        other.status,
        other.details["cost"],
        dump(other.problem),
    )
    assert one.replayed is not None
    assert other.replayed is not None
    np.testing.assert_array_equal(one.replayed.robustness, other.replayed.robustness)
    assert one.certificate is not None
    assert other.certificate is not None
    ours, theirs = as_data(one.certificate), as_data(other.certificate)
    assert ours | {"seconds": 0} == theirs | {"seconds": 0}


@pytest.mark.parametrize("path", sorted(CONFIGS.rglob("*.yaml")), ids=lambda path: path.stem)
def test_a_problem_is_the_same_after_the_way_through_a_text(path: Path) -> None:
    problem = ec.load(path)
    with problem_of(problem_text(problem)) as again:
        assert problem_text(again) == problem_text(problem)


def test_a_plan_is_the_same_after_the_way_through_a_text() -> None:
    found = ec.plan(small())
    again = plan_of(plan_text(found), found.problem)
    alike(found, again)
    assert found.replayed is not None
    assert again.replayed is not None
    assert [asdict(c) for c in again.replayed.clearances] == [asdict(c) for c in found.replayed.clearances]
    assert again.replayed.share() == found.replayed.share()
    assert repr(again.certificate) == repr(found.certificate)
    assert again.problem is found.problem


def test_of_the_shortest_plan_the_problem_is_that_of_its_duration() -> None:
    problem = small("horizon.duration={at_least: 1 s, at_most: 4 s}", "task=F in(goal)")
    found = ec.plan(problem, check=False)
    again = plan_of(plan_text(found), problem)
    assert again.problem.duration == found.problem.duration < 4
    assert again.certify().proven == "yes"


def test_a_system_of_the_users_goes_with_its_problem(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(OWN, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(OF_OWN, encoding="utf-8")
    text = problem_text(ec.load(tmp_path / "mine.yaml", trust=True))
    (tmp_path / "mine.py").unlink()
    with problem_of(text) as again:
        assert type(again.fleet.system).__name__ == "Mine"
        assert again.fleet.system.states == ("x", "y", "vx", "vy")


OWN = """
from ensemble_ctrl.systems import DoubleIntegrator


class Mine(DoubleIntegrator):
    name = "mine"
"""
OF_OWN = """
fleet: {model: {python: "mine.py:Mine"}, start: {position: [0, 0]}}
horizon: {duration: 2 s, steps: 10}
regions: {goal: {box: [[-1, 1], [-1, 1]]}}
task: F in(goal)
"""


def test_plans_come_with_their_place_and_are_those_of_one_process() -> None:
    problems = [small(f"horizon.steps={steps}") for steps in (8, 10)]
    found = {one.index: one for one in ec.plan_many(problems, cluster="local:2")}
    assert sorted(found) == [0, 1]
    for index, problem in enumerate(problems):
        assert found[index].problem is problem
        plan = found[index].plan
        assert plan is not None
        alike(plan, ec.plan(problem))


def test_problems_are_taken_as_workers_get_free(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    taken: list[int] = []

    def many() -> object:
        for k in range(1000):
            taken.append(k)
            yield path

    running = ec.plan_many(many(), cluster="local:1")  # type: ignore[arg-type]
    first = next(running)
    assert first.plan is not None
    assert first.plan.verified
    running.close()  # type: ignore[attr-defined]
    assert len(taken) <= 3


def test_kept_plans_are_not_made_again(tmp_path: Path) -> None:
    kept = tmp_path / "plans.jsonl"
    (first,) = ec.plan_many([small()], cluster="local:1", checkpoint=kept)
    size = kept.stat().st_size
    (again,) = ec.plan_many([small()], cluster="local:1", checkpoint=kept)
    assert kept.stat().st_size == size
    assert first.plan is not None
    assert again.plan is not None
    alike(first.plan, again.plan)
    assert again.plan.details["seconds"] == first.plan.details["seconds"]
    json.loads(kept.read_text(), parse_constant=pytest.fail)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(ec.ProblemError, match=r"problems: expected several problems or paths, as \[problem\], got one"):
        ec.plan_many(small())  # type: ignore[arg-type]
    with pytest.raises(ec.ProblemError, match=r"problems\[0\]: expected a Problem, got 3 \(int\)"):
        list(ec.plan_many([3], cluster="local:1"))  # type: ignore[list-item]
    with pytest.raises(ec.ProblemError, match="cluster: expected local, local:N or tcp"):
        ec.plan_many([small()], cluster="here")


def test_a_row_has_what_is_proven() -> None:
    found = ec.plan(small())
    row = row_of(found)
    assert tuple(row) == FACTS
    assert found.certificate is not None
    assert (row["proven"], row["robustness"]) == ("yes", found.certificate.robustness)
    assert row["clearance"] is None  # infinite: there is no obstacle
    assert row["message"] == ""
    unproven = row_of(ec.plan(small("verify.certificate=false")))
    assert unproven["proven"] is None
    assert unproven["robustness"] > 0
