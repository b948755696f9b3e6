"""Replay in blocks: any order, any number of workers, any interruption; against the replay that keeps every member."""

from __future__ import annotations

import json
import math
import tracemalloc
from concurrent.futures import ProcessPoolExecutor
from functools import reduce
from multiprocessing import get_context

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.histogram import BINS, Histogram
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.evaluation.streaming import Blocks, block_summary, division, replay_blocks
from ensemble_ctrl.problem.evaluation.summary import WORST, Summary
from ensemble_ctrl.systems import Unicycle
from tests.problem.test_replay import five, random_controls

Floats = NDArray[np.float64]


def two_parameters() -> Problem:
    fleet = ec.Fleet(
        Unicycle("x"),
        {"traction": Interval(0.9, 1.1), "start_heading": Interval(-0.1, 0.1)},
        position=[1.0, 1.0],
        heading=0.7,
        radius=0.1,
    )
    return five().with_(fleet=fleet, task=parse("F[2, 9] in(goal) and G[3,9] x >= 1 and G avoid(obstacles)"))


def all_members(blocks: Blocks, members: int, size: int) -> Floats:
    return np.concatenate([blocks.members(i, n) for i, n in division(members, size)])


@pytest.mark.parametrize("seed", range(3))
def test_a_summary_is_what_a_replay_of_the_same_members_has(seed: int) -> None:
    problem, controls = two_parameters(), random_controls(seed)
    found = replay_blocks(problem, controls, 2500, size=700, substeps=2, seed=5)
    members = all_members(Blocks(problem, controls, 5, 2), 2500, 700)
    run = replay(problem, controls, parameters=members, substeps=2)
    assert (found.members, found.violating) == (2500, int(run.violating.sum()))
    assert (found.drawn, found.drawn_violating) == (2496, int(run.violating[4:].sum()))
    assert found.mean == pytest.approx(run.robustness.mean(), rel=1e-12)
    assert found.variance == pytest.approx(run.robustness.var(), rel=1e-9)
    order = np.argsort(run.robustness)[:WORST]
    np.testing.assert_allclose([w.robustness for w in found.worst], run.robustness[order], atol=1e-11)
    np.testing.assert_array_equal([list(found.named(w).values()) for w in found.worst], members[order])
    for mine, theirs in zip(found.clearances, run.clearances, strict=True):
        assert (mine.obstacle, mine.inside) == (theirs.obstacle, theirs.inside)
        assert mine.distance == pytest.approx(theirs.distance, abs=1e-11)
        assert mine.time == pytest.approx(theirs.time)
        assert mine.parameters == theirs.parameters
    np.testing.assert_array_equal(
        found.histograms[0].counts, np.histogram(run.robustness, found.histograms[0].edges)[0]
    )
    assert [h.total for h in found.histograms] == [2500] * 3
    assert [h.part for h in found.histograms[1:]] == ["F[2,9] in(goal)", "G[3,9] x >= 1"]


def test_any_order_gives_the_same_bit_for_bit() -> None:
    problem, controls = two_parameters(), random_controls(1)
    blocks = Blocks(problem, controls, 0)
    each = [blocks.summary(i, n) for i, n in division(1000, 150)]
    lines = [
        reduce(Summary.merge, [each[k] for k in order]).to_json() for order in ([*range(7)], [3, 1, 6, 0, 2, 5, 4])
    ]
    left, right = reduce(Summary.merge, each[:3]), reduce(Summary.merge, each[3:])
    assert {*lines, right.merge(left).to_json()} == {replay_blocks(problem, controls, 1000, size=150).to_json()}


def one_block(given: tuple[Floats, int, int]) -> str:
    controls, index, size = given
    return Blocks(two_parameters(), controls, 7).summary(index, size).to_json()


def test_other_processes_give_the_same_bit_for_bit() -> None:
    controls = random_controls(4)
    work = [(controls, i, n) for i, n in division(4000, 900)]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = [Summary.from_json(text) for text in pool.map(one_block, work)]
    assert (
        reduce(Summary.merge, found).to_json()
        == replay_blocks(two_parameters(), controls, 4000, size=900, seed=7).to_json()
    )


def test_a_block_depends_on_the_seed_its_index_and_its_size_alone() -> None:
    plan = ec.Plan(five(), random_controls(2), "planned")
    again = Blocks(five(), plan.controls, 3)
    again.summary(0, 50)
    assert block_summary(plan, 3, 4, 200) == again.summary(4, 200)
    draws = [again.members(i, 100)[4:, 0] for i in range(4)] + [Blocks(five(), plan.controls, 4).members(1, 100)[4:, 0]]
    assert len(np.unique(np.concatenate(draws))) == 5 * 96
    np.testing.assert_array_equal(again.members(0, 100)[:2, 0], [0.9, 1.1])
    assert 0.9 < again.members(1, 100)[0, 0] < 1.1
    assert again.members(0, 1).tolist() == [[0.9]]


def test_json_keeps_every_bit_of_what_has_no_number() -> None:
    problem = five().with_(obstacles={}, task=parse("G avoid(obstacles)"))
    found = block_summary(ec.Plan(problem, random_controls(), "planned"), 0, 0, 20)
    assert math.isnan(found.mean)
    assert found.worst[0].robustness == math.inf
    assert found.histograms[0].above == 20
    text = found.to_json()
    json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert Summary.from_json(text) == found
    assert Summary.from_json(text).to_json() == text


def test_summaries_of_different_work_do_not_mix() -> None:
    controls = random_controls()
    mine = Blocks(five(), controls).summary(0, 50)
    with pytest.raises(ProblemError, match="expected substeps 1, got 2"):
        mine.merge(Blocks(five(), controls, substeps=2).summary(0, 50))
    with pytest.raises(ProblemError, match="expected parts"):
        mine.merge(Blocks(five().with_(obstacles={}), controls).summary(0, 50))
    with pytest.raises(ProblemError, match="histogram: expected low"):
        mine.merge(Blocks(five(), controls / 2).summary(0, 50))


def test_a_replay_in_blocks_can_be_ended_and_keeps_what_is_done() -> None:
    seen = []

    def watch(so_far: Summary) -> bool:
        seen.append(so_far.members)
        return len(seen) == 2

    found = replay_blocks(five(), random_controls(), 1000, size=300, watch=watch)
    assert seen == [300, 600]
    assert found.members == 600


def test_memory_does_not_grow_with_the_members() -> None:
    problem, controls, peaks = five(), random_controls(), []
    replay_blocks(problem, controls, 100, size=50)
    for members in (40_000, 160_000):
        tracemalloc.start()
        try:
            replay_blocks(problem, controls, members, size=20_000)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0] < 60e6


SHARE = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1.95, 9], [-1, 1]]}}
task: %s
"""


def test_a_share_of_the_fleet_is_counted_with_its_interval() -> None:
    problem, controls = load_text(SHARE % "share(0.6, F[3, 4] in(goal))"), np.tile([[0.5, 0.0]], (20, 1))
    found = replay_blocks(problem, controls, 8000, size=3000)
    (share,) = found.shares
    members = all_members(Blocks(problem, controls), 8000, 3000)[2:]
    assert (share.satisfied, share.drawn) == (int((members >= 0.975).sum()), 7998)
    assert found.violating == 0
    assert found.good
    assert share.interval[0] < 0.625 < share.interval[1]  # of 0.9..1.1, those from 0.975 on
    late = replay_blocks(load_text(SHARE % "share(0.64, F[3, 4] in(goal))"), controls, 8000, size=3000)
    assert not late.good


@pytest.mark.parametrize("task", ["mean(F[3, 4] in(goal))", "share(0.5, F[3, 4] in(goal)) or F[3, 4] in(goal)"])
def test_a_task_of_the_fleet_as_a_whole_is_refused(task: str) -> None:
    with pytest.raises(UnsupportedError, match="expected a task that is read for each member"):
        Blocks(load_text(SHARE % task), np.zeros((20, 2)))


def test_bins_hold_what_they_say() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(3.0, 0.7, 5000)
    found = (
        Histogram.over("x", values[:100])
        .counted(values[:3000])
        .merge(Histogram.over("x", values[:100]).counted(values[3000:]))
    )
    wanted, _ = np.histogram(values, found.edges)
    np.testing.assert_array_equal(found.counts, wanted)
    assert found.below == (values < found.edges[0]).sum()
    assert found.above == (values >= found.edges[-1]).sum()
    assert len(found.counts) == BINS == 2000
    assert found.edges[0] <= values[:100].min() <= values[:100].max() < found.edges[-1]
    for share in (0.0001, 0.1, 0.5, 0.9):
        low, high = found.quantile(share)
        assert low <= np.quantile(values, share, method="inverted_cdf") <= high


@pytest.mark.parametrize("values", [[1.0], [0.0, 0.0], [-2.0e6], [np.inf]])
def test_bins_around_one_value(values: list[float]) -> None:
    found = Histogram.over("x", np.array(values)).counted(np.array(values))
    assert found.counts.sum() == np.isfinite(values).sum()
    assert found.total == len(values)
