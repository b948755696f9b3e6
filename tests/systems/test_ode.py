"""Systems defined by a differential equation, against SciPy and against CasADi."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import ensemble_ctrl as ec
from ensemble_ctrl import DoubleIntegrator, Fleet, Interval, OdeSystem, ProblemError, Quadrotor, RunawayError
from ensemble_ctrl.systems.arrays import cos, exp, log, sin, sqrt, tan, tanh
from ensemble_ctrl.systems.integration import ORDERS, Rule, extrapolated, halving_error, rk4

Floats = NDArray[np.float64]


class Pendulum(OdeSystem):
    """A driven pendulum with every function there is."""

    name: ClassVar[str] = "pendulum"
    states: ClassVar[tuple[str, ...]] = ("angle", "rate")
    positions: ClassVar[tuple[str, ...]] = ("angle",)
    controls: ClassVar[tuple[str, ...]] = ("torque",)
    control_units: ClassVar[tuple[str, ...]] = ("N m",)
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ((-3.0, 3.0),)
    parameters: ClassVar[Mapping[str, float]] = {"mass": 1.0, "drag": 0.1}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        angle, rate = x
        drag = psi["drag"] * tanh(rate) * sqrt(1 + rate**2) * exp(-log(1 + rate**2) / 8)
        return [rate, -9.81 * sin(angle) + (u[0] - drag) / psi["mass"] + 0.1 * cos(tan(angle / 4))]


def random_controls(fleet: Fleet, steps: int, seed: int) -> Floats:
    """Commands anywhere in the middle half of their bounds."""
    low, high = np.asarray(fleet.input_lower), np.asarray(fleet.input_upper)
    share = 0.25 + 0.5 * np.random.default_rng(seed).random((steps, len(low)))
    return np.asarray(low + share * (high - low))


def by_scipy(fleet: Fleet, controls: Floats, member: Floats, step: float) -> Floats:
    """The states at the grid times by SciPy's rule of order 8."""
    x = fleet.start_states(member[None])[:, 0]
    psi = {name: float(value[0]) for name, value in fleet.psi(member[None]).items()}
    found = [x]

    def rates(_: float, at: Floats, u: Floats) -> Floats:
        return np.array(fleet.system.xdot(list(at), u, psi), dtype=float)

    for u in controls:
        run = solve_ivp(rates, (0.0, step), found[-1], args=(u,), method="DOP853", rtol=1e-13, atol=1e-13)
        found.append(run.y[:, -1])
    return np.array(found)


FLEETS = {
    "pendulum": Fleet(
        Pendulum(), {"mass": Interval(0.5, 2.0), "start_rate": Interval(-1.0, 1.0)}, start={"angle": 2.0}
    ),
    "double_integrator": Fleet(DoubleIntegrator(), {"mass": Interval(0.5, 2.0)}, start={"vy": 1.0}),
    "quadrotor": Fleet(Quadrotor(), {"payload": Interval(0.0, 0.5)}, start={"z": 1.0, "wx": 2.0, "wz": -1.0}),
}


@pytest.mark.parametrize("name", FLEETS)
def test_trajectories_are_scipys_to_1e_8(name: str) -> None:
    fleet, step = FLEETS[name], 0.1
    controls = random_controls(fleet, 15, seed=1)
    members = np.concatenate([fleet.corners, fleet.sample(2, seed=3)])
    found = fleet.trajectories(controls, members, step)
    for member, states in zip(members, found, strict=True):
        np.testing.assert_allclose(states, by_scipy(fleet, controls, member, step), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("rule", [rk4, extrapolated])
def test_the_order_of_each_rule(rule: Rule) -> None:
    """Halving the step divides the error by two to the order, and the estimate is the error."""

    def rates(x: Floats) -> Floats:
        return np.array([x[1], -np.sin(x[0])])

    start = np.array([1.0, 0.5])
    exact = solve_ivp(lambda _, x: rates(x), (0, 3), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    count = 16 if rule is rk4 else 4
    coarse, fine = (rule(rates, start, 3.0, n) for n in (count, 2 * count))
    errors = [float(np.abs(x - exact).max()) for x in (coarse, fine)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(ORDERS[rule], abs=1.2)
    assert float(np.abs(halving_error(rule, coarse, fine)).max()) == pytest.approx(errors[1], rel=0.7)


def test_the_exact_step_is_the_integral_of_the_rates() -> None:
    system, psi = DoubleIntegrator(), {"mass": np.array([0.5, 1.0, 2.0])}
    x = np.random.default_rng(0).standard_normal((4, 3))
    exact = system.flow(x, [1.0, -2.0], psi, 0.7, 1)
    np.testing.assert_allclose(rk4(lambda at: system.derivatives(at, [1.0, -2.0], psi), x, 0.7, 1), exact, rtol=1e-13)


@pytest.mark.parametrize("name", FLEETS)
def test_numpy_and_casadi_agree(name: str) -> None:
    fleet = FLEETS[name]
    system, n_x, n_u = fleet.system, len(fleet.states), len(fleet.system.controls)
    x, u, p = ca.SX.sym("x", n_x), ca.SX.sym("u", n_u), ca.SX.sym("p", len(system.parameters))
    own = dict(zip(system.parameters, ca.vertsplit(p), strict=True))
    function = ca.Function("f", [x, u, p], [ca.vertcat(*system.xdot(ca.vertsplit(x), ca.vertsplit(u), own))])
    generator = np.random.default_rng(5)
    at, command = generator.standard_normal(n_x), random_controls(fleet, 1, 2)[0]
    values = {key: np.array([value[0]]) for key, value in fleet.psi(fleet.center[None]).items()}
    expected = system.derivatives(at[:, None], command, values)[:, 0]
    found = np.array(function(at, command, [value[0] for value in values.values()])).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


def test_members_differ_only_where_their_parameters_say() -> None:
    fleet = FLEETS["pendulum"]
    assert fleet.names == ("mass", "start_rate")
    assert fleet.psi(fleet.center[None])["drag"] == pytest.approx(0.1)
    states = fleet.trajectories(random_controls(fleet, 3, 0), fleet.corners, 0.1)
    np.testing.assert_array_equal(states[:, 0], [[2.0, -1.0], [2.0, 1.0]] * 2)


class Broken(Pendulum):
    """A pendulum whose rates can be replaced."""

    answer: Any = None

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return self.answer(x, psi)  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda x, psi: [x[1]], r"Broken.xdot: expected 2 entries \(angle, rate\), got 1"),
        (lambda x, psi: None, "Broken.xdot: expected 2 rates, got NoneType"),
        (lambda x, psi: [x[1], np.zeros(7)], r"Broken.xdot: expected an array over members for rate, got \(7,\)"),
        (lambda x, psi: [x[1], x[0] + 0j], "^Broken.xdot: expected real numbers for rate, got complex ones$"),
        (lambda x, psi: [1j, x[0]], "^Broken.xdot: expected real numbers for angle, got complex ones$"),
        (lambda x, psi: [x[1], np.sqrt(psi["mass"] - 1)], r"expected finite rates at the start, got nan for rate"),
        (lambda x, psi: [x[1], x[0] / 0.0], "expected finite rates at the start, got inf for rate"),
    ],
)
def test_rates_that_are_none(answer: Any, message: str) -> None:
    system = Broken()
    system.answer = answer
    with pytest.raises(ProblemError, match=message):
        Fleet(system, {"mass": Interval(0.5, 2.0)}, start={"angle": 1.0})


def test_states_that_run_away_or_are_too_stiff() -> None:
    system = Broken()
    system.answer = lambda x, psi: [x[0] ** 2, x[1]]
    fleet = Fleet(system, {"mass": Interval(1.0, 2.0)}, start={"angle": 1.0})
    with pytest.raises(RunawayError, match=r"angle leaves all bounds at t = .* s for mass = 1$"):
        fleet.trajectories(np.zeros((20, 1)), fleet.corners, 0.2)
    system.answer = lambda x, psi: [-1e7 * (x[0] - x[1]), 0 * x[1]]
    with pytest.raises(RunawayError, match=r"too stiff: angle|angle leaves all bounds"):
        fleet.trajectories(np.zeros((1, 1)), fleet.corners, 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {"weight": Interval(1, 2)}}, "expected names among mass, drag, start_<state>, got 'weight'"),
        ({"start": {"height": 1.0}}, "fleet.start: expected names among angle, rate, got 'height'"),
        ({"start": {"rate": np.nan}}, "fleet.start.rate: expected a finite number"),
        ({"input_lower": [0.0, 1.0]}, "fleet.input_lower: expected one number for each of torque"),
        ({"input_lower": [5.0]}, "fleet.input_bounds: low above high"),
        ({"rate_bounds": [0.0]}, "fleet.rate_bounds: expected numbers above 0"),
        ({"radius": -1.0}, "fleet.radius: expected a radius of at least 0 m"),
    ],
)
def test_fleets_that_make_no_sense(change: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"system": Pendulum(), "parameters": {}, "start": {}}
    with pytest.raises(ProblemError, match=message):
        Fleet(**(given | change))


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("states", (), "Odd.states: this is required"),
        ("states", ("angle", "angle"), "Odd.states: expected different names"),
        ("states", ("angle", "F"), "Odd.states: expected names that are no words of the task language, got 'F'"),
        ("positions", ("height",), "Odd.positions: expected one to three of the states"),
        ("control_units", (), "Odd.control_units: expected one entry for each of torque"),
    ],
)
def test_systems_that_do_not_say_what_they_are(attribute: str, value: Any, message: str) -> None:
    odd = type("Odd", (Pendulum,), {attribute: value})
    with pytest.raises(ProblemError, match=message):
        Fleet(odd(), {})


def test_names_of_an_earlier_version_work_with_a_warning() -> None:
    mass = {"mass": Interval(1.0, 2.0)}
    with pytest.warns(DeprecationWarning, match=r"OdeFleet is deprecated .*use ensemble_ctrl.Fleet"):
        old = ec.OdeFleet(DoubleIntegrator(), mass, {"vx": 1.0}, [-1, -1], [1, 1], 0.2)
    new = Fleet(DoubleIntegrator(), mass, input_lower=[-1, -1], input_upper=[1, 1], radius=0.2, start={"vx": 1.0})
    np.testing.assert_array_equal(old.start_states(old.corners), new.start_states(new.corners))
    assert (old.radius, old.input_upper.tolist()) == (new.radius, new.input_upper.tolist())
    with pytest.warns(DeprecationWarning, match=r"OdeProblem is deprecated .*use ensemble_ctrl.Problem"):
        problem = ec.OdeProblem("old", old, 2.0, 10, "G x <= 3")
    arcs = Fleet(ec.Unicycle(), {})
    with pytest.warns(DeprecationWarning, match=r"ensemble_ctrl\.problem\.OdeProblem is deprecated"):
        from ensemble_ctrl.problem import OdeProblem
    with pytest.warns(DeprecationWarning, match="OdeFleet"):
        assert [isinstance(one, ec.OdeFleet) for one in (old, arcs, problem, 1)] == [True, False, False, False]
    assert [isinstance(one, OdeProblem) for one in (problem, problem.with_(fleet=arcs), old)] == [True, False, False]
    with pytest.warns(DeprecationWarning, match="twin"), pytest.raises(TypeError, match="expected baseline once, got"):
        ec.ReportOptions(twin=False, baseline=True)  # type: ignore[call-arg]


def test_a_position_is_short_for_its_states() -> None:
    fleet = Fleet(Quadrotor(), {}, position=[1, 2, 3], start={"vz": 0.5})
    assert fleet.start == {"x": 1.0, "y": 2.0, "z": 3.0, "vz": 0.5}
    assert fleet.with_(position=[0, 0, 1]).start == {"x": 0.0, "y": 0.0, "z": 1.0, "vz": 0.5}
    for what in ({"position": [1, 2, 3]}, {"position": [1, 2, 3], "heading": None}):
        with pytest.raises(ProblemError, match=r"position: expected the start to be given once, got .* start\['x'\]"):
            Fleet(Quadrotor(), {}, start={"x": 9.0}, **what)
    with pytest.raises(ProblemError, match=r"heading: expected the start to be given once"):
        Fleet(ec.Unicycle(), {}, heading=0.5, start={"heading": 0.4})
    turned = Fleet(ec.Unicycle(), {}, position=[1, 2], heading=0.5).with_(heading="90 deg")
    assert turned.start == pytest.approx({"x": 1.0, "y": 2.0, "heading": np.pi / 2})
    with pytest.raises(ProblemError, match=r"fleet\.heading: expected none, for a quadrotor has none, got 0\.5"):
        Fleet(Quadrotor(), {}, heading=0.5)
