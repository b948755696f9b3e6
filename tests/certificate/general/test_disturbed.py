"""Errors of the model of systems that an ODE defines: SciPy's integrator never leaves the enclosure."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.adversary import attack
from ensemble_ctrl.problem.evaluation.disturbed import disturbed, drawn
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import DoubleIntegrator, PlanarQuadrotor

Floats = NDArray[np.float64]

STEPS = 12
PUSHES = np.column_stack([0.4 * np.cos(np.arange(STEPS) / 3), 0.3 * np.sin(np.arange(STEPS) / 2)])
BOUNDS = {
    "drift": Uncertainty({"position": 0.01}),
    "wind": Uncertainty({"vx": 0.05, "vy": 0.02}),
    "thrust": Uncertainty(actuators={"fx": 0.02}, shares={"fy": 0.05}, quantisation={"fx": 0.01}),
    "mass": Uncertainty(varies={"mass": 0.03}),
    "all": Uncertainty({"vx": 0.03, "position": 0.01}, {"fx": 0.02}, {"fy": 0.05}, {}, {"mass": 0.02}),
}


def problem(bounds: Uncertainty) -> Problem:
    """Points that are pushed past a post."""
    fleet = Fleet(DoubleIntegrator(), {"mass": Interval(0.9, 1.2)}, [0.0, 0.0], start={"vx": 0.4}, uncertainty=bounds)
    return Problem(
        name="pushed",
        fleet=fleet,
        duration=3.0,
        steps=STEPS,
        task=parse("F in(goal) and G avoid(post) and G (vx <= 3)"),
        regions={"goal": Polyhedron.box([[1.0, 4.0], [-1.0, 2.0]])},
        obstacles={"post": (Obstacle.box([[0.6, 0.9], [0.45, 0.9]]),)},
    )


@pytest.mark.parametrize("name", BOUNDS)
def test_no_run_leaves_the_enclosure(name: str) -> None:
    whole = problem(BOUNDS[name])
    proof = GeneralProof(whole, PUSHES, whole.fleet.parameters)
    found = proof.enclosure
    members = whole.fleet.sample(30, 0)
    paths = disturbed(whole, PUSHES, members, drawn(whole, 30, STEPS, 0), found.parts)
    plain = whole.fleet.trajectories(np.repeat(PUSHES, found.parts, axis=0), members, whole.step / found.parts)
    off = np.abs(paths - plain).max(axis=0)[1:]
    width = found.radius.max(axis=2) + found.model.max(axis=2)
    assert (off <= width + 1e-9).all()
    assert off.max() > 0.3 * width.max()


def test_the_worst_wind_against_the_closed_form() -> None:
    # |dx| <= w t^2 / 2 for a push w of the speed, whatever the mass
    whole = problem(Uncertainty({"vx": 0.05}))
    radius = GeneralProof(whole, PUSHES, whole.fleet.parameters).enclosure.radius[-1, 0].max()
    assert 0.05 * 9 / 2 <= radius <= 1.1 * 0.05 * 9 / 2


@pytest.mark.parametrize("name", ["wind", "mass"])
def test_no_attack_gets_below_what_is_proven(name: str) -> None:
    whole = problem(BOUNDS[name])
    proof, found = certify(whole, PUSHES), attack(whole, PUSHES)
    model = certify(problem(Uncertainty()), PUSHES).clearance
    assert proof.clearance - 1e-9 <= found.clearance < model
    assert model - found.clearance > 0.15 * (model - proof.clearance)


def test_a_strong_nonlinear_system_stays_within_its_tube() -> None:
    system = PlanarQuadrotor()
    bounds = Uncertainty({"vx": 0.1}, shares={system.controls[0]: 0.02})
    fleet = Fleet(system, {}, [0.0, 0.0], uncertainty=bounds)
    controls = np.tile(fleet.rest(fleet.center), (6, 1)) + 0.02 * np.cos(np.arange(6))[:, None]
    whole = Problem("hover", fleet, 1.2, 6, parse("G (x <= 50)"))
    radius = GeneralProof(whole, controls, {}).enclosure.radius
    psi = {name: float(value) for name, value in system.parameters.items()}

    def rates(t: float, x: Floats, sign: float) -> Floats:
        u = controls[min(int(t / 0.2), 5)].copy()
        u[0] *= 1 + 0.02 * sign
        push = np.zeros(len(x))
        push[system.states.index("vx")] = 0.1 * sign
        return np.array([float(rate) for rate in system.xdot(list(x), u, psi)]) + push

    start = fleet.start_states(fleet.center[None])[:, 0]
    plain = whole.fleet.trajectories(controls, fleet.center[None], 0.2)[0, -1]
    for sign in (-1.0, 1.0):
        end = solve_ivp(rates, (0.0, 1.2), start, args=(sign,), rtol=1e-10, atol=1e-12, max_step=0.02).y[:, -1]
        assert (np.abs(end - plain) <= radius[-1, :, 0] + 1e-6).all()


def test_delays_are_for_arcs() -> None:
    with pytest.raises(ValueError, match=r"uncertainty.delay: expected none, since it is for robots on arcs"):
        problem(Uncertainty(delay=0.1))
