"""The moment system as a program's variables, against quadrature, SciPy's exponential and the nodal program."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError, ProblemError, UnsupportedError
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.moments import Beta, Distribution, Interval, LegendreBasis, Samples, TensorBasis
from ensemble_ctrl.ocp.bilinear import INTEGRATORS, MomentSystem, integrator
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes, separate
from ensemble_ctrl.ocp.modal import propagate
from ensemble_ctrl.ocp.modal_moments import Moments
from ensemble_ctrl.ocp.parametrisation import Iterate, parametrise
from ensemble_ctrl.ocp.solvers import SolverOptions, solve
from ensemble_ctrl.ocp.transcription import Avoiding, transcribe
from ensemble_ctrl.ocp.truncation import Truncation, plain, points
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from .problems import FLEET, five

Floats = NDArray[np.float64]
Heading = Literal["x", "y"]
TRACTION = Interval(0.8, 1.3)
SYSTEMS: list[ArcSystem] = [Unicycle("x"), Unicycle("y"), Bicycle("x", 0.4), Bicycle("y")]


def commands(steps: int) -> Floats:
    """Random commands; some turn rates, or steering angles, are zero."""
    controls = np.random.default_rng(3).uniform(-1, 1, (steps, 2))
    controls[::4, 1] = 0.0
    return controls


def system_of(fleet: Fleet, order: int) -> MomentSystem:
    """The moment system at one order in every parameter."""
    return MomentSystem(fleet, TensorBasis(tuple(one.basis(order) for one in fleet.dynamic_distributions)))


def advanced(system: MomentSystem, name: str, controls: Floats, step: float, parts: int = 1) -> Floats:
    """Moments at the grid times by one of the integrators, shape (steps + 1, 4, count)."""
    m, v, omega = ca.SX.sym("m", 4 * system.count), ca.SX.sym("v"), ca.SX.sym("omega")
    function = ca.Function("step", [m, v, omega], [integrator(name)(system, m, v, omega, step / parts)])
    path = [system.lifted(controls, step)[0].ravel()]
    for pair in np.column_stack(system.fleet.arcs.rates(*controls.T)).repeat(parts, axis=0):
        path.append(np.array(function(path[-1], *pair)).ravel())
    return np.stack(path[::parts]).reshape(-1, 4, system.count)


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda s: f"{s.name}-{s.heading_from}")
@pytest.mark.parametrize("order", [1, 4, 9])
def test_the_exact_step_agrees_with_the_exponential_of_scipy(system: ArcSystem, order: int) -> None:
    fleet, controls, step = Fleet(system, {"traction": TRACTION}, [1.0, -2.0], 0.3), commands(12), 0.2
    found = advanced(system_of(fleet, order), "exponential", controls, step)
    rates = np.column_stack(system.rates(*controls.T))
    unicycle = Unicycle(system.heading_from)
    wanted = propagate(unicycle, LegendreBasis(order), TRACTION, found[0].T, rates, step)
    np.testing.assert_allclose(found, wanted.transpose(0, 2, 1), atol=1e-12)


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda s: f"{s.name}-{s.heading_from}")
@pytest.mark.parametrize(
    "parameters",
    [
        {"traction": TRACTION},
        {"traction": Beta(0.8, 1.3, 2.0, 5.0)},
        {"linear_traction": Interval(0.9, 1.1), "angular_traction": Beta(0.7, 1.0, 3.0, 1.0)},
        {"angular_traction": Interval(0.9, 1.1), "start_heading": Interval(-0.2, 0.1)},
    ],
    ids=["uniform", "beta", "two", "start"],
)
def test_moments_move_as_the_robots_at_the_gauss_nodes_do(
    system: ArcSystem, parameters: dict[str, Distribution]
) -> None:
    moments = system_of(Fleet(system, parameters, [1.0, -2.0], 0.3), 5)
    controls = commands(20)
    wanted = moments.lifted(controls, 0.1)
    np.testing.assert_allclose(advanced(moments, "exponential", controls, 0.1), wanted, atol=1e-9)
    errors = [np.abs(advanced(moments, "rk4", controls, 0.1, parts) - wanted).max() for parts in (2, 4, 32)]
    assert errors[2] < 1e-8
    assert 13 < errors[0] / errors[1] < 19


def test_multiplication_follows_the_recurrence_of_each_distribution() -> None:
    fleet = Fleet(Unicycle(), {"linear_traction": Beta(0.5, 1.0, 2.0, 4.0), "angular_traction": Interval(0.9, 1.3)})
    system = system_of(fleet, 3)
    # <phi_j, psi phi_k> by a rule that is exact for it
    s, weights = fleet.rule(12)
    phi = system.basis.evaluate(s)
    factors = fleet.coefficients(fleet.dynamic_members(s))
    for G, column in zip(system.multiplications, (0, 1), strict=True):
        np.testing.assert_allclose(G, phi.T @ ((weights * factors[:, column])[:, None] * phi), atol=1e-12)


def test_the_unknown_integrator_is_refused() -> None:
    assert list(INTEGRATORS) == ["exponential", "rk4"]
    with pytest.raises(ProblemError, match=r"^moments.integrator: expected one of exponential, rk4, got 'euler'"):
        integrator("euler")


# --- as the variables of a program


def small(guarantee: str, fleet: Fleet = FLEET, **how: str) -> Problem:
    """From one place to another within a box, with a well-conditioned cost."""
    problem = five(order=4, guarantee=guarantee, margin=0.0)
    aim = replace(problem.objective, target=np.array([2.0, 1.8]), robustness=0.5, effort=0.5)
    room = {"room": ec.Polyhedron.box([[0.9, 2.2], [0.9, 1.7]])}
    problem = problem.with_(duration=2.0, steps=12, task=parse("G in(room)"), regions=room, obstacles={})
    return problem.with_(objective=aim, fleet=fleet, **how)


def optimum(problem: Problem) -> tuple[float, Floats]:
    """Cost and points of the program's solution."""
    truncation = Truncation((4,), (4,), problem.solve.guarantee == "hull", problem.fleet.dynamic_distributions)
    start = Iterate(np.tile([0.6, 0.1], (problem.steps, 1)))
    nothing = Avoiding(_none(problem), np.zeros((0, problem.steps), dtype=bool))
    program = transcribe(problem, truncation, start, nothing)
    found = solve(program.nlp, SolverOptions(tolerance=1e-10, barrier=1e-2))
    assert found.status == "solved"
    return found.cost, points(problem, program.iterate(found.x).controls, truncation)


def _none(problem: Problem) -> Hyperplanes:
    """No obstacles to keep out of."""
    return separate(np.zeros((problem.steps + 1, 1, 2)), (), problem.duration)


BICYCLE = FLEET.with_(system=Bicycle(), input_lower=None, input_upper=None)


@pytest.mark.parametrize("guarantee", ["moment", "nodes", "hull"])
@pytest.mark.parametrize("fleet", [FLEET, BICYCLE], ids=["unicycle", "bicycle"])
def test_the_optimum_is_that_of_the_nodal_program(guarantee: str, fleet: Fleet) -> None:
    nodal, modal = (optimum(small(guarantee, fleet, coordinates=name)) for name in ("nodal", "modal"))
    assert modal[0] == pytest.approx(nodal[0], abs=1e-6)
    np.testing.assert_allclose(modal[1], nodal[1], atol=2e-4)


def test_runge_kutta_has_an_optimum_close_by_that_differs() -> None:
    problem = small("moment", coordinates="modal").with_(steps=3)
    exact, rule = (optimum(problem.with_(integrator=name))[0] for name in ("exponential", "rk4"))
    assert 1e-9 < abs(exact - rule) < 1e-3


def test_the_start_satisfies_the_dynamics_and_the_moments_are_the_variables() -> None:
    problem, controls = small("moment", coordinates="modal"), commands(12)
    truncation = plain((4,), hull=False)
    model = parametrise(problem, truncation, Iterate(controls))
    assert isinstance(model, Moments)
    assert model.layout.size == 12 * 2 + 13 * 4 * 5
    np.testing.assert_allclose(truncation.to_moments @ model.places, np.eye(5), atol=1e-13)
    (block,) = model.dynamics()
    x = np.zeros(model.layout.size)
    model.start(x)
    function = ca.Function("f", [z := ca.SX.sym("z", block.columns.shape[1])], [block.build(z, ca.SX(0, 1))])
    defects = [np.abs(np.array(function(x[row]))).max() for row in block.columns]
    assert max(defects) < 1e-12
    x[model.layout.states[3, 2, 1]] += 0.1
    assert max(np.abs(np.array(function(x[row]))).max() for row in block.columns) > 0.09


# --- in problem files


def test_a_file_says_which_coordinates() -> None:
    text = dump(small("moment", coordinates="modal", integrator="rk4"))
    assert "coordinates: modal" in text
    again = load_text(text)
    assert (again.coordinates, again.integrator) == ("modal", "rk4")
    with pytest.raises(ConfigError, match=r"moments\.coordinates"):
        load_text(text.replace("coordinates: modal", "coordinates: nodes"))


def test_modal_coordinates_are_for_robots_on_arcs() -> None:
    with pytest.raises(ProblemError, match="modal is not for the double_integrator"):
        five(fleet=Fleet(ec.DoubleIntegrator(), {}, start={})).with_(coordinates="modal")


def test_a_distribution_of_few_values_has_too_few_moments_for_a_hull() -> None:
    fleet = FLEET.with_(parameters={"traction": Samples([0.9, 1.0, 1.1])})
    problem = small("hull", fleet, coordinates="modal")
    with pytest.raises(UnsupportedError, match="has 3 moments, and the guarantee hull needs 5"):
        parametrise(problem, Truncation((4,), (4,), True, fleet.dynamic_distributions), Iterate(commands(12)))
