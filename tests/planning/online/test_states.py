"""The loop of systems that an ODE defines: sets never exclude the truth, and every plan that runs is proven.

The plant is SciPy's integrator, which shares no code with the sets, the proof or the program.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate.general.remaining import certify_box
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.measurement import StateMeasurement
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.remaining import of_one_robot
from ensemble_ctrl.planning.online.simulated_states import SimulatedStates
from ensemble_ctrl.planning.online.state_loop import StateLoop
from ensemble_ctrl.planning.online.state_sets import Box, StateSets, at_end
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import states
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import DoubleIntegrator, PlanarQuadrotor, Quadrotor, System
from tests.examples import examples
from tests.paths import CONFIGS

Floats = NDArray[np.float64]


class Pendulum(System):
    """A system of one's own: nonlinear, on a line, with damping."""

    name, states, positions = "pendulum", ("a", "w"), ("a",)
    controls, control_units, input_bounds = ("torque",), ("N m",), ((-3.0, 3.0),)
    parameters = {"damping": 0.1, "length": 1.0}  # noqa: RUF012

    def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
        """Torque against gravity."""
        return [x[1], u[0] - psi["damping"] * x[1] - 9.81 / psi["length"] * x[0] * (1 - x[0] * x[0] / 6)]


FLEETS = {
    "double_integrator": Fleet(DoubleIntegrator(), {"mass": Interval(0.8, 1.3)}),
    "planar_quadrotor": Fleet(PlanarQuadrotor(), {"mass": Interval(0.95, 1.05), "drag": Interval(0.0, 0.2)}),
    "quadrotor": Fleet(Quadrotor(mass=6), {"payload": Interval(0.0, 0.5)}),
    "own": Fleet(Pendulum(), {"damping": Interval(0.0, 0.4), "length": Interval(0.8, 1.2)}, start={"a": 0.3}),
}


def integrated(fleet: Fleet, member: Floats, before: Floats, command: Floats, seconds: float) -> Floats:
    """The states after a constant command, by SciPy."""
    psi = {name: float(value[0]) for name, value in fleet.psi(member[None]).items()}

    def rates(_: float, x: Floats) -> list[float]:
        return [float(rate) for rate in fleet.system.xdot(list(x), command.tolist(), psi)]

    return np.asarray(solve_ivp(rates, (0.0, seconds), before, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1])


class Plant(SimulatedStates):
    """The simulated robot, moved by SciPy."""

    def moved(self, states: Floats, command: Floats, seconds: float) -> Floats:
        return integrated(self.fleet, self.member, states, command, seconds)


@pytest.mark.parametrize("name", FLEETS)
@examples(8)
@given(seed=st.integers(0, 2**31))
def test_sets_hold_the_truth_and_shrink(name: str, seed: int) -> None:
    fleet, rng, step = FLEETS[name], np.random.default_rng(seed), 0.1
    errors = 0.001 if name == "quadrotor" else 0.005
    member = rng.uniform(fleet.lower, fleet.upper)
    rest, width = fleet.rest(fleet.center), (fleet.input_upper - fleet.input_lower) / 2
    truth = fleet.start_states(member[None])[:, 0]
    sets = StateSets(fleet)
    box = Box.about(truth + rng.uniform(-errors, errors, truth.shape), np.full(truth.shape, errors))
    for _ in range(6):
        command = rest + 0.2 * width * rng.uniform(-1, 1, len(rest))
        enclosure = sets.reach(box, command[None], step)
        truth = integrated(fleet, member, truth, command, step)
        ahead = at_end(enclosure, 1)
        assert (ahead.low <= truth).all()
        assert (truth <= ahead.high).all()
        seen = Box.about(truth + rng.uniform(-errors, errors, truth.shape), np.full(truth.shape, errors))
        before = sets.ranges.copy()
        found = sets.contract(enclosure, 1, seen)
        assert found is not None
        box = found
        assert (box.low <= truth).all()
        assert (truth <= box.high).all()
        assert (sets.ranges[:, 0] <= member).all()
        assert (member <= sets.ranges[:, 1]).all()
        assert (sets.ranges[:, 0] >= before[:, 0]).all()
        assert (sets.ranges[:, 1] <= before[:, 1]).all()


def test_a_long_push_tells_the_mass() -> None:
    """From v = f t / m, both ends of the range: after 2 s at 1 N, errors of 1 cm/s tell m to about 2 m^2 e / (f t)."""
    fleet, errors = FLEETS["double_integrator"], 0.01
    sets, member = StateSets(fleet), np.array([1.1])
    controls = np.tile([1.0, 0.0], (20, 1))
    truth = np.array([2.0 / 1.1, 0.0, 2.0 / 1.1, 0.0])
    enclosure = sets.reach(Box.about(np.zeros(4), np.full(4, errors)), controls, 0.1)
    assert sets.contract(enclosure, 20, Box.about(truth, np.full(4, errors))) is not None
    ((low, high),) = sets.ranges
    assert low <= member[0] <= high
    assert high - low < 4 * 1.1**2 * errors / 2.0 + 0.5 / 64 * 2
    assert high - low > 2 * 1.1**2 * errors / 2.0


def test_no_parameter_that_fits_is_told() -> None:
    fleet = FLEETS["double_integrator"]
    sets = StateSets(fleet)
    enclosure = sets.reach(Box.about(np.zeros(4), np.full(4, 0.01)), np.tile([1.0, 0.0], (20, 1)), 0.1)
    truth = np.array([2.0 / 2.0, 0.0, 2.0 / 2.0, 0.0])  # of 2 kg
    assert sets.contract(enclosure, 20, Box.about(truth, np.full(4, 0.01))) is None
    np.testing.assert_array_equal(sets.ranges, sets.assumed)


@cache
def masses() -> tuple[Problem, Floats]:
    """The problem file of the point mass, and a first plan."""
    problem = load(CONFIGS / "online" / "unknown_mass_online.yaml")
    return problem, solve(of_one_robot(problem)).controls


def run(problem: Problem, plan: Floats, parameters: Mapping[str, float], seed: int = 0, **more: Any) -> Any:
    """Drive a plant of SciPy's; the loop, the plant and how it ended. No deadline: times are not for tests."""
    assert problem.online is not None
    options = problem.online.options
    loop = StateLoop(problem, options, plan, timer=lambda: 0.0)
    errors = options.errors_of(problem)
    plant = Plant(loop.problem.fleet, problem.step, parameters, errors, seed=seed, **more)
    outcome = drive(loop, plant, plant)
    return loop, plant, outcome


def track_of(problem: Problem, plant: SimulatedStates, outcome: Outcome) -> Floats:
    """True states from the beginning of the plan to its end, ten samples a step."""
    began = round(outcome.start / problem.step) * 10
    return np.array(plant.track)[began : began + 10 * problem.steps + 1]


@pytest.mark.parametrize(("mass", "seed"), [(0.83, 0), (1.17, 1)])
def test_the_point_mass_does_its_task_under_proven_plans(mass: float, seed: int) -> None:
    problem, plan = masses()
    loop, plant, outcome = run(problem, plan, {"mass": mass}, seed)
    assert (outcome.ending, outcome.reason) == ("success", "done, and proven")
    assert {step.proof for step in outcome.steps} == {"whole"}
    assert "new" in {step.source for step in outcome.steps}
    low, high = outcome.steps[-1].ranges["mass"]
    assert low <= mass <= high
    assert high - low < 0.15
    track = track_of(problem, plant, outcome)
    (block,) = problem.obstacles["block"]
    clear = block.distance(track[:, :2]) - 0.1
    assert clear.min() >= 0
    late = track[360:]
    assert (problem.regions["goal"].margin(late[:, :2]) >= 0).all()
    assert (np.abs(late[:, 2]) <= 0.3).all()
    assert outcome.robustness <= 0.3 - np.abs(late[:, 2]).max() + 1e-9
    assert loop.entered() == ""


def test_lost_and_late_measurements_do_no_harm() -> None:
    problem, plan = masses()
    _, plant, outcome = run(problem, plan, {"mass": 0.9}, seed=3, lost=0.4, delay=0.3)
    assert outcome.ending in ("success", "finished")
    assert {step.proof for step in outcome.steps} == {"whole"}
    track = track_of(problem, plant, outcome)
    assert (problem.obstacles["block"][0].distance(track[:, :2]) >= 0.1).all()
    assert (problem.regions["goal"].margin(track[360:, :2]) >= 0).all()


def test_a_mass_out_of_the_range_is_noticed() -> None:
    problem, plan = masses()
    loop, _, outcome = run(problem, plan, {"mass": 1.6})
    assert not loop.holds
    assert outcome.ending != "success"
    assert any("fit what was measured" in event for step in outcome.steps for event in step.events)


def test_nothing_begins_without_a_proof() -> None:
    """The first measurement is far from where the plan begins: into the block."""
    problem, plan = masses()
    loop = StateLoop(problem, problem.online.options if problem.online else None, plan, timer=lambda: 0.0)
    given_out = loop.step(StateMeasurement(0.0, (1.3, -0.8, 2.0, 0.0)))
    assert given_out.shape == (0, 2)
    assert loop.stopped.startswith("nothing is proven from where the robot is")
    assert loop.given_up
    assert loop.planned(0, 5).shape == (0, 2)


def test_measurements_that_are_no_use() -> None:
    problem, plan = masses()
    loop = StateLoop(problem, None, plan, timer=lambda: 0.0)
    loop.observe(StateMeasurement(0.15, (0.0,) * 4))
    loop.observe(StateMeasurement(0.0, (0.0,) * 3))
    loop.observe(StateMeasurement(0.0, (0.0, 0.0, 0.0, float("nan"))))
    assert not loop.seen
    loop.observe(StateMeasurement(0.0, (0.0,) * 4))
    assert loop.seen
    loop.step()
    loop.observe(StateMeasurement(0.1, (0.0,) * 4))
    loop.observe(StateMeasurement(99.0, (0.0,) * 4))
    assert loop.tracker.at == 0
    assert loop.holds
    with pytest.raises(ProblemError, match="expected of robot, got one of 'ada'"):
        loop.observe({"ada": StateMeasurement(0.15, (0.0,) * 4)})


def test_without_learning_the_range_stays() -> None:
    problem, plan = masses()
    assert problem.online is not None
    options = replace(problem.online.options, learn=False)
    _, _, outcome = run(problem.with_(online=replace(problem.online, options=options)), plan, {"mass": 1.1})
    assert {step.ranges["mass"] for step in outcome.steps} == {(0.8, 1.2)}


@pytest.mark.slow
def test_the_planar_quadrotor_learns_and_arrives() -> None:
    problem = load(CONFIGS / "online" / "planar_slalom_online.yaml")
    plan = solve(of_one_robot(problem)).controls
    truth = {"mass": 1.006, "drag": 0.015}
    _, plant, outcome = run(problem, plan, truth)
    assert outcome.ending == "success"
    assert {step.proof for step in outcome.steps} == {"whole"}
    for name, value in truth.items():
        low, high = outcome.steps[-1].ranges[name]
        assert low <= value <= high
    track = track_of(problem, plant, outcome)
    for pieces in problem.obstacles.values():
        assert (pieces[0].distance(track[:, :2]) >= 0.1).all()
    assert (problem.regions["goal"].margin(track[220:, :2]) >= 0).all()


# --- the proof of a box of states


@examples(10)
@given(seed=st.integers(0, 2**31))
def test_a_box_is_proven_for_all_that_start_in_it(seed: int) -> None:
    """Members at random in the box and the range: none is nearer to the block than is proven, nor does less."""
    problem, plan = masses()
    alone, rng = of_one_robot(problem), np.random.default_rng(seed)
    half = rng.uniform(0.0, 0.02, 4)
    certificate = certify_box(alone, plan, half)
    (block,) = problem.obstacles["block"]
    clear, does = np.inf, np.inf
    for _ in range(20):
        off = dict(zip(("x", "y", "vx", "vy"), half * rng.choice([-1.0, 1.0, 0.3], 4), strict=True))
        track = states(alone.with_(fleet=alone.fleet.with_(start=off)), plan, alone.fleet.sample(3, seed % 1000), 4)
        clear = min(clear, float((block.distance(track[..., :2]) - 0.1).min()))
        late = track[:, 144:]
        does = min(does, float(problem.regions["goal"].margin(late[..., :2]).min()), 0.3 - np.abs(late[..., 2]).max())
    assert certificate.clearance <= clear + 1e-9
    assert certificate.robustness <= does + 1e-9
    assert certificate.proven == (certificate.least >= 0)


def test_a_box_lowers_what_is_proven_by_what_it_can_move() -> None:
    """A box of places alone moves all trajectories alike: clearance and robustness fall by no more than its size."""
    problem, plan = masses()
    alone = of_one_robot(problem)
    point, box = (certify_box(alone, plan, np.array([size, size, 0.0, 0.0])) for size in (0.0, 0.01))
    assert point.clearance - 0.01 * np.sqrt(2) - 3e-3 <= box.clearance <= point.clearance
    assert point.robustness - 0.01 - 1e-6 <= box.robustness <= point.robustness


# --- what is refused


REFUSED = [
    ("{drift: 0.1}", "online.drift", "a drift is not for a loop of the double_integrator"),
    ("{horizon: receding, run_for: 9 s}", "online.horizon", "a receding horizon is not for a loop of the double"),
    ("{robots: {a: {}, b: {}}}", "online.robots", "several robots are not for a loop of the double_integrator"),
]


@pytest.mark.parametrize(("section", "path", "message"), REFUSED)
def test_what_is_not_for_such_a_loop(section: str, path: str, message: str) -> None:
    text = f"""
fleet: {{model: double_integrator, parameters: {{mass: {{range: [0.9, 1.1]}}}}}}
horizon: {{duration: 2 s, steps: 10}}
task: G x <= 3
online: {section}
"""
    with pytest.raises(ConfigError) as caught:
        load_text(text)
    (error,) = caught.value.diagnostics
    assert error.path == path
    assert error.message.startswith(message)


def test_names_that_are_no_states_or_parameters() -> None:
    problem, plan = masses()
    with pytest.raises(ProblemError, match=r"online\.states: expected names among x, y, vx, vy, got 'z'"):
        StateLoop(problem, OnlineOptions(states={"z": 0.1}), plan)
    text = (CONFIGS / "online" / "unknown_mass_online.yaml").read_text().replace("mass: 1.13", "weight: 1.13")
    wrong = load_text(text)
    assert wrong.online is not None
    with pytest.raises(ProblemError, match=r"online\.robot\.parameters: expected names among mass, got 'weight'"):
        wrong.online.simulated(wrong)
