"""Programs under distributions that are not uniform: averages follow them, enclosures do not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import load
from ensemble_ctrl.moments import Beta, Distribution, Interval, LegendreBasis, Mixture, Samples, TruncatedNormal
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.truncation import Truncation, choose, points, positions, raised, tail
from ensemble_ctrl.planning.planner import Solution, solve
from ensemble_ctrl.problem import Guarantee, Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.examples import quick
from tests.paths import CONFIGS

CONFIG = CONFIGS / "one_obstacles.yaml"
RNG = np.random.default_rng(6)
DISTRIBUTIONS: dict[str, Distribution] = {
    "Beta": Beta(0.9, 1.1, 2, 5),
    "normal": TruncatedNormal(0.9, 1.1, 1.0, 0.01),
    "two clusters": Samples(np.concatenate([RNG.normal(0.93, 0.003, 30), RNG.normal(1.07, 0.003, 30)])),
    "two robots": Samples([0.9, 1.1]),
    "two kinds": Mixture((Interval(0.9, 0.95), 2), (TruncatedNormal(1.0, 1.1, 1.05, 0.02), 1)),
}
distributions = pytest.mark.parametrize("name", DISTRIBUTIONS)
FORMS = [Truncation((8,), (3,), True), Truncation((4,), (4,), True), Truncation((4,), (4,), False)]


def under(distribution: Distribution) -> Problem:
    """One obstacle, for a fleet with this distribution."""
    problem = load(CONFIG)
    return problem.with_(fleet=replace(problem.fleet, parameters={"traction": distribution}))


@cache
def planned(name: str) -> Solution:
    """Its plan, made once."""
    return solve(under(DISTRIBUTIONS[name]))


@distributions
@pytest.mark.parametrize("form", FORMS)
def test_mean_and_mean_square_are_those_of_the_distribution(name: str, form: Truncation) -> None:
    distribution = DISTRIBUTIONS[name]
    truncation = replace(form, distributions=(distribution,))
    curve = RNG.normal(size=truncation.count)
    s, weights = distribution.rule(30)
    states = truncation.evaluation(s[:, None]) @ curve
    mean, square = weights @ states / 2, weights @ states**2 / 2
    assert truncation.to_moments[0] @ curve / np.sqrt(2) == pytest.approx(mean, abs=1e-10)
    assert curve @ truncation.square @ curve / 2 == pytest.approx(square, rel=1e-9, abs=1e-10)
    moments = truncation.to_moments @ curve
    np.testing.assert_allclose(
        moments, (weights[:, None] * truncation.basis.evaluate(s[:, None])).T @ states, atol=1e-8
    )


@pytest.mark.parametrize("form", FORMS)
def test_nothing_changes_for_the_uniform_distribution(form: Truncation) -> None:
    wide = replace(form, distributions=(Interval(0.9, 1.1),))
    np.testing.assert_array_equal(wide.to_moments, wide.to_legendre)
    np.testing.assert_array_equal(wide.square, wide.to_moments.T @ wide.to_moments)
    assert wide.basis.factors == (LegendreBasis(form.degrees[0]),)
    almost = replace(form, distributions=(Beta(0.9, 1.1, 1, 1),))
    np.testing.assert_allclose(almost.to_moments, wide.to_moments, atol=1e-13)
    np.testing.assert_allclose(almost.square, wide.square, atol=1e-13)


@distributions
def test_points_enclose_the_whole_range_whatever_the_distribution(name: str) -> None:
    problem, controls = under(DISTRIBUTIONS[name]), planned(name).controls
    truncation = choose(problem, controls)
    np.testing.assert_array_equal(truncation.nodes[:, 0], LegendreBasis(truncation.orders[0]).nodes)
    exact = positions(problem, controls, problem.fleet.grid(101))
    hull, slack = points(problem, controls, truncation), tail(problem, controls, truncation) + 1e-9
    for angle in np.linspace(0, np.pi, 7):
        direction = np.array([np.cos(angle), np.sin(angle)])
        assert ((exact @ direction).max(axis=0) <= (hull @ direction).max(axis=-1) + slack).all()


@distributions
def test_a_plan_is_proven_for_the_range_and_replayed_under_the_distribution(name: str) -> None:
    found, problem = planned(name), under(DISTRIBUTIONS[name])
    assert found.status == "planned"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.certificate.ranges == {"traction": (DISTRIBUTIONS[name].lower, DISTRIBUTIONS[name].upper)}
    run = replay(problem, found.controls, members=4000, substeps=2)
    assert not run.violating.any()
    s, weights = DISTRIBUTIONS[name].rule(8)
    assert run.parameters[2:].mean() == pytest.approx(weights @ DISTRIBUTIONS[name].to_parameter(s) / 2, abs=0.005)


@distributions
def test_the_terminal_cost_is_the_mean_over_the_distribution(name: str) -> None:
    problem, controls = under(DISTRIBUTIONS[name]), planned(name).controls
    value = evaluate(problem, controls, choose(problem, controls))
    members = DISTRIBUTIONS[name].sample(20_000, seed=3)[:, None]
    assert problem.objective.place is not None
    off = positions(problem, controls, members)[:, -1] - problem.objective.place
    each = 2 * problem.objective.terminal * (off**2).sum(axis=-1)
    assert value.terminal == pytest.approx(each.mean(), abs=5 * each.std() / np.sqrt(len(each)))


@pytest.mark.parametrize("order", [None, 4])
@pytest.mark.parametrize("guarantee", ["hull", "nodes", "moment"])
def test_every_truncation_of_a_problem_has_its_distribution(order: int | None, guarantee: Guarantee) -> None:
    problem = under(DISTRIBUTIONS["Beta"])
    problem = problem.with_(order=order, solve=replace(problem.solve, guarantee=guarantee))
    chosen = choose(problem, planned("Beta").controls)
    assert chosen.distributions == (DISTRIBUTIONS["Beta"],)
    assert raised(chosen).distributions == (DISTRIBUTIONS["Beta"],)


def test_the_distribution_decides_which_plan_is_better() -> None:
    """Each of two plans costs less than the other under its own distribution."""
    slow, fast = under(Beta(0.9, 1.1, 1, 20)), under(Beta(0.9, 1.1, 20, 1))
    plans = {problem: solve(problem).controls for problem in (slow, fast)}
    for mine, other in ((slow, fast), (fast, slow)):
        costs = [evaluate(mine, plans[p], choose(mine, plans[p])).terminal for p in (mine, other)]
        assert costs[0] < costs[1]


@pytest.mark.parametrize("name", quick(DISTRIBUTIONS, "normal"))
def test_the_papers_constraints_on_moments_take_the_distributions_moments(name: str) -> None:
    problem = under(DISTRIBUTIONS[name])
    found = solve(
        problem.with_(
            solve=replace(problem.solve, guarantee="moment"), verify=replace(problem.verify, certificate=False)
        )
    )
    assert found.status == "planned"
    members = DISTRIBUTIONS[name].sample(2000, seed=1)[:, None]
    mean = positions(problem, found.controls, members).mean(axis=0)
    G, h = problem.pieces[0][1].unit_rows()
    assert (mean @ G.T - h).max(axis=-1).min() > -0.02


def test_means_are_proven_under_other_distributions_too() -> None:
    controls = planned("Beta").controls
    for distribution in (Interval(0.9, 1.1), Beta(0.9, 1.1, 2, 5)):
        problem = under(distribution).with_(task=parse("mean(F[14, 16] x >= 5) and G[0, 16] avoid(obstacles)"))
        found = certify(problem, controls)
        assert (found.proven, found.parts[0].covered) == ("yes", True)
        mean = positions(problem, controls, distribution.sample(50_000, seed=9)[:, None]).mean(axis=0)
        assert found.parts[0].proven <= mean[140:, 0].max() - 5 + 2e-3


def test_what_a_task_says_of_the_fleet_is_read_under_the_distribution() -> None:
    controls = planned("Beta").controls
    distribution = Beta(0.9, 1.1, 2, 40)
    problem = under(distribution).with_(task=parse("mean(F[14, 16] x >= 0) and G[0, 16] avoid(obstacles)"))
    value = evaluate(problem, controls, choose(problem, controls))
    mean = positions(problem, controls, distribution.sample(50_000, seed=9)[:, None]).mean(axis=0)
    assert value.robustness == pytest.approx(mean[140:, 0].max(), abs=2e-3)
