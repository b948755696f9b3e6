"""Sets of parameters and poses: the truth is always in them, they shrink, and impossible motion empties them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.membership import Membership
from ensemble_ctrl.planning.online.propagation import Commands, Errors
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle
from tests.examples import examples

Floats = NDArray[np.float64]
STEP = 0.1
SYSTEMS: list[ArcSystem] = [Unicycle(), Unicycle(heading_from="y"), Bicycle(wheelbase=0.3)]
NAMES = [("traction",), ("linear_traction",), ("angular_traction",), ("linear_traction", "angular_traction")]


def fleet_of(system: ArcSystem, names: tuple[str, ...], low: float = 0.8, high: float = 1.2) -> Fleet:
    bounds = np.full(2, -2.0), np.full(2, 2.0)
    return Fleet(system, {name: Interval(low, high) for name in names}, np.zeros(2), 0.0, *bounds)


def wander(rng: np.random.Generator, steps: int) -> Floats:
    """Commands of a robot that drives about, in pieces of some steps."""
    pieces = np.stack([rng.uniform(-0.3, 1.2, steps), rng.uniform(-0.5, 0.5, steps)], axis=1)
    return np.repeat(pieces[: steps // 8 + 1], 8, axis=0)[:steps]


def drive(
    system: ArcSystem, controls: Floats, factors: Floats, slips: Floats | None = None, parts: int = 20
) -> tuple[Floats, Floats]:
    """Poses at the grid times by short straight lines: nothing that the estimator computes with.

    `factors` has shape (steps, 2): those on speed and turn rate in each step. Returns positions and headings from +x.
    """
    v, omega = system.rates(*controls.T)
    sign = 1.0 if system.heading_from == "x" else -1.0
    if slips is not None:
        v, omega = v + slips[:, 0], omega + slips[:, 1]
    v, omega = v * factors[:, 0], sign * omega * factors[:, 1]
    dt = STEP / parts
    heading = np.concatenate([[0.3], 0.3 + np.cumsum(np.repeat(omega, parts)) * dt])
    middle = (heading[:-1] + heading[1:]) / 2
    way = np.cumsum(np.repeat(v, parts)[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1) * dt, axis=0)
    return np.concatenate([[[1.0, 2.0]], np.array([1.0, 2.0]) + way])[::parts], heading[::parts]


def bounded(rng: np.random.Generator, bound: float, size: tuple[int, ...] | int = ()) -> Floats:
    """Errors within a bound, often all but at it: `drive` is not exact."""
    return np.asarray(np.clip(rng.uniform(-1.5, 1.5, size), -1, 1) * (bound - 1e-4))


@examples(40)
@given(
    st.integers(0, 10_000),
    st.sampled_from(SYSTEMS),
    st.sampled_from(NAMES),
    st.sampled_from([0.0, 0.02]),
    st.sampled_from([0.0, 0.03]),
)
def test_the_truth_is_never_excluded(
    seed: int, system: ArcSystem, names: tuple[str, ...], drift: float, slip: float
) -> None:
    rng = np.random.default_rng(seed)
    steps = 60
    errors = Errors(0.01, 0.02, drift)
    controls = wander(rng, steps)
    parameters = rng.uniform(0.85, 1.15, len(names)) + np.zeros((steps, 1))
    ramp = drift * STEP * np.arange(steps)[:, None] * rng.choice([-1.0, 1.0], len(names))
    parameters = np.clip(parameters + ramp, 0.8, 1.2)
    table = np.array([system.directions[name] for name in names])
    factors = parameters @ table + (~table.any(axis=0))
    places, headings = drive(system, controls, factors, bounded(rng, slip, (steps, 2)) if slip else None)
    # of a bicycle, what moves the steering is not what moves the turn rate
    steered = system is SYSTEMS[2]
    bounds = Uncertainty(
        {"heading": 1.2 * slip if steered else 0.0}, {"v": slip} | ({} if steered else {"omega": slip})
    )
    fleet = fleet_of(system, names).with_(uncertainty=bounds)
    sets = Membership(fleet, errors)
    commands = Commands(fleet, controls, STEP)
    for k in sorted(rng.choice(steps, 25, replace=False)):
        seen = places[k] + bounded(rng, 0.01, 2), headings[k] + bounded(rng, 0.02, ()) + 2 * np.pi * rng.integers(-1, 2)
        assert sets.observe(commands, k * STEP, seen[0], float(seen[1]))
        true = parameters[min(k, steps - 1)]
        assert (sets.ranges[:, 0] <= true + 1e-4).all()
        assert (true - 1e-4 <= sets.ranges[:, 1]).all()
        ahead = min(k + 3, steps)
        if not drift and not slip:
            pose = sets.pose(commands, ahead * STEP)
            assert pose is not None
            assert (np.abs(places[ahead] - pose.position) <= pose.half + 1e-3).all()
            off = (headings[ahead] - pose.heading + np.pi) % (2 * np.pi) - np.pi
            assert abs(off) <= pose.turn + 1e-4


def test_the_range_shrinks_to_little_more_than_the_errors_allow() -> None:
    rng = np.random.default_rng(5)
    controls = np.column_stack([np.full(100, 0.6), 0.4 * np.sin(np.arange(100) / 15)])
    system = Unicycle()
    places, headings = drive(system, controls, np.full((100, 2), 1.07))
    fleet = fleet_of(system, ("traction",))
    sets = Membership(fleet, Errors(0.01, np.radians(1)))
    commands = Commands(fleet, controls, STEP)
    widths = []
    for k in range(100):
        sets.observe(commands, k * STEP, places[k] + bounded(rng, 0.01, 2), headings[k] + bounded(rng, 0.017, ()))
        widths.append(float(np.ptp(sets.ranges)))
    assert widths[0] == pytest.approx(0.4)
    assert (np.diff(widths) <= 1e-12).all()
    assert widths[-1] < 0.03
    pose = sets.pose(commands, 9.9)
    assert pose is not None
    assert pose.turn < np.radians(0.6)
    assert pose.away < 0.014


@pytest.mark.parametrize("true", [0.6, 1.5])
def test_a_parameter_outside_its_range_empties_the_set(true: float) -> None:
    controls = np.column_stack([np.full(60, 0.6), np.full(60, 0.2)])
    places, headings = drive(Unicycle(), controls, np.full((60, 2), true))
    fleet = fleet_of(Unicycle(), ("traction",), 0.9, 1.1)
    sets = Membership(fleet, Errors(0.01, np.radians(1)))
    commands = Commands(fleet, controls, STEP)
    consistent = [sets.observe(commands, k * STEP, places[k], headings[k]) for k in range(12)]
    assert consistent[0]
    assert not all(consistent)


def test_a_jump_empties_the_set_at_once() -> None:
    controls = np.column_stack([np.full(60, 0.6), np.full(60, 0.2)])
    places, headings = drive(Unicycle(), controls, np.ones((60, 2)))
    fleet = fleet_of(Unicycle(), ("traction",))
    sets = Membership(fleet, Errors())
    commands = Commands(fleet, controls, STEP)
    assert all(sets.observe(commands, k * STEP, places[k], headings[k]) for k in range(5))
    assert not sets.observe(commands, 0.5, places[5] + [0.0, 0.4], float(headings[5]))
    sets.restart(sets.assumed)
    assert sets.observe(commands, 0.6, places[6] + [0.0, 0.4], float(headings[6]))


def test_after_its_last_command_a_robot_stands() -> None:
    commands = Commands(fleet_of(Unicycle(), ()), np.array([[1.0, 0.0]]), STEP)
    assert commands.at(np.array([0.1, 5.0]), 1.0)[1] == pytest.approx([0.1, 0.1])


@pytest.mark.parametrize("bound", [{"position": -1.0}, {"heading": np.nan}, {"drift": np.inf}])
def test_bounds_are_finite_and_not_negative(bound: dict[str, float]) -> None:
    with pytest.raises(ProblemError, match=r"errors\.\w+: expected a finite bound >= 0"):
        Errors(**bound)
