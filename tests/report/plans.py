"""Plans of every odd kind, made without solving: a page has to look right for plans that are bad, too."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ensemble_ctrl.api.plans import Plan, checked
from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem, VerifyOptions
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import OdeSystem

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


class Cart(OdeSystem):
    """A system of one's own whose position is a line."""

    name, states, positions = "cart", ("x", "v"), ("x",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-5.0, 5.0),)
    parameters = {"mass": 1.0, "drag": 0.0}  # noqa: RUF012

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        """Newton's distribution."""
        return [x[1], u[0] / psi["mass"] - psi["drag"] * x[1]]


ODE_PROBLEMS = {
    "plane": """
fleet: {model: double_integrator, parameters: {mass: {range: [0.8, 1.2]}}, start: {position: [0, 0], vx: 0.5}}
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[3, 7], [-1, 1]]}}
obstacles: {post: {box: [[1, 1.6], [0.4, 1.2]]}}
task: F[3, 4] in(goal) and G avoid(obstacles) and G vx <= 3
verify: {members: 50}
""",
    "space": """
fleet:
  model: quadrotor
  parameters: {payload: {range: [0, 0.1]}, start_vx: {range: [0.9, 1.1]}}
  start: {position: [0, 0, 1]}
  radius: 0.1
horizon: {duration: 1 s, steps: 10}
regions: {goal: {box: [[0.5, 2], [-0.5, 0.5], [0, 2]]}}
obstacles: {wall: [{box: [[0.4, 0.6], [0.5, 1], [0, 2]]}, {box: [[0.4, 0.6], [-1, -0.5], [0, 2]]}],
            ground: {box: [[-1, 2], [-1, 1], [-0.5, 0]]}}
task: F[0.8, 1] in(goal) and G avoid(obstacles) and G qx <= 0.1
verify: {members: 20}
""",
}
"""Problem files of fleets that follow a differential equation."""
ODE_KINDS = ("plane", "space", "line", "equal line")


@cache
def ode_made(kind: str) -> Plan:
    """A replayed plan of such a fleet: pushed on steadily, or hovering with some speed; ``line`` fails its task."""
    if kind in ODE_PROBLEMS:
        problem = load_text(ODE_PROBLEMS[kind], name=kind)
        command = [0.4, 0.05] if kind == "plane" else problem.fleet.rest(problem.fleet.center)
    else:
        distribution = {"mass": Interval(0.8, 1.2), "drag": Interval(0.0, 0.2)} if kind == "line" else {}
        regions = {"goal": Polyhedron.box([[1.5, 2.0]]), "track": Polyhedron.box([[-0.5, 4.0]])}
        task = parse(f"F[1, {1.5 if distribution else 2}] in(goal) and G in(track) and G v <= 3")
        verify = VerifyOptions(members=50, certificate=False)
        problem = Problem("line", Fleet(Cart(), distribution), 2.0, 20, task, regions, verify=verify)
        command = [1.0]
    plan = Plan(problem, np.tile(command, (problem.steps, 1)), "infeasible" if kind == "line" else "planned")
    return checked(plan, plan.replay(), None)
