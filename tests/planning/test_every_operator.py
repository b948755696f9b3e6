"""Every operator of the task language around every kind of leaf: guessed, replayed, certified, and some planned."""

from __future__ import annotations

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.ocp.guesses.roadmap import roadmap_guesses
from ensemble_ctrl.planning.baseline import unconstrained
from ensemble_ctrl.problem.evaluation.conflicts import conflicts
from ensemble_ctrl.report.text import summary_lines

LEAVES = ["in(goal)", "avoid(post)", "avoid(obstacles)", "avoid(goal)", "x <= 2.9", "abs(y) <= 1", "mean(in(goal))"]
PLACES = [
    "{}",
    "not {}",
    "F {}",
    "G[0,1] {}",
    "{} and x >= -1",
    "x >= 5 or {}",
    "{} => x <= 1",
    "x <= 1 => {}",
    "{} iff x >= -1",
    "{} xor x >= 5",
    "{} U in(goal)",
    "{} U[0,1] x >= 1",
    "avoid(post) U {}",
    "not ({} U {})",
    "({} and x <= 3) U in(goal)",
    "mean({})",
    "share(0.9, {})",
    "share(0.5, G {})",
    "G F[0,0.5] {}",
    "F[0,1] G[0,0.5] {}",
    "G[T-1,T] {}",
]
TEXT = """
fleet: {{model: unicycle, start: {{position: [0, 0], heading: 0}}, parameters: {{traction: {{range: [0.95, 1.05]}}}}}}
horizon: {{duration: 2 s, steps: 8}}
moments: {{order: 2}}
regions: {{goal: {{box: [[1.5, 2.5], [-0.5, 0.5]]}}}}
obstacles:
  post: {{box: [[0.6, 0.9], [-0.9, -0.1]]}}
  wall: {{box: [[-1, 3], [1.5, 2]]}}
task: "{}"
solve: {{time_limit: 10 s}}
verify: {{members: 10}}
"""


def problem_of(place: str, leaf: str) -> ec.Problem | None:
    """The problem with this task; None where it is refused because no plan can do it."""
    try:
        return ec.load_text(TEXT.format(place.replace("{}", f"({leaf})")))
    except ec.ConfigError as error:
        if "from the start" not in str(error) and "at top speed" not in str(error):
            raise
        return None


@pytest.mark.parametrize("leaf", LEAVES)
def test_every_operator_around_every_leaf(leaf: str) -> None:
    given = 0
    for place in PLACES:
        problem = problem_of(place, leaf)
        if problem is None:
            continue
        given += 1
        assert roadmap_guesses(problem, 8, 2), place
        plan = ec.Plan(problem, np.tile([0.9, 0.05], (8, 1)), "planned")
        run, certificate = plan.replay(), plan.certify()
        assert certificate.proven in ("yes", "no", "undecided"), place
        if certificate.proven == "yes":
            assert not run.violating.any(), place
        assert conflicts(problem, plan.controls) is not None
        assert unconstrained(problem).name == problem.name
        assert summary_lines(plan)
    assert given > len(PLACES) / 2


@pytest.mark.parametrize("task", ["avoid(obstacles) U in(goal)", "(avoid(obstacles) and x <= 3) U[0,2] in(goal)"])
def test_obstacles_are_closed_until_the_goal_is_reached(task: str) -> None:
    plan = ec.plan(ec.load_text(TEXT.format(task)))
    assert plan.status == "planned"
    assert plan.certify().proven == "yes"
