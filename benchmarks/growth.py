"""Nodes against accuracy for one, two and three parameters: ``python benchmarks/growth.py``.

Plans `configs/five_obstacles.yaml`, then measures the truncation error of that plan, in metres, for fleets whose
parameters vary together, apart, and apart with an uncertain heading.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import ensemble_ctrl as ec
from ensemble_ctrl.ocp.truncation import plain, tail

CONFIG = Path(__file__).parents[1] / "configs" / "five_obstacles.yaml"
TRACTION = ec.Interval(0.9, 1.1)
FLEETS = {
    1: {"traction": TRACTION},
    2: {"linear_traction": TRACTION, "angular_traction": TRACTION},
    3: {"linear_traction": TRACTION, "angular_traction": TRACTION, "start_heading": ec.Interval(-0.1, 0.1)},
}


def main() -> None:
    """Print one line for each order."""
    plan = ec.plan(ec.load(CONFIG))
    for order in range(1, 6):
        cells = []
        for count, laws in FLEETS.items():
            problem = plan.problem.with_(fleet=replace(plan.problem.fleet, parameters=laws))
            truncation = plain((order,) * count, hull=True)
            error = tail(problem, plan.controls, truncation)
            cells.append(f"{truncation.collocation.count:4d} nodes {error:.1e} m")
        print(f"order {order}: " + " | ".join(cells))


if __name__ == "__main__":
    main()
