"""Facets by HiGHS for systems that an ODE defines: exact for linear ones, against brute force over the ways around."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import load
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.linearised_facets import BLOCKS, ROOM, linearised_facets
from ensemble_ctrl.ocp.state_rounds import whole
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Objective, Problem, SolveOptions
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import DoubleIntegrator
from tests.paths import CONFIGS

MINLP = CONFIGS / "minlp" / "unknown_mass_minlp.yaml"


def masses(low: float, high: float, guarantee: str = "nodes", **more: object) -> Problem:
    """Point masses with some speed, and a block from `low` to `high` in their way."""
    fleet = Fleet(DoubleIntegrator(), {"mass": Interval(0.95, 1.05)}, radius=0.1, start={"vx": 1.0})
    return Problem(
        "facets",
        fleet,
        4.0,
        16,
        parse("G avoid(block) and F[3,4] in(goal)"),
        {"goal": Polyhedron.box([[3.0, 5.0], [-1.0, 1.0]])},
        {"block": (Obstacle.box([[1.5, 2.5], [low, high]]),)},
        objective=Objective(0.0, np.array([4.0, 0.0]), 0.1, 1.0),
        solve=SolveOptions(guarantee=guarantee),  # type: ignore[arg-type]
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("guarantee", ["nodes", "hull"])
@pytest.mark.parametrize(("low", "high", "side"), [(-0.9, 0.3, 1.0), (-0.3, 0.9, -1.0)])
def test_the_cheaper_way_around_is_chosen_wherever_the_plan_goes(
    guarantee: str, low: float, high: float, side: float
) -> None:
    """The plan that it starts from goes straight through the block, or around it on the dearer side."""
    problem = masses(low, high, guarantee)
    truncation = whole(problem)
    for push in (0.0, -0.6 * side):
        controls = np.zeros((16, 2))
        controls[:4, 1], controls[4:12, 1], controls[12:, 1] = push, -push, push
        found = linearised_facets(problem, truncation, controls, 2.0, 20.0)
        assert found.short < 1e-6
        assert found.bound <= found.cost + 1e-9
        members = problem.fleet.dynamic_members(truncation.nodes)
        paths = trajectories(problem, found.controls, members)
        assert (np.sign(paths[:, 7, 1]) == side).all()  # beside the block
        # one facet has all nodes behind it at both ends of each step
        (block,) = problem.obstacles["block"]
        normals, levels = block.unit_rows()
        gaps = (paths @ normals.T - levels - 0.1 - ROOM).min(axis=0)
        both = np.array([np.minimum(a, b) for a, b in pairwise(gaps)])
        assert (both[1:].max(axis=1) >= -1e-6).all()
        margin = problem.regions["goal"].margin(paths).min(axis=0)
        assert margin[12:].max() >= -1e-6


def test_the_cost_is_the_least_of_all_ways_around() -> None:
    """Brute force: the same program with one way closed by a wall, and with the other."""
    problem = masses(-0.5, 0.3)
    truncation, controls = whole(problem), np.zeros((16, 2))
    both = linearised_facets(problem, truncation, controls, 2.0, 20.0)
    ways = []
    for wall in ([[1.5, 2.5], [0.2, 9.0]], [[1.5, 2.5], [-9.0, -0.4]]):
        closed = problem.with_(
            obstacles={**problem.obstacles, "wall": (Obstacle.box(wall),)},
            task=parse("G avoid(obstacles) and F[3,4] in(goal)"),
        )
        ways.append(linearised_facets(closed, truncation, controls, 2.0, 20.0).cost)
    assert max(ways) > 1.05 * min(ways)
    assert both.cost == pytest.approx(min(ways), rel=0.03)


def test_a_moving_block_is_kept_out_of_where_it_is() -> None:
    """It has left when the fleet would be there: nothing is to be avoided, and no effort is spent on it."""
    still = masses(-0.9, 0.3)
    leaving = still.with_(motions={"block": Motion.steady([0.0, -3.0], 4.0)})
    truncation, controls = whole(still), np.zeros((16, 2))
    costs = [linearised_facets(one, truncation, controls, 2.0, 20.0).cost for one in (still, leaving)]
    assert costs[1] < 0.8 * costs[0]


def test_commands_change_no_more_than_they_are_trusted() -> None:
    problem = masses(-0.9, 0.3)
    controls = np.random.default_rng(0).uniform(-1, 1, (16, 2))
    found = linearised_facets(problem, whole(problem), controls, 0.1, 20.0)
    assert BLOCKS == 16
    assert np.abs(found.controls - controls).max() <= 0.1 * 2.0 + 1e-9


def test_the_plan_of_a_config_takes_the_cheaper_way_and_is_proven() -> None:
    problem = load(MINLP)
    found = solve(problem)
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.nlp is not None
    assert found.attempt.value.cost < 0.5 * found.nlp.value.cost
    assert any(one.kept for one in found.rounds)
    plain = solve(problem.with_(solve=replace(problem.solve, method="nlp")))
    assert found.nlp.value.cost == pytest.approx(plain.attempt.value.cost, rel=1e-3)
    middle = trajectories(problem, found.controls, problem.fleet.center[None])[0]
    assert middle[np.abs(middle[:, 0] - 2.0).argmin(), 1] > 0.8


def test_the_plan_stays_where_nothing_is_better() -> None:
    problem = masses(-0.9, 0.3, "hull")
    found = solve(problem.with_(solve=SolveOptions(method="minlp")))
    assert found.nlp is not None
    assert found.attempt.value.cost <= found.nlp.value.cost + 1e-9
