"""The paper's experiments: every problem file plans, is proven for the whole fleet, and its baseline violates."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from ensemble_ctrl.files.config import load, read
from ensemble_ctrl.planning.baseline import unconstrained
from ensemble_ctrl.planning.planner import Solution, solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.examples import quick
from tests.paths import CONFIGS

PRINTED = json.loads((CONFIGS.parent / "docs" / "_static" / "gallery" / "facts.json").read_text(encoding="utf-8"))
"""What the gallery prints of each problem."""
COSTS = {path.stem: PRINTED[path.stem]["cost"] for path in CONFIGS.glob("*.yaml")}
"""Cost of the plan of each experiment; another good plan may differ by a little, or be better."""
NUMBERS = {"one": 1, "three": 3, "five": 5, "six": 6, "seven": 7, "eight": 8}
every = pytest.mark.parametrize("name", sorted(COSTS))
experiments = pytest.mark.parametrize("name", quick(sorted(COSTS), "box", "one_obstacles", "five_obstacles"))


@cache
def problem(name: str) -> Problem:
    """The problem of an experiment."""
    return load(CONFIGS / f"{name}.yaml")


@cache
def solution(name: str) -> Solution:
    """Its plan, made once."""
    return solve(problem(name))


def test_every_experiment_of_the_paper_is_here() -> None:
    assert {"box", "polyhedron", "two_waypoints", *(f"{word}_obstacles" for word in NUMBERS)} == set(COSTS)


@experiments
def test_the_gallery_prints_what_a_run_finds(name: str) -> None:
    found, printed = solution(name), PRINTED[name]
    assert found.certificate is not None
    assert printed["proven"] == found.certificate.proven
    assert found.attempt.value.cost == pytest.approx(printed["cost"], rel=0.02, abs=2e-3)
    for number, bound in (("clearance", found.certificate.clearance), ("robustness", found.certificate.robustness)):
        assert printed[number] is None or printed[number] == pytest.approx(bound, abs=5e-3)


@every
def test_it_loads_without_a_warning(name: str) -> None:
    loaded = read(CONFIGS / f"{name}.yaml")
    assert loaded.warnings == ()
    assert (loaded.problem.name, loaded.problem.solve.guarantee, loaded.problem.report.baseline) == (name, "hull", True)
    assert (loaded.problem.fleet.lower[0], loaded.problem.fleet.upper[0]) == (0.9, 1.1)


@experiments
def test_it_is_planned_and_proven_for_every_member(name: str) -> None:
    found = solution(name)
    assert found.status == "planned"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.certificate.clearance >= 0
    assert found.certificate.robustness >= 0
    assert found.attempt.value.cost <= 1.05 * COSTS[name] + 0.02


@experiments
def test_no_member_violates_it_between_the_grid_times_either(name: str) -> None:
    found = solution(name)
    run = replay(problem(name), found.controls, members=5000, substeps=10)
    assert not run.violating.any()
    assert found.certificate is not None
    assert all(c.distance >= found.certificate.clearance - 1e-9 for c in run.clearances)


@experiments
def test_the_unconstrained_baseline_violates_it(name: str) -> None:
    baseline = solve(unconstrained(problem(name)))
    assert baseline.status == "planned"
    run = replay(problem(name), baseline.controls, members=200, substeps=4)
    assert run.violating.mean() > 0.5
    assert run.worst[0] < -0.1


# --- what the paper prints


def test_the_box_of_the_paper() -> None:
    box = problem("box")
    assert (box.duration, box.steps, box.order, str(box.task)) == (2.0, 200, 4, "G in(room)")
    assert box.fleet.position.tolist() == [0, 0]
    assert box.objective.place is not None
    assert box.objective.place.tolist() == [3, 2]


def test_the_polyhedron_of_the_paper() -> None:
    polyhedron = problem("polyhedron")
    assert (polyhedron.duration, polyhedron.order, str(polyhedron.task)) == (2.0, 8, "G in(strip)")
    printed = [(3, 2, -0.5), (-3, -2, -14), (-3, 2, -6), (3, -2, -1), (0, 1, -0.1), (0, -1, -2.1)]
    strip = polyhedron.regions["strip"]
    np.testing.assert_allclose(np.column_stack([strip.A, strip.lower]), printed)
    assert np.isinf(strip.upper).all()


@pytest.mark.parametrize("word", NUMBERS)
def test_the_obstacles_of_the_paper(word: str) -> None:
    obstacles = problem(f"{word}_obstacles")
    assert (obstacles.duration, obstacles.order, len(obstacles.obstacles)) == (16.0, 8, NUMBERS[word])
    assert str(obstacles.task) == "F[14,16] in(goal) and G[0,16] avoid(obstacles)"


def test_the_shapes_vary() -> None:
    corners = {len(piece.vertices) for word in NUMBERS for _, piece in problem(f"{word}_obstacles").pieces}
    assert {3, 4, 5} <= corners
    assert any(len(p) > 1 for word in NUMBERS for p in problem(f"{word}_obstacles").obstacles.values())
