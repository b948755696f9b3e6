"""What robots on arcs have, other systems have: each feature on a small problem of point masses, with a proof."""

from __future__ import annotations

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.comparison import left_out
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.ocp.evaluate_sampled import evaluate
from ensemble_ctrl.ocp.state_rounds import whole
from ensemble_ctrl.problem.capabilities import FEATURES, supports
from ensemble_ctrl.problem.evaluation.sampled import trajectories

MASSES = """
fleet:
  {{model: double_integrator, parameters: {{mass: {{range: [0.95, 1.05]}}}}, start: {{position: [0, 0]}}, radius: 0.1}}
horizon: {{duration: {duration}, steps: 20}}
regions: {{goal: {{box: [[1.5, 2.5], [-0.5, 0.5]]}}}}
obstacles: {{post: {{box: [[0.9, 1.1], [-2, -1]]}}}}
{more}
task: {visit} in(goal) and G avoid(post)
verify: {{members: 200}}
"""


def masses(more: str = "", duration: str = "4 s", visit: str = "F[3, 4]") -> ec.Problem:
    """Point masses on their way to a goal, with a post beside it unless it is moved."""
    return ec.load_text(MASSES.format(more=more, duration=duration, visit=visit))


def proven(problem: ec.Problem) -> ec.Plan:
    """A plan for it, for every member and instant."""
    plan = ec.plan(problem)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0
    return plan


def test_a_moving_obstacle_in_the_plane() -> None:
    """It crosses the straight way when the fleet would be there: a plan that ignores it is refuted."""
    moving = masses("motions: {post: {path: [[0, [0, 0]], [4, [0, 3]]]}}")
    plan, blind = proven(moving), proven(masses())
    certificate = ec.certify(moving, blind.controls)
    assert certificate.proven == "no"
    (seen,) = plan.replay(200, substeps=10).clearances
    assert seen.distance >= certificate.clearance
    assert seen.distance >= plan.certificate.clearance - 1e-9  # type: ignore[union-attr]
    assert dump(ec.load_text(dump(moving))) == dump(moving)


def test_a_moving_obstacle_in_space() -> None:
    text = """
    fleet:
      model: quadrotor
      settings: {mass: 6}
      parameters: {payload: {range: [0, 0.1]}}
      start: {position: [0, 0, 2]}
    horizon: {duration: 1 s, steps: 20}
    obstacles: {plate: {box: [[-0.5, 0.5], [-0.5, 0.5], [0.0, 0.2]]}}
    motions: {plate: {velocity: [0, 0, 1.3]}}
    task: G avoid(plate) and G (z <= 2.6)
    verify: {members: 100}
    """
    problem = ec.load_text(text)
    fleet = problem.fleet
    hover = np.tile(fleet.rest(fleet.center), (20, 1))
    assert ec.certify(problem, hover).clearance < 0.55  # above the plate, which rises by 1.3 m
    proven(problem)


@pytest.mark.parametrize(
    "target",
    [
        "{mass: [[0.95, [2.1, 0]], [1.05, [1.9, 0]]]}",
        "{moments: [[2.8, 0], [0, 0]]}",
        "{mean: [2, 0], covariance: [[0.01, 0], [0, 0.01]]}",
    ],
    ids=["formation", "moments", "spread"],
)
def test_targets_of_the_whole_fleet(target: str) -> None:
    """The cost counts how far the fleet ends from it, and a plan for it ends closer than one without."""
    problem = masses(f"objective: {{terminal: {{target: {target}, weight: 10}}}}")
    plan, other = proven(problem), proven(masses())
    assert evaluate(problem, plan.controls).terminal < evaluate(problem, other.controls).terminal
    assert plan.details["arrival"]


def test_what_is_not_for_a_system_is_refused_with_the_reason() -> None:
    problem = masses()
    refused = {name for name in FEATURES if not supports(problem, name)}
    assert refused == {"modal", "footprint", "speed limits", "terrain"}
    for name in refused:
        found = supports(problem, name)
        assert not found
        assert FEATURES[name].why in found.message


def test_the_guarantee_moment_is_about_the_mean() -> None:
    """The mean does the task, which some members fail: the paper's rows are necessary only, and the proof says so."""
    around = "objective: {robustness: 0, effort: 1}\nmotions: {post: {path: [[0, [0, 1.6]], [4, [0, 1.6]]]}}"
    problem = masses(f"{around}\nsolve: {{guarantee: moment}}")
    problem = problem.with_(fleet=problem.fleet.with_(parameters={"mass": ec.Interval(0.7, 1.3)}))
    plan = ec.plan(problem.with_(verify=ec.VerifyOptions(members=100, certificate=False)), check=False)
    assert plan.status == "planned"
    paths = trajectories(problem, plan.controls, problem.fleet.sample(4000, seed=3), 4)
    mean = paths.mean(axis=0)
    # the post, moved up, is [0.9, 1.1] x [-0.4, 0.6]; the goal is to be visited in the last second
    away = np.abs(mean - [1.0, 0.1]) - [0.1, 0.5]
    assert (np.hypot(*np.maximum(away, 0.0).T) >= 0.1).all()
    assert np.abs(mean[60:] - [2.0, 0.0]).max(axis=1).min() <= 0.5
    nearest = np.abs(paths[:, 60:] - [2.0, 0.0]).max(axis=2).min(axis=1)
    assert nearest.min() <= 0.5 < nearest.max()
    assert ec.certify(problem, plan.controls).proven == "no"


def test_cells_have_hyperplanes_of_their_own() -> None:
    problem = masses("solve: {cells: 2}")
    assert len(whole(problem).parts) == 2
    proven(problem)


def test_the_unconstrained_baseline() -> None:
    """The post is in the way of the plan, and not of the baseline, which goes straight through it."""
    problem = masses("motions: {post: {path: [[0, [0, 1.5]], [4, [0, 1.5]]]}}\nreport: {baseline: true}")
    straight = ec.plan(ec.unconstrained(problem), check=False)
    assert ec.certify(problem, straight.controls).proven == "no"
    proven(problem)


@pytest.mark.slow
def test_the_shortest_plan() -> None:
    """A mass that is pushed by 2 N for half the time and against it for the other half needs 2 sqrt(d m / F)."""
    problem = masses(more="solve: {time_limit: 60 s}", duration="{at_most: 4 s, at_least: 1 s}", visit="F")
    plan = proven(problem)
    least = np.sqrt(2 * 1.5 * 1.05 / 2)  # the heaviest, to the edge of the goal, at full force all the way
    assert least - 1e-6 <= plan.problem.duration <= 1.35 * least


@pytest.mark.slow
def test_the_earliest_passage() -> None:
    problem = masses("objective: {earliest: goal, robustness: 0}\nsolve: {time_limit: 60 s}", visit="F")
    plan = proven(problem)
    found = plan.details["minimum_time"]
    assert found["value"] < 2.5


def test_compare_has_the_rows_that_are_for_the_system() -> None:
    problem = masses()
    assert [row.name for row in ec.compare(problem)] == ["moment", "moment, minlp", "nodes", "hull", "hull, minlp"]
    assert not left_out(problem)


@pytest.mark.slow
def test_what_would_help_where_there_is_no_plan() -> None:
    """The goal is too far for the time: a longer horizon helps, and its change makes a problem with a proof."""
    problem = masses(duration="1 s", visit="F[0.8, 1]")
    plan = ec.plan(problem, check=False)
    assert plan.status == "infeasible"
    found = plan.suggest(30.0)
    assert found.helps
    first = found.helps[0]
    assert first.problem.duration > problem.duration or first.problem.fleet.input_upper[0] > 2
    assert first.certificate.proven == "yes"


@pytest.mark.parametrize("of", ["terminal", "clearance"])
def test_a_risk_penalty(of: str) -> None:
    """The worst fifth of the fleet ends closer to its place, or keeps further away, than without the penalty."""
    wall = "motions: {post: {path: [[0, [0, 1.3]], [4, [0, 1.3]]]}}\n"
    price = f", cvar: {{of: {of}, level: 0.8, weight: 20}}"
    text = wall + "objective: {robustness: 0, terminal: {target: [2, 0], weight: 1}%s}"
    priced = masses(text % price)
    plan, other = proven(priced), proven(masses(text % ""))
    assert evaluate(priced, plan.controls).risk < evaluate(priced, other.controls).risk - 1e-3
