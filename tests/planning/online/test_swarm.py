"""A swarm of which only mean and covariance are seen."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.swarm import Aggregate, SimulatedSwarm, Swarm, uniform_members
from ensemble_ctrl.problem.evaluation.sampled import replay

from .problems import SHORT, options, plan

Floats = NDArray[np.float64]


def swarm_of(low: float, high: float, count: int = 3000, noise: float = 0.002) -> SimulatedSwarm:
    coefficients = SHORT.fleet.coefficients(uniform_members(low, high, count))
    return SimulatedSwarm(SHORT.fleet.arcs, coefficients, SHORT.step, noise, seed=4)


def test_aggregates_tell_the_distribution_and_every_robot_stays_proven() -> None:
    loop, robots = Swarm(SHORT, options(), plan(), process_time), swarm_of(0.98, 1.10)
    while not loop.over:
        loop.observe(robots.look())
        robots.drive(loop.step())
    low, high = loop.range
    assert low == pytest.approx(0.98, abs=0.03)
    assert high == pytest.approx(1.10, abs=0.03)
    assert loop.misfit < 0.01
    assert loop.certificate.proven
    run = replay(SHORT, robots.controls, members=500, substeps=4)
    assert not run.violating.any()
    blind = SHORT.fleet.arcs.paths(plan(), robots.coefficients, SHORT.step)[:, -1]
    target = np.array([2.4, 0.0])
    assert rms(robots.places - target) < rms(blind - target)


def rms(off: Floats) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def test_a_distribution_is_found_exactly_without_noise() -> None:
    loop, robots = Swarm(SHORT, options(), plan(), process_time), swarm_of(0.9, 1.0, noise=0.0)
    robots.drive(plan()[:20])
    loop.sent = 20
    loop.observe(robots.look())
    middle = sum(loop.range) / 2
    assert middle == pytest.approx(0.95, abs=1e-3)
    assert loop.range[1] - loop.range[0] == pytest.approx(1.2 * 0.1, abs=2e-3)


def test_what_no_distribution_explains_shows_in_the_misfit() -> None:
    loop = Swarm(SHORT, options(), plan(), process_time)
    loop.observe(Aggregate(1.0, np.array([5.0, 5.0]), 0.01 * np.eye(2)))
    assert loop.misfit > 1


def test_strange_aggregates_are_left_out() -> None:
    loop = Swarm(SHORT, options(), plan(), process_time)
    loop.observe(Aggregate(0.0, np.zeros(2), np.zeros((2, 2))))
    loop.observe(Aggregate(0.0, np.ones(2), np.zeros((2, 2))))
    loop.observe(Aggregate(1.0, np.array([np.nan, 0.0]), np.zeros((2, 2))))
    assert len(loop.seen) == 1
    assert loop.range == (0.85, 1.15)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("linear_traction", "angular_traction"), "linear_traction, angular_traction"),
        (("traction", "start_x"), "traction, start_x"),
    ],
)
def test_a_fleet_of_more_than_one_factor_is_refused(names: tuple[str, ...], said: str) -> None:
    """Nor may robots start in different places: nobody measures where each is."""
    distributions = {name: Interval(-0.1, 0.1) if name == "start_x" else Interval(0.9, 1.1) for name in names}
    with pytest.raises(ProblemError, match=f"swarm: expected a fleet with one factor, got {said}"):
        Swarm(SHORT.with_(fleet=replace(SHORT.fleet, parameters=distributions)), options(), plan())
