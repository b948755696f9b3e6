"""A share of the fleet: planned for the best box of members, proven by its mass, and seen in replay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.task import TaskBound
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import Not, Share, parse
from ensemble_ctrl.constraints.stl.rewrite import negation_normal_form
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.moments import Beta, Distribution, Interval, Mixture, Samples, TruncatedNormal
from ensemble_ctrl.ocp.chance import ranges
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report.text import measured, proven
from ensemble_ctrl.report.words import certificate_words
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples, quick
from tests.paths import CONFIGS

Floats = NDArray[np.float64]
CONFIG = CONFIGS / "risk" / "share.yaml"
MANY = examples(12, suppress_health_check=[HealthCheck.too_slow])
seeds = st.integers(0, 2**31)
SIGNPOST = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.8, 1.2], distribution: normal, mean: 1.0, deviation: 0.08}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-2, 2], omega: [-2, 2]}
horizon: {duration: 3 s, steps: 30}
moments: {order: auto}
regions: {goal: {box: [[2.75, 3.25], [-1, 1]]}}
obstacles: {o: {box: [[1.2, 1.6], [-0.4, 0.8]]}}
task: "share(0.6, G[2.8, 3] in(goal) and G avoid(o))"
objective: {robustness: 1.0, effort: 0.1}
verify: {members: 1000}
"""


def distribution_of(rng: np.random.Generator) -> Distribution:
    """Any distribution over about 0.8 to 1.2."""
    normal = TruncatedNormal(0.8, 1.2, rng.uniform(0.7, 1.3), rng.uniform(0.02, 0.5))
    beta = Beta(0.8, 1.2, rng.uniform(0.5, 6), rng.uniform(0.5, 6))
    values = Samples(rng.uniform(0.8, 1.2, int(rng.integers(1, 40))).round(int(rng.integers(2, 6))))
    mixture = Mixture((normal, 0.5), (values, 0.5))
    distributions: tuple[Distribution, ...] = (Interval(0.8, 1.2), normal, beta, values, mixture)
    return distributions[int(rng.integers(len(distributions)))]


def random_problem(rng: np.random.Generator, text: str) -> tuple[Problem, Floats]:
    """Robots that drive about, a block, and a place."""
    distributions = {"traction": distribution_of(rng)} | (
        {"start_x": Interval(-0.05, 0.05)} if rng.random() < 0.3 else {}
    )
    fleet = Fleet(Unicycle(), distributions, np.zeros(2), 0.3, np.full(2, -2.0), np.full(2, 2.0))
    middle = rng.uniform(0.9, 1.6) * np.array([np.cos(t := rng.uniform(0, 2 * np.pi)), np.sin(t)])
    block = Obstacle.box(np.column_stack([middle - 0.3, middle + 0.3]))
    there = Polyhedron.box(np.column_stack([(m := rng.uniform(-1, 1, 2)) - 0.6, m + 0.6]))
    problem = Problem("some", fleet, 2.0, 8, parse(text), {"there": there}, {"o": (block,)})
    return problem, np.asarray(rng.uniform(-1.5, 1.5, (8, 2)))


def true_share(problem: Problem, controls: Floats) -> float:
    """The distributions' mass of the members of a dense grid that do the part, by replay of each."""
    (chance,) = problem.specification.chance
    single, fine = problem.with_(task=chance.share.child, steps=16 * problem.steps), np.repeat(controls, 16, axis=0)
    return float(1 - replay(single, fine, parameters=even_members(problem)).violating.mean())


def even_members(problem: Problem) -> Floats:
    """Members of equal weight, side by side in each parameter's distribution."""
    distribution = problem.fleet.parameters["traction"]
    values = (
        distribution.values
        if isinstance(distribution, Samples)
        else distribution.quantile((np.arange(500) + 0.5) / 500)
    )
    if len(problem.fleet.names) == 1:
        return values[:, None]
    shifts = problem.fleet.parameters["start_x"].quantile((np.arange(20) + 0.5) / 20)
    return np.stack(np.meshgrid(values, shifts), axis=-1).reshape(-1, 2)


def dense(problem: Problem, controls: Floats) -> float:
    """Robustness of the fleet on a grid 16 times as fine, the finest that a certificate looks at."""
    fine = problem.with_(steps=16 * problem.steps)
    return float(replay(fine, np.repeat(controls, 16, axis=0), parameters=even_members(problem)).robustness.min())


@pytest.mark.parametrize("inner", ["F in(there) and G avoid(o)", "F[0.5, 2] in(there)", "G avoid(o)"])
@MANY
@given(seed=seeds)
def test_a_proven_share_is_never_above_the_true_one(inner: str, seed: int) -> None:
    problem, controls = random_problem(np.random.default_rng(seed), f"share(0.3, {inner})")
    certificate, truth = certify(problem, controls), true_share(problem, controls)
    (bound,) = certificate.parts
    if certificate.proven == "yes":
        assert bound.share is not None
        assert 0.3 - 1e-9 <= bound.share <= truth + 1e-2
        assert bound.proven >= 0


@pytest.mark.parametrize(("p", "proven"), [(0.3, True), (0.55, True), (0.65, False), (0.9, False)])
def test_a_share_is_proven_up_to_what_the_fleet_does_and_no_further(p: float, proven: bool) -> None:
    """Driving straight on for 1 m/s * 3 s, those with traction 0.92 to 1.04 are in the goal at the end: 60 %."""
    text = SIGNPOST.replace("distribution: normal, mean: 1.0, deviation: 0.08", "distribution: uniform").replace(
        "0.6, G[2.8, 3]", f"{p}, G[3, 3]"
    )
    problem = load_text(
        text.replace("[0.8, 1.2]", "[0.88, 1.08]").replace("[2.75, 3.25]", "[2.76, 3.12]").replace("[-0.4,", "[0.4,")
    )
    certificate = certify(problem, np.tile([[1.0, 0.0]], (30, 1)))
    assert true_share(problem, np.tile([[1.0, 0.0]], (30, 1))) == pytest.approx(0.6, abs=5e-3)
    (bound,) = certificate.parts
    assert (certificate.proven == "yes") == proven
    if proven:
        assert bound.share is not None
        assert p <= bound.share <= 0.6


@MANY
@given(seeds)
def test_a_share_inside_a_formula_is_bounded_under_any_distribution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = round(float(rng.uniform(0.05, 0.95)), 2)
    problem, controls = random_problem(rng, f"F[0.5, 1] (share({p}, in(there)) and x <= 5)")
    (bound,) = certify(problem, controls).parts
    assert bound.covered
    seen = dense(problem, controls)
    assert bound.proven <= seen + 2e-2


@MANY
@given(seeds)
def test_a_mean_is_bounded_under_any_distribution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem, controls = random_problem(rng, "mean(F[0.5, 1] in(there))")
    (bound,) = certify(problem, controls).parts
    seen = dense(problem, controls)
    assert bound.proven <= seen + 1e-4
    assert bound.sampled >= seen - 1e-4
    assert "start_x" in problem.fleet.names or bound.proven >= seen - 0.1 or bound.sampled < 0


@MANY
@given(seeds, st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_quantiles_invert_the_cdf(seed: int, shares: list[float]) -> None:
    distribution = distribution_of(np.random.default_rng(seed))
    at = distribution.quantile(shares)
    assert (distribution.cdf(at) >= np.array(shares) - 1e-12).all()
    below = at - 1e-9
    assert ((distribution.cdf(below) < np.array(shares) + 1e-6) | (at <= distribution.lower + 1e-9)).all()


@MANY
@given(seeds)
def test_the_mass_of_a_box_is_how_often_members_are_in_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    distributions = {"linear_traction": distribution_of(rng), "angular_traction": distribution_of(rng)}
    fleet = Fleet(Unicycle(), distributions, np.zeros(2), 0.0, np.full(2, -1.0), np.full(2, 1.0))
    low, high = np.sort(rng.uniform(0.75, 1.25, (2, 2)), axis=0)
    drawn = fleet.sample(4000, seed % 1000)
    often = ((drawn >= low) & (drawn <= high)).all(axis=1).mean()
    assert fleet.mass(low, high) == pytest.approx(often, abs=0.05)
    assert fleet.mass(fleet.lower, fleet.upper) == pytest.approx(1.0)


def test_a_share_is_cheaper_than_everybody() -> None:
    problem = load_text(SIGNPOST)
    found = solve(problem)
    assert found.certificate is not None
    assert (found.status, found.certificate.proven) == ("planned", "yes")
    (bound,) = found.certificate.parts
    assert bound.share is not None
    assert 0.6 <= bound.share <= true_share(problem, found.controls) + 1e-3
    (seen,) = replay(problem, found.controls, members=2000, substeps=5).shares
    assert seen.low <= true_share(problem, found.controls) + 0.01
    assert seen.high >= bound.share
    (chance,) = problem.specification.chance
    everybody = solve(problem.with_(task=chance.share.child))
    assert found.attempt.value.cost < everybody.attempt.value.cost - 0.05


@pytest.mark.parametrize(
    "parameters", ["{}", "{linear_traction: {range: [0.8, 1.2]}, start_x: {range: [-5 cm, 5 cm]}}"]
)
def test_fleets_of_no_and_of_several_parameters(parameters: str) -> None:
    text = SIGNPOST.replace(
        "{traction: {range: [0.8, 1.2], distribution: normal, mean: 1.0, deviation: 0.08}}", parameters
    )
    problem = load_text(text.replace("steps: 30", "steps: 15").replace("[2.75, 3.25]", "[2.4, 3.6]"))
    certificate = certify(problem, np.tile([[1.0, 0.02]], (15, 1)))
    assert certificate.parts[0].covered
    found = solve(problem)
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.certificate.parts[0].share is not None
    assert found.certificate.parts[0].share >= 0.6


def test_what_is_said_of_a_share() -> None:
    problem = load_text(SIGNPOST)
    controls = solve(problem).controls
    certificate = certify(problem, controls)
    rows = dict(measured(replay(problem, controls)) + proven(problem, certificate))
    assert "% do what 60 % have to (" in rows["replay"]
    assert "worst member" not in rows["robustness"]
    assert "% of the fleet, every instant: their part of the task >= 0.0" in rows["proven"]
    words = certificate_words(problem, certificate)
    assert "every robot" not in words.lead
    assert words.lead.startswith("Proven: at least ")
    assert "% of the robots with traction from 0.8 to 1.2, at every instant of the 3 s, do what" in words.lead
    assert " % of the fleet with at least " in words.bounds[0]


def test_what_is_said_of_a_share_beside_what_everybody_does() -> None:
    part = TaskBound("share(0.6, F in(a))", 0.02, np.inf, {}, share=0.612399)
    rest = TaskBound("F in(b)", 0.03, 0.04, {"traction": 0.9})
    problem = load_text(SIGNPOST)
    certificate = replace(certify(problem, np.zeros((30, 2))), proven="yes", parts=(part, rest), counter_example=None)
    (first, text), (second, share) = proven(problem, certificate)
    assert (first, second) == ("proven", "")
    assert text == "for every traction 0.8..1.2, every instant: rest of the task >= 0.0300 m"
    assert share.startswith("for 61.23 % of the fleet, every instant: their part of the task >= 0.0200 m (")
    lead = certificate_words(problem, certificate).lead
    assert "does the rest of the task, and at least 61.23 % of them do what is asked of a share" in lead
    undecided = proven(problem, replace(certificate, proven="undecided"))
    assert [text.startswith("UNDECIDED for ") and ": only " in text for _, text in undecided] == [True, True]


@pytest.mark.parametrize("seed", quick(range(7, 12), 7))
def test_boxes_end_within_the_range_whatever_its_ends(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = load_text(SIGNPOST)
    for low, width in rng.uniform([0.1, 0.01], [1.0, 1.0], (10, 2)):
        fleet = replace(problem.fleet, parameters={"traction": Interval(low, low + width)})
        for box in ranges(problem.with_(fleet=fleet)):
            assert box is not None
            assert all(-1 <= a < b <= 1 for a, b in box)


def test_boxes_have_the_mass_and_none_is_larger_than_it_must_be() -> None:
    problem = load(CONFIG)
    fleet = problem.fleet
    boxes = ranges(problem)
    assert len(boxes) == 3
    for box in boxes:
        assert box is not None
        ends = [fleet.parameters["traction"].to_parameter(np.array([end])) for end in box[0]]
        assert 0.9 <= fleet.mass(*ends) <= 0.91
    assert ranges(problem.with_(task=parse("F in(goal)"))) == (None,)
    (chance,) = problem.specification.chance
    assert chance.share == problem.task
    assert [d.name for d in chance.avoid] == list(problem.obstacles)
    (whole,) = problem.with_(task=Share(1.0, parse("F in(goal)"))).specification.chance
    assert whole.share.p == 1


@pytest.mark.parametrize(
    ("share", "members", "wanted"),
    [(0.07, 100, 7), (0.29, 100, 29), (0.5 + 1e-11, 10, 6), (0.95, 1000, 950), (1e-12, 5, 1), (1.0, 7, 7)],
)
def test_a_share_is_of_the_decimal_number_that_was_written(share: float, members: int, wanted: int) -> None:
    """2.9 is below 0.29 * 10 in floats and 7 above 0.07 * 100; none of it is rounded in favour of the share."""
    part = Share(share, parse("x >= 0"))
    assert part.rank(members) == wanted
    denied = negation_normal_form(Not(part))
    assert isinstance(denied, Share)
    assert denied.rank(members) == min(members - wanted + 1, members)
    again = negation_normal_form(Not(denied))
    assert isinstance(again, Share)
    assert again.rank(members) == wanted
