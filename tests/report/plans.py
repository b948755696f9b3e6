"""Plans of every odd kind, made without solving: a page has to look right for plans that are bad, too."""

from __future__ import annotations

import numpy as np

from ensemble_ctrl.api import Plan, checked
from ensemble_ctrl.config import load_text

UNICYCLE = "fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}\n"
HORIZON = "horizon: {duration: 4 s, steps: 40}\n"
GOAL = "regions: {goal: {box: [[2, 4], [-1, 1]]}}\n"
POST = "obstacles: {post: {box: [[1.0, 1.6], [0.4, 1.2]]}}\n"
TASK = "task: F[3, 4] in(goal) and G avoid(obstacles)\n"
QUICK = "verify: {members: 50}\n"

PROBLEMS = {
    "plain": UNICYCLE + HORIZON + GOAL + POST + TASK + QUICK,
    "script": (UNICYCLE + HORIZON + GOAL + "obstacles: {a-b.c: {box: [[1.0, 1.6], [0.4, 1.2]]}}\n" + TASK + QUICK),
    "several": """
fleet:
  model: unicycle
  parameters: {linear_traction: {range: [0.9, 1.1]}, angular_traction: {range: [0.8, 1.2]},
               start_y: {range: [-0.1, 0.1]}, start_heading: {range: [-0.02, 0.02]}}
  start: {position: [0, 0], heading: 0 deg}
"""
    + HORIZON
    + GOAL
    + POST
    + TASK
    + QUICK,
    "equal": (
        "fleet: {model: unicycle, parameters: {}, start: {position: [0, 0], heading: 0 deg}}\n"
        + HORIZON
        + GOAL
        + POST
        + TASK
        + QUICK
    ),
    "unproven": UNICYCLE + HORIZON + GOAL + POST + TASK + "verify: {members: 50, certificate: false}\n",
    "hit": UNICYCLE + HORIZON + GOAL + "obstacles: {post: {box: [[1.0, 1.6], [-0.4, 0.4]]}}\n" + TASK + QUICK,
    "moving": UNICYCLE
    + HORIZON
    + GOAL
    + "obstacles: {cart: {box: [[1.0, 1.6], [0.4, 1.2]]}}\nmotions: {cart: {velocity: [0.2, 0.3]}}\n"
    + TASK
    + QUICK,
    "formation": UNICYCLE
    + HORIZON
    + GOAL
    + "objective: {terminal: {target: {traction: [[0.9, [2.4, 0]], [1.1, [3, 0]]]}}}\n"
    + "task: F[3, 4] in(goal)\n"
    + QUICK,
    "spread": UNICYCLE
    + HORIZON
    + GOAL
    + "objective: {terminal: {target: {mean: [2.7, 0], covariance: [[0.02, 0], [0, 0.01]]}}}\n"
    + "task: F[3, 4] in(goal)\n"
    + QUICK,
    "bicycle": "fleet: {model: bicycle, radius: 0.2, start: {position: [0, 0], heading: 0 deg}}\n"
    + HORIZON
    + GOAL
    + POST
    + TASK
    + QUICK,
    "unbounded": UNICYCLE
    + HORIZON
    + "regions: {right: {halfspaces: [x >= 2]}, tri: {halfspaces: [x >= -1, y >= -1, x + y <= 3.5]}}\n"
    + "task: F[3, 4] in(right) and G in(tri) and G (y >= -2)\n"
    + QUICK,
    "nowhere": UNICYCLE + HORIZON + "task: G (x >= -1)\n" + QUICK,
    "long": UNICYCLE
    + HORIZON
    + "regions: {the_goal_of_the_fleet: {box: [[2, 4], [-1, 1]]}, another_place: {box: [[1, 4], [-1, 1]]}}\n"
    + "obstacles: {a_rather_long_name: {box: [[1.0, 1.6], [0.4, 1.2]]}, o2: {box: [[0, 1], [0.5, 1]]}}\n"
    + "task: F[3, 4] in(the_goal_of_the_fleet) and not in(the_goal_of_the_fleet) U in(another_place)"
    + " and F in(another_place) and G avoid(obstacles)\n"
    + QUICK,
    "mean": UNICYCLE + HORIZON + GOAL + "task: mean(F[3, 4] in(goal))\n" + QUICK,
}
"""A problem file for each kind."""


def made(kind: str) -> Plan:
    """A plan of a kind: straight on at 0.7 m/s with a small turn, replayed and certified as its problem asks."""
    problem = load_text(PROBLEMS[kind], name=kind)
    problem = problem.with_(name="<script>alert(1)</script>") if kind == "script" else problem
    controls = np.tile([0.7, 0.05], (problem.steps, 1))
    plan = Plan(problem, controls, "infeasible" if kind == "hit" else "planned")
    return checked(plan, plan.replay(), plan.certify() if problem.verify.certificate else None)
