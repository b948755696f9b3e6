"""A system of one's own: a crane, defined by its differential equation. ``python examples/own_system.py`` plans for it.

The problem file next to it uses the same class: ``ensemble-plan examples/own_system.yaml --trust``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.systems.arrays import cos, sin


class CartPole(ec.OdeSystem):
    """A cart with a pole that hangs from a hinge, and a load of unknown mass (kg) at the pole's end."""

    name, states, positions = "cart_pole", ("x", "v", "angle", "rate"), ("x",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-10.0, 10.0),)
    parameters = {"load": 0.15}
    cart, length = 1.0, 0.5

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        _, v, angle, rate = x
        s, c, load = sin(angle), cos(angle), psi["load"]
        a = (u[0] + load * s * (self.length * rate**2 + 9.81 * c)) / (self.cart + load * s**2)
        return [v, a, rate, -(a * c + 9.81 * s) / self.length]


def problem() -> ec.Problem:
    """Two metres to the right and stop, for every load from 0.1 to 0.2 kg."""
    still = "angle <= 0.1 and angle >= -0.1 and v <= 0.1 and v >= -0.1"
    return ec.Problem(
        name="crane",
        fleet=ec.Fleet(CartPole(), {"load": ec.Interval(0.1, 0.2)}, start={}),
        duration=4.0,
        steps=40,
        task=parse(f"G[3.8, 4] (in(goal) and {still})"),
        regions={"goal": ec.Polyhedron.box([[1.8, 2.2]])},
    )


if __name__ == "__main__":
    print(ec.plan(problem()))
