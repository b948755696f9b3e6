"""Shares and means of systems that an ODE defines, under every distribution, against closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import ensemble_ctrl as ec
from ensemble_ctrl.moments import Beta, Distribution, Interval, Mixture, Samples, TruncatedNormal
from ensemble_ctrl.systems import PlanarQuadrotor

DISTRIBUTIONS: dict[str, Distribution] = {
    "uniform": Interval(0.8, 1.2),
    "beta": Beta(0.8, 1.2, 2.0, 5.0),
    "normal": TruncatedNormal(0.8, 1.2, 0.95, 0.1),
    "mixture": Mixture((Interval(0.8, 0.9), 0.3), (TruncatedNormal(0.85, 1.2, 1.1, 0.05), 0.7)),
    "measured": Samples(np.random.default_rng(1).normal(1.0, 0.07, 60).round(3)),
}
"""Of the mass."""


def certified(distribution: Distribution, task: str) -> ec.Certificate:
    """Point masses pushed by 0.5 N for 3 s, which start up to 5 cm off: they end at ``2.25 / mass + start_x``."""
    distributions = {"mass": distribution, "start_x": Interval(-0.05, 0.05)}
    fleet = ec.Fleet(ec.DoubleIntegrator(), distributions)
    problem = ec.Problem("distributions", fleet, 3.0, 15, ec.parse(task))
    return ec.certify(problem, np.full((15, 2), [0.5, 0.0]))


def share_beyond(distribution: Distribution, end: float) -> float:
    """The share of the fleet that ends beyond a place: over starts, of the masses that are light enough."""
    starts = np.linspace(-0.05, 0.05, 4001)
    return float(np.mean(distribution.cdf(2.25 / (end - starts))))


def mean_of(distribution: Distribution) -> float:
    """The mean of where members end."""
    if distribution.measured is not None:
        return float(np.mean(2.25 / distribution.measured))
    ends = [distribution.lower, 0.85, 0.9, distribution.upper]
    parts = [quad(lambda m: float(distribution.cdf(m)) * 2.25 / m**2, a, b)[0] for a, b in pairwise(ends)]
    return 2.25 / distribution.upper + sum(parts)  # integrated by parts


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize("end", [2.35])
def test_a_share_is_proven_and_refuted_close_to_what_it_is(name: str, end: float) -> None:
    truth = share_beyond(DISTRIBUTIONS[name], end)
    less, more = truth - 0.06, truth + 0.06
    assert 0.06 < truth < 0.94
    assert certified(DISTRIBUTIONS[name], f"share({less:.4f}, G[3, 3] x >= {end})").proven == "yes"
    assert certified(DISTRIBUTIONS[name], f"share({more:.4f}, G[3, 3] x >= {end})").proven == "no"


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_a_mean_is_proven_and_refuted_close_to_what_it_is(name: str) -> None:
    truth = mean_of(DISTRIBUTIONS[name])
    assert certified(DISTRIBUTIONS[name], f"mean(G[3, 3] x >= {truth - 0.01:.5f})").proven == "yes"
    assert certified(DISTRIBUTIONS[name], f"mean(G[3, 3] x >= {truth + 0.01:.5f})").proven == "no"


def test_measured_robots_are_counted() -> None:
    """Of 40 quadrotors whose mass and drag belong together, as many as a replay of each counts, but for one."""
    rng = np.random.default_rng(4)
    mass = rng.uniform(0.9, 1.1, 40).round(3)
    cloud = {"mass": mass, "drag": (mass - 0.9 + rng.uniform(0, 0.02, 40)).round(3)}
    fleet = ec.Fleet(PlanarQuadrotor(), {name: Samples(values) for name, values in cloud.items()}, samples=cloud)
    controls = np.tile([10.5, 0.0], (10, 1))
    ends = fleet.trajectories(controls, np.column_stack(list(cloud.values())), 0.1)[:, -1, 1]
    height = float(np.sort(ends)[20] - 1e-4)
    for count, verdict in ((int((ends >= height).sum()) - 1, "yes"), (int((ends >= height).sum()) + 1, "no")):
        task = ec.parse(f"share({count / 40}, G[1, 1] z >= {height!r})")
        assert ec.certify(ec.Problem("measured", fleet, 1.0, 10, task), controls).proven == verdict
