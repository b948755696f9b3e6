"""Fleets of unstable systems: plans are found where there are any, and a start that runs away is one less."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.api.planning import failure_message
from ensemble_ctrl.certificate import unproven
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp import parallel, state_rounds
from ensemble_ctrl.ocp.transcription import transcribe
from ensemble_ctrl.planning.planner import states as planner_states
from ensemble_ctrl.systems.arrays import sin

Floats = NDArray[np.float64]


class Escape(ec.OdeSystem):
    """x escapes in finite time, from some start on whatever the command; y rests."""

    name, states, positions = "escape", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("u",), ("1",), ((-2.0, 2.0),)
    parameters: Mapping[str, float] = {"k": 1.0}

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        return [psi["k"] * x[0] ** 2 + u[0], 0 * x[1]]


class Line(ec.OdeSystem):
    """An unstable state that one command pushes."""

    name, states, positions = "line", ("x",), ("x",)
    controls, control_units, input_bounds = ("u",), ("1",), ((-5.0, 5.0),)
    parameters: Mapping[str, float] = {"a": 1.0}

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        return [psi["a"] * x[0] + u[0]]


class Pendulum(ec.OdeSystem):
    """A pendulum whose angle is zero where it stands upright."""

    name, states, positions = "pendulum", ("angle", "rate"), ("angle",)
    controls, control_units, input_bounds = ("torque",), ("N m",), ((-10.0, 10.0),)
    parameters: Mapping[str, float] = {"length": 1.0}

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        length = psi["length"]
        return [x[1], 9.81 / length * sin(x[0]) + u[0] / length**2]


class Ball(ec.OdeSystem):
    """A ball on a beam whose angle is turned by the command."""

    name, states, positions = "ball", ("r", "v", "angle"), ("r",)
    controls, control_units, input_bounds = ("turn",), ("rad/s",), ((-3.0, 3.0),)
    parameters: Mapping[str, float] = {"k": 5 / 7}

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        return [x[1], psi["k"] * (x[0] * u[0] ** 2 + 9.81 * sin(x[2])), u[0]]


def unstable(
    system: ec.OdeSystem, spread: dict[str, tuple[float, float]], start: dict[str, float], task: str, steps: int = 40
) -> ec.Problem:
    """A task for a fleet of an unstable system, in steps of 0.05 to 0.1 s; a plan has to be found, not proven."""
    fleet = ec.Fleet(system, {name: ec.Interval(*ends) for name, ends in spread.items()}, start=start)
    problem = ec.Problem(system.name, fleet, duration=4.0 if steps == 20 else steps / 20, steps=steps, task=parse(task))
    return problem.with_(verify=ec.VerifyOptions(members=2_000, certificate=False))


UNSTABLE = {
    # the nodes of the usual order miss members at the end of the range, which run away
    "escape": unstable(Escape(), {"k": (0.9, 1.2)}, {"x": 0.9}, "G (x <= 3 and y <= 1)", 20),
    # the first guess leads to a swing that falls short, others do not
    "swing up": unstable(
        Pendulum(), {"length": (0.98, 1.02)}, {"angle": 3.14159}, "G[2.5, 3] (angle <= 0.3 and angle >= -0.3)", 60
    ),
    "line": unstable(Line(), {"a": (2.95, 3.05)}, {"x": 0.5}, "G (x <= 1 and x >= -1)", 40),
    "ball": unstable(
        Ball(),
        {"k": (0.65, 0.75)},
        {"r": 0.3},
        "G (r <= 0.5 and r >= -0.5) and G[2.5, 3] (r <= 0.05 and r >= -0.05)",
        60,
    ),
}


@pytest.mark.parametrize("name", UNSTABLE)
def test_plans_for_unstable_systems_are_found(name: str) -> None:
    plan = ec.plan(UNSTABLE[name])
    assert plan.status == "planned"
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0


def test_starts_that_run_away_are_one_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """The middle member's plan lets the others run away; the states that the solver starts from are finite."""
    seen: list[Floats] = []
    real = transcribe

    def looking(problem: ec.Problem, truncation: Any, guess: Any, *given: Any) -> Any:
        seen.append(guess.states)
        return real(problem, truncation, guess, *given)

    monkeypatch.setattr(state_rounds, "transcribe", looking)
    monkeypatch.setattr(parallel, "workers", lambda _: 0)
    monkeypatch.setattr(planner_states, "further_rounds", lambda _: iter(()))  # which lead to a plan earlier
    assert ec.plan(UNSTABLE["escape"]).status == "planned"
    assert all(np.isfinite(states).all() for states in seen)
    assert {states.shape[2] for states in seen} >= {1, 4, 7}


def test_a_plan_that_is_not_proven_says_so() -> None:
    problem = UNSTABLE["ball"].with_(verify=ec.VerifyOptions(members=200))
    found = ec.plan(problem, check=False)
    undecided = replace(found, certificate=unproven(problem, found.controls, "the enclosure grew"))
    words = "a plan was found that every replayed member does, but it is not proven (the enclosure grew)"
    assert failure_message(undecided).startswith(f"ball: {words}")
