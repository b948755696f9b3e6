"""Margins for errors of the model, against the certificate's tube, which is computed by other code."""

from __future__ import annotations

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp.disturbance import growth
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.evaluate_sampled import evaluate as evaluate_sampled
from ensemble_ctrl.ocp.truncation import choose
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.uncertainty import NONE, Uncertainty
from tests.certificate.general.test_disturbed import BOUNDS as ODE_BOUNDS
from tests.certificate.general.test_disturbed import PUSHES
from tests.certificate.general.test_disturbed import problem as pushed
from tests.certificate.test_disturbance import BOUNDS, CONTROLS, problem


@pytest.mark.parametrize("name", BOUNDS)
def test_margins_are_about_the_tube_of_the_proof(name: str) -> None:
    whole = problem(BOUNDS[name])
    found, tube = growth(whole, CONTROLS), Flow.of(whole, CONTROLS).error
    assert found is not None
    assert (found.within[10:] <= 1.4 * tube[10:] + 1e-3).all()
    assert (found.within[10:] >= tube[10:] / 1.4 - 1e-3).all()


@pytest.mark.parametrize("name", ODE_BOUNDS)
def test_margins_of_a_system_that_an_ode_defines(name: str) -> None:
    whole = pushed(ODE_BOUNDS[name])
    found = growth(whole, PUSHES)
    radius = GeneralProof(whole, PUSHES, whole.fleet.parameters).enclosure.radius[-1].max(axis=1)
    assert found is not None
    assert (found.at[-1] <= 1.05 * radius + 1e-3).all()  # the proof takes the worst of a whole cell of masses
    assert (found.at[-1] >= radius / 1.7 - 1e-3).all()


def test_a_fleet_that_follows_its_model_has_none() -> None:
    assert growth(problem(Uncertainty()), CONTROLS) is None


def test_what_controls_are_worth_counts_the_errors() -> None:
    errors = Uncertainty({"position": 0.02})
    with_, without = (evaluate(whole, CONTROLS, choose(whole, CONTROLS)) for whole in (problem(errors), problem(NONE)))
    assert without.gap - with_.gap > 0.02
    assert without.robustness - with_.robustness == pytest.approx(0.07, abs=0.015)  # 20 mm/s for 3.5 to 4 s
    some, none = (evaluate_sampled(whole, PUSHES) for whole in (pushed(Uncertainty({"vx": 0.05})), pushed(NONE)))
    assert none.gap > some.gap
    assert none.robustness > some.robustness
    window = pushed(Uncertainty({"vx": 0.05})).with_(task=parse("G[1,2] avoid(post)"))
    assert evaluate_sampled(window, PUSHES).gap >= some.gap - 1e-12


NARROW = Problem(
    name="narrow",
    fleet=ec.Fleet(ec.Unicycle(), {"traction": ec.Interval(0.95, 1.05)}, [0.0, 0.0], 0.0),
    duration=6.0,
    steps=30,
    task=parse("F[5,6] in(goal) and G avoid(obstacles)"),
    regions={"goal": ec.Polyhedron.box([[2.5, 3.5], [-0.5, 0.5]])},
    obstacles={"post": (ec.Obstacle.box([[1.2, 1.6], [-0.5, 0.1]]),)},
)


def test_a_plan_for_errors_is_proven_with_them() -> None:
    errors = Uncertainty({"position": 0.01, "heading": 0.005})
    fleet = NARROW.fleet.with_(uncertainty=errors)
    found = ec.plan(NARROW.with_(fleet=fleet))
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    plain = ec.plan(NARROW)
    assert ec.certify(NARROW.with_(fleet=fleet), plain.controls).proven != "yes"
