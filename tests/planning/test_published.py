"""The paper's form from a problem file, and facets chosen on the whole grid, from all, or by the linear model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ensemble_ctrl.ocp.solvers.bonmin as bonmin_module
from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Offered, Problem

TEXT = """
name: small
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 8}
moments: {order: 2, coordinates: modal, integrator: rk4}
regions:
  goal: {box: [[2.5, 3.5], [-0.5, 0.5]]}
obstacles:
  wall: {box: [[0.8, 1.6], [-0.6, 2.0]]}
task: F[3, 4] in(goal) and G avoid(wall)
objective: {terminal: {target: [3, 0]}}
solve:
  {method: minlp, guarantee: moment, grid: full, facets: all, polish: false, margin: 0, bonmin_limit: 60 s}
"""


@cache
def small() -> Problem:
    return load_text(TEXT)


@cache
def published() -> Plan:
    return plan(small(), check=False)


def test_the_integer_solution_is_the_plan_as_it_is_returned() -> None:
    found = published()
    rounds = {r["name"]: r for r in found.details["minlp"]["rounds"]}
    assert list(rounds) == ["facets of the linear model", "all facets"]
    bonmin = rounds["all facets"]
    assert (bonmin["status"], bonmin["kept"], bonmin["switches"]) == ("solved", True, 4 * 8)
    assert bonmin["objective"] <= rounds["facets of the linear model"]["objective"] + 1e-3
    assert found.controls.shape == (8, 2)
    # the mean keeps out at the grid times; the certificate speaks of every member and all times
    mean = found.problem.fleet.trajectories(found.controls, found.problem.fleet.center[None], 0.5)[0]
    assert found.problem.obstacles["wall"][0].distance(mean).min() > -0.02
    assert found.certificate is not None


def test_a_killed_bonmin_leaves_the_facets_of_the_linear_model(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = small().with_(solve=replace(small().solve, bonmin_limit=0.05))
    found = solve(problem)
    first, second = found.rounds
    assert (first.status, first.kept) == ("solved", True)
    assert (second.status, second.message, second.attempt) == ("limit", "ended at the time limit", None)
    assert first.attempt is not None
    np.testing.assert_array_equal(found.controls, first.attempt.controls)

    monkeypatch.setattr(bonmin_module, "_started", _refused)
    found = solve(small())
    assert found.rounds[1].status == "failed"
    assert "could not be started" in found.rounds[1].message


def _refused(*_: object) -> None:
    """No process can be started."""
    raise OSError("no more processes")


@pytest.mark.parametrize("facets", ["all", "linear"])
def test_other_guarantees_choose_on_the_whole_grid_and_are_polished(facets: Offered) -> None:
    how = replace(small().solve, guarantee="hull", polish=True, facets=facets, margin=0.01, bonmin_limit=20.0)
    problem = small().with_(solve=how, coordinates="nodal", integrator="exponential")
    found = solve(problem)
    assert found.status == "planned"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.nlp is not None
    assert found.attempt.value.cost <= found.nlp.value.cost + 1e-9
    named = "all facets" if facets == "all" else "facets of the linear model"
    (chosen,) = [r for r in found.rounds if r.name == named]
    assert chosen.binaries == (4 * 8 if facets == "all" else 0) or chosen.binaries > 8
    assert any(r.name == "path of the linear model" for r in found.rounds) == (facets == "linear")


def test_without_polish_the_last_solution_is_kept_as_it_is() -> None:
    how = replace(small().solve, guarantee="nodes", facets="near", margin=0.01, bonmin_limit=20.0)
    found = solve(small().with_(solve=how, coordinates="nodal"))
    done = [r for r in found.rounds if r.attempt is not None]
    assert done
    assert done[-1].kept
    assert done[-1].attempt is not None
    np.testing.assert_array_equal(found.controls, done[-1].attempt.controls)
    assert not any("hyperplanes" in r.name for r in found.rounds)


def test_a_file_keeps_how_facets_are_chosen() -> None:
    again = load_text(dump(small())).solve
    assert (again.grid, again.facets, again.polish, again.bonmin_limit) == ("full", "all", False, 60.0)
    assert again.as_published
    assert not replace(again, polish=True).as_published
    assert not replace(again, grid="coarse").as_published
    assert not replace(again, guarantee="hull").as_published
