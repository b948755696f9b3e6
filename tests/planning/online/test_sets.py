"""What the loop's sets and proofs say of robots that do their worst within the bounds.

The true motion is integrated here, in short straight pieces, with nothing that the loop computes with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.membership import Membership
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.propagation import Commands, Errors, PoseSet
from ensemble_ctrl.planning.online.remaining import remaining
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
Value = Callable[[float], float]
FINE = 1e-3
"""Seconds of a straight piece."""


def driven(
    controls: Floats, step: float, a: Value, b: Value, heading: float = 0.0, slip: tuple[float, float] = (0.0, 0.0)
) -> Callable[[float], Floats]:
    """The pose at any time of a robot that starts at the origin, with factors that depend on time."""
    times = np.arange(0.0, len(controls) * step + FINE, FINE)
    middle = times[:-1] + FINE / 2
    v, omega = controls[np.minimum((middle / step).astype(int), len(controls) - 1)].T
    turned = np.concatenate(
        [[heading], heading + np.cumsum(np.array([b(t) for t in middle]) * (omega + slip[1])) * FINE]
    )
    along = np.array([a(t) for t in middle]) * (v + slip[0]) * FINE
    half = (turned[:-1] + turned[1:]) / 2
    x, y = (np.concatenate([[0.0], np.cumsum(along * f(half))]) for f in (np.cos, np.sin))

    def pose(time: float) -> Floats:
        return np.array([np.interp(time, times, each) for each in (x, y, turned)])

    return pose


def straight(seconds: float, step: float = 0.1, v: float = 1.0) -> Floats:
    """Commands straight ahead."""
    return np.tile([v, 0.0], (round(seconds / step), 1))


def outside(pose: PoseSet | None, truth: Floats) -> float:
    """By how much a true pose is outside a set, metres or radians; negative inside."""
    assert pose is not None
    turn = abs((truth[2] - pose.heading + np.pi) % (2 * np.pi) - np.pi) - pose.turn
    return float(max(*(np.abs(truth[:2] - pose.position) - pose.half), turn))


def problem_of(
    task: str,
    low: float = 1.0,
    high: float = 1.0,
    duration: float = 4.0,
    step: float = 0.1,
    regions: dict[str, list[list[float]]] | None = None,
    obstacles: dict[str, list[list[float]]] | None = None,
) -> Problem:
    """A unicycle that starts at the origin, headed along x."""
    bounds = np.full(2, -2.0), np.full(2, 2.0)
    fleet = Fleet(Unicycle(), {"traction": Interval(low, high)}, np.zeros(2), 0.0, *bounds)
    return Problem(
        name="small",
        fleet=fleet,
        duration=duration,
        steps=round(duration / step),
        task=parse(task),
        regions={name: Polyhedron.box(box) for name, box in (regions or {}).items()},
        obstacles={name: (Obstacle.box(box),) for name, box in (obstacles or {}).items()},
    )


def at(pose: Floats, time: float) -> Measurement:
    """An exact measurement of a pose."""
    return Measurement(time, *map(float, pose))


# --- sets of poses


def test_the_past_between_measurements_is_where_the_robot_was_and_not_where_it_is() -> None:
    controls = np.tile([1.0, 0.0], (20, 1))
    loop = Receding(
        problem_of("G avoid(obstacles)", duration=2.0), OnlineOptions(errors=Errors(0.001, 0.001)), controls
    )
    truth = driven(controls, 0.1, lambda t: 1.0, lambda t: 1.0)
    loop._send(controls)
    for time in (0.0, 0.35, 1.0):
        loop.observe(at(truth(time), time))
    past = loop.trackers["robot"].past
    assert len(past) == 11
    for k, pose in enumerate(past):
        assert outside(pose, truth(0.1 * k)) <= 0
        assert pose.away < 0.005


@pytest.mark.parametrize("traction", [0.9, 1.0])  # at x = 1.35 and 1.5 when the window ends
def test_a_visit_between_measurements_is_seen_and_not_made_up(traction: float) -> None:
    controls = straight(3.0)
    regions = {"a": [[1.4, 2.0], [-1.0, 1.0]]}
    truth = driven(controls, 0.1, lambda t: traction, lambda t: traction)
    problem = problem_of("F[1, 1.5] in(a)", 0.9, 1.1, 3.0, regions=regions)
    loop = Receding(problem, OnlineOptions(errors=Errors(0.001, 0.001)), controls)
    loop._send(controls)
    for time in (0.0, 1.4, 1.9, 3.0):
        loop.observe(at(truth(time), time))
    assert loop.judged() <= truth(1.5)[0] - 1.4 <= loop.judged() + 0.003


def test_what_happens_between_grid_times_is_judged_too() -> None:
    """A turn of three quarters within one step leads out of the region, whose grid times are both inside."""
    controls = np.array([[1.5 * np.pi, 1.5 * np.pi], [0.0, 0.0]])
    truth = driven(controls, 1.0, lambda t: 1.0, lambda t: 1.0)
    box = [[-1.5, 0.9], [-0.5, 2.5]]
    assert truth(1.0)[0] < 0.9 < truth(1 / 3)[0]
    problem = problem_of("G[0, 1] in(a)", duration=2.0, step=1.0, regions={"a": box})
    wide = np.full(2, -9.0), np.full(2, 9.0)
    fleet = replace(problem.fleet, input_lower=wide[0], input_upper=wide[1])
    loop = Receding(problem.with_(fleet=fleet), OnlineOptions(errors=Errors(0.0, 0.0), applied_steps=1), controls)
    loop._send(controls)
    for time in (0.0, 1.0, 2.0):
        loop.observe(at(truth(time), time))
    assert loop.judged() < 0


def test_without_a_useful_heading_every_heading_is_possible() -> None:
    fleet = problem_of("G avoid(obstacles)").fleet
    commands = Commands(fleet, straight(2.0), 0.1)
    sets = Membership(fleet, Errors(0.001, 3.2))
    truth = driven(straight(2.0), 0.1, lambda t: 1.0, lambda t: 1.0, np.pi)
    assert sets.observe(commands, 0.0, np.zeros(2), 0.0)
    assert outside(sets.pose(commands, 1.0), truth(1.0)) <= 0
    assert sets.observe(commands, 1.0, truth(1.0)[:2], 0.0)


@pytest.mark.parametrize("turn", [3.2, 2 * np.pi])
def test_without_a_useful_heading_a_proof_reckons_with_every_heading(turn: float) -> None:
    problem = problem_of("G avoid(o)", duration=2.0, obstacles={"o": [[-1.5, -0.5], [-0.2, 0.2]]})
    loop = Receding(problem, OnlineOptions(errors=Errors(0.001, turn)), straight(2.0))
    loop.observe(at(np.zeros(3), 0.0))
    assert not loop._certified(straight(2.0), *loop._now()).proven


def test_drift_and_a_slipping_turn_rate_add_up() -> None:
    """The factor grows on the way, so the error of the turn rate counts for more."""
    errors, bounds = Errors(0.0, 0.0, drift=0.05), Uncertainty(actuators={"omega": 0.1})
    fleet = problem_of("G avoid(obstacles)", 0.5, 1.5).fleet.with_(uncertainty=bounds)
    sets = Membership(fleet, errors)
    controls = straight(4.0)
    sets.observe(Commands(fleet, controls, 0.1), 0.0, np.zeros(2), 0.0)
    sets.ranges = np.array([[1.0, 1.0]])
    truth = driven(controls, 0.1, lambda t: 1 + 0.05 * t, lambda t: 1 + 0.05 * t, slip=(0.0, 0.1))
    pose = sets.pose(Commands(fleet, controls, 0.1), 4.0)
    assert outside(pose, truth(4.0)) <= 1e-6
    assert pose is not None
    assert pose.turn < 0.5  # 0.44 is the truth


def test_headings_about_half_a_turn_are_intersected_on_the_circle() -> None:
    """It turns by seven radians and back: the newest measurement tells nothing of the end, older ones are at +-pi."""
    controls = np.repeat([[0.0, 0.0], [0.3, 2.0], [0.3, -2.0]], (1, 35, 35), axis=0)
    truth = driven(controls, 0.1, lambda t: 1.45, lambda t: 1.45, np.pi)
    fleet = problem_of("G avoid(obstacles)", 0.5, 1.5).fleet
    sets = Membership(fleet, Errors(0.01, 0.1))
    commands = Commands(fleet, controls, 0.1)
    sets.turns = sets.aways = np.zeros(3)
    sets.times, sets.places = np.array([0.0, 0.1, 3.6]), np.array([0.0, 0.0, complex(*truth(3.6)[:2])])
    sets.headings = np.array([np.pi - 0.04, -np.pi + 0.04, truth(3.6)[2]])
    pose = sets.pose(commands, 7.1)
    assert outside(pose, truth(7.1)) <= 0
    assert pose is not None
    assert pose.turn < 0.1


# --- proofs


def test_drift_counts_from_the_last_measurement_of_each_robot() -> None:
    """Two robots, one not seen for two seconds: its factor may have changed since, and goes on changing."""
    problem = problem_of("G avoid(wall)", 0.5, 1.5, 3.0, obstacles={"wall": [[3.14, 3.5], [-1.0, 1.0]]})
    errors = Errors(0.001, 0.001, drift=0.05)
    loop = Receding(problem, OnlineOptions(errors=errors, silence=9.0), straight(3.0), robots=("red", "blue"))
    factor = {"red": lambda t: 0.95, "blue": lambda t: 1.017 + 0.05 * max(t - 1.0, 0.0)}
    truth = {name: driven(straight(3.0), 0.1, a, a) for name, a in factor.items()}
    seen = {"red": (0.0, 0.5, 1.0, 2.0), "blue": (0.0, 0.5, 1.0)}
    loop._send(straight(2.0))
    for time in (0.0, 0.5, 1.0, 2.0):
        loop.observe({name: at(truth[name](time), time) for name, times in seen.items() if time in times})
    now, poses = loop._now()
    shown = loop._certified(straight(3.0), now, poses)
    assert outside(poses["blue"], truth["blue"](2.0)) <= 0
    assert shown.clearance <= 3.14 - truth["blue"](3.0)[0] < 0


def test_drift_counts_from_a_measurement_between_grid_times() -> None:
    """Its factor grows from 1, at 0.5 s, to 1.175 at 4 s: 0.3 m more than with 1 from the grid time 1 s on."""
    problem = problem_of("G avoid(wall)", 0.5, 1.5, 4.0, 1.0, obstacles={"wall": [[9.0, 9.5], [-1.0, 1.0]]})
    options = OnlineOptions(errors=Errors(0.0, 0.0, drift=0.05), applied_steps=1)
    loop = Receding(problem, options, straight(4.0, 1.0))
    loop._send(straight(2.0, 1.0))
    loop.observe(at(np.zeros(3), 0.0))
    loop.observe(at(np.array([0.5, 0.0, 0.0]), 0.5))
    truth = driven(straight(4.0, 1.0), 1.0, lambda t: 1 + 0.05 * max(t - 0.5, 0.0), lambda t: 1.0)
    departed = truth(4.0)[0] - truth(1.0)[0] - 3.0
    assert departed == pytest.approx(0.3, abs=1e-3)
    tracker = loop.trackers["robot"]
    start = tracker.onset(1)
    assert start is not None
    assert departed <= tracker.departures(straight(3.0, 1.0), 1, start)[-1] + 1e-6 < 0.38  # with jumps


@pytest.mark.parametrize(("begin", "end"), [(0.7, 1.0000000004), (0.6000000001, 0.9), (0.2, 1.4), (0.3, 1 / 3)])
@pytest.mark.parametrize("steps", [7, 21])
def test_what_is_left_of_a_window_holds_all_of_its_rest(begin: float, end: float, steps: int) -> None:
    """At every grid time, in rational numbers: no instant of it is lost to rounding."""
    fleet = Fleet(Unicycle(), {"traction": Interval(1, 1)}, np.zeros(2), 0.0, np.full(2, -2.0), np.full(2, 2.0))
    wall = {"wall": (Obstacle.box(np.array([[5.0, 6.0], [-1.0, 1.0]])),)}
    problem = Problem("rest", fleet, 1.4, steps, parse(f"G[{begin!r},{end!r}] avoid(wall)"), {}, wall)
    pose = PoseSet(np.zeros(2), np.zeros(2), 0.0, 0.0)
    first, last = (Fraction(repr(time)) for time in (begin, end))
    for k in range(steps):
        now = Fraction("1.4") / steps * k
        left = remaining(problem, k, [], pose, np.array([[1.0, 1.0]])).specification.avoid
        if last < now:
            assert not left
            continue
        (avoid,) = left
        low, high = (Fraction(repr(time)) + now for time in (avoid.begin, avoid.end))
        assert low <= max(first, now) <= low + Fraction(1, 10**15)
        assert high - Fraction(1, 10**15) <= last <= high
