"""Searches over ranges of parameters: how few groups cover a fleet, and how wide a range may be."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.api.channels import Channels, channels
from ensemble_ctrl.api.widening import widest_box
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.moments import Interval, Samples
from ensemble_ctrl.planning.ranges import Cover, Found, Oracle, Scaled, largest, part, places, robots, widened
from ensemble_ctrl.planning.ranges import curve as curves
from ensemble_ctrl.planning.ranges.bound import _arcs, _meetings, apart
from ensemble_ctrl.planning.ranges.box import Boxes
from ensemble_ctrl.planning.ranges.channels import Grouped
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples

GATE = """
fleet:
  model: double_integrator
  parameters: {mass: {range: [1.0, 1.7]}}
  start: {position: [0, 0]}
horizon: {duration: 4 s, steps: 16}
regions: {goal: {box: [[1.7, 2.3], [-0.5, 0.5]]}}
task: G[3.5, 4] in(goal)
verify: {members: 200}
"""
"""Members move by the same control over their mass, so a group's largest is at most 2.3 / 1.7 = 1.353 of its least."""

UNICYCLES = (
    GATE.replace("double_integrator", "unicycle").replace("mass", "traction").replace("[0, 0]}", "[0, 0], heading: 0}")
)


def problem(**distributions: Any) -> Problem:
    """The problem above; with distributions, that of a fleet of unicycles."""
    if not distributions:
        return load_text(GATE)
    base = load_text(UNICYCLES)
    return base.with_(fleet=base.fleet.with_distributions(distributions))


def exact(
    whole: Problem,
    good: Callable[[Fleet], bool],
    effort: Callable[[Fleet], int] = lambda fleet: 20,
    screens: list[Fleet] | None = None,
) -> Any:
    """An oracle that knows: `good` says which parts have a plan; `screens` gets those that routes are looked for of."""

    def certified(fleet: Fleet, guesses: Any = (), routes: str = "search") -> Any:
        tried.append(fleet)
        if screens is not None and routes == "screen":
            screens.append(fleet)
        solution = SimpleNamespace(problem=SimpleNamespace(fleet=fleet), controls=np.zeros((1, 2)))
        return SimpleNamespace(solution=solution, effort=effort(fleet)) if good(fleet) else None

    tried: list[Fleet] = []
    return SimpleNamespace(
        problem=whole, certified=certified, stopped=False, tried=tried, failed=[], screens=screens is not None
    )


def ends(cover: Cover, name: str) -> list[tuple[float, float]]:
    """Ranges of a parameter in the parts of a cover."""
    distributions = [found.solution.problem.fleet.parameters[name] for found in cover.parts]
    return [(distribution.lower, distribution.upper) for distribution in distributions]


@given(st.integers(0, 60), st.integers(1, 40), st.integers(1, 60))
@examples(100)
def test_the_largest_whole_number_is_found_and_nothing_is_tried_twice(wanted: int, first: int, limit: int) -> None:
    tried: list[float] = []

    def works(number: float) -> bool:
        tried.append(number)
        return number <= wanted

    good, bad = largest(works, min(first, limit), limit, 1, whole=True)
    assert good == min(wanted, limit)
    assert bad == (limit if wanted >= limit else good + 1)
    assert len(set(tried)) == len(tried)
    assert max(tried) <= limit


@given(st.floats(0.01, 5.0), st.floats(0.02, 3.0))
@examples(100)
def test_the_largest_number_is_found_to_the_tolerance(wanted: float, first: float) -> None:
    good, bad = largest(lambda x: x <= wanted, first, 4.0, 0.01)
    assert good <= wanted
    assert bad - good <= 0.01
    assert bad > wanted or good == 4.0


@given(st.lists(st.floats(0.5, 9.0), min_size=1, max_size=12, unique=True), st.floats(1.01, 3.0))
@examples(60)
def test_measured_robots_need_as_few_groups_as_the_best_of_all_partitions(values: list[float], ratio: float) -> None:
    whole = problem(traction=Samples(values))

    def together(low: float, high: float) -> bool:
        return high <= ratio * low

    @cache
    def fewest(k: int) -> int:  # dynamic programming over all partitions of the sorted robots
        ordered = sorted(values)
        if k == 0:
            return 0
        return min(fewest(i) + 1 for i in range(k) if together(ordered[i], ordered[k - 1]))

    for downwards in (False, True):
        oracle = exact(whole, lambda fleet: together(float(fleet.lower[0]), float(fleet.upper[0])))
        cover = Cover(oracle, 100, 99, downwards).run()
        assert cover.missed is None
        assert len(cover.parts) == fewest(len(values))
        groups = [cast(Samples, f.solution.problem.fleet.parameters["traction"]).values for f in cover.parts]
        assert sorted(np.concatenate(groups)) == sorted(values)


def test_a_range_is_covered_without_gaps_from_both_ends() -> None:
    whole = problem(traction=Interval(0.5, 2.0))
    for downwards in (False, True):
        oracle = exact(whole, lambda fleet: fleet.upper[0] <= 1.5 * fleet.lower[0])
        cover = Cover(oracle, 300, 99, downwards).run()
        found = sorted(ends(cover, "traction"))
        assert len(found) == 4
        assert (found[0][0], found[-1][1]) == (0.5, 2.0)
        assert all(high == low for (_, high), (low, _) in pairwise(found))


def test_where_nothing_has_a_plan_the_search_says_what_it_missed_and_tries_little() -> None:
    oracle = exact(problem(traction=Interval(0.5, 2.0)), lambda fleet: fleet.upper[0] <= 0.9)
    cover = Cover(oracle, 100, 99).run()
    assert cover.missed is not None
    assert cover.missed.lower[0] == pytest.approx(0.89, abs=0.016)
    assert len(oracle.tried) < 30


def test_two_parameters_are_split_into_boxes_that_cover_every_member() -> None:
    whole = problem(linear_traction=Interval(0.5, 1.5), angular_traction=Interval(0.8, 1.2))
    oracle = exact(whole, lambda fleet: float(np.prod(fleet.upper - fleet.lower)) <= 0.11)
    cover = Cover(oracle, 100, 99).run()
    assert cover.missed is None
    boxes = [(f.solution.problem.fleet.lower, f.solution.problem.fleet.upper) for f in cover.parts]
    members = whole.fleet.sample(2000, 0)
    inside = [((members >= low) & (members <= high)).all(axis=1) for low, high in boxes]
    assert np.any(inside, axis=0).all()
    assert sum(float(np.prod(high - low)) for low, high in boxes) == pytest.approx(0.4)
    assert len(boxes) <= 6


def test_parts_of_measured_fleets_keep_their_robots_together() -> None:
    rows = {"linear_traction": [1.0, 0.9, 1.1, 1.2], "angular_traction": [0.7, 0.8, 0.9, 1.0]}
    fleet = Fleet(Unicycle(), {n: Samples(v) for n, v in rows.items()}, [0, 0], 0.0, samples=rows)
    some = part(fleet, "linear_traction", 1.0, 1.1)
    assert some.samples is not None
    assert some.samples["angular_traction"].tolist() == [0.7, 0.9]
    assert some.parameters["angular_traction"] == Samples([0.7, 0.9])
    assert (robots(fleet), robots(some)) == (4, 2)
    assert places(some, "linear_traction", 50).tolist() == [1.0, 1.1]


@cache
def gate() -> Channels:
    """The channels of the problem above, found once."""
    return channels(problem(), tolerance=0.02)


def test_channels_are_certified_cover_the_fleet_and_are_as_few_as_can_be() -> None:
    found = gate()
    assert found.missed is None
    assert len(found.channels) == 2  # one would need the ratio 1.7
    low, high = (channel.ranges["mass"] for channel in found.channels)
    assert (low.lower, high.upper) == (1.0, 1.7)
    assert low.upper == high.lower
    assert 1.30 < low.upper <= 2.3 / 1.7
    for channel in found.channels:
        again = certify(channel.plan.problem, channel.plan.controls)
        assert again.proven == "yes"
        assert channel.plan.verified
        run = channel.plan.replay(parameters=np.linspace(*_ends(channel.ranges["mass"]), 41), substeps=10)
        assert not run.violating.any()


def _ends(distribution: Interval) -> tuple[float, float]:
    return distribution.lower, distribution.upper


def test_more_channels_than_allowed_are_no_answer() -> None:
    found = channels(problem(), 1, tolerance=0.1)
    assert found.channels == ()
    assert found.missed is not None
    assert found.missed["mass"].upper == 1.7


def test_a_wish_to_stop_ends_the_search() -> None:
    seen: list[Fleet] = []
    found = channels(problem(), progress=lambda phase, iteration: True, tell=lambda fleet, good: seen.append(fleet))
    assert found.channels == ()
    assert len(seen) <= 1


def test_tasks_of_the_fleet_as_a_whole_are_refused() -> None:
    with pytest.raises(ProblemError, match=r"expected one of every member by itself, got mean\(\)"):
        channels(load_text(GATE.replace("G[3.5, 4] in(goal)", "G[3.5, 4] mean(in(goal))")))


def test_a_part_that_the_checks_refuse_has_no_plan_and_is_not_solved() -> None:
    whole = load_text(UNICYCLES)
    oracle = Oracle(whole)
    slow = whole.fleet.with_distributions({"traction": Interval(0.01, 0.02)})
    assert oracle.certified(slow) is None
    assert oracle.failed == []


def test_members_that_can_not_share_a_control_bound_the_channels_from_below() -> None:
    found = gate()
    assert found.lower_bound == 2 == len(found.channels)
    first, second = (member["mass"] for member in found.apart)
    assert second / first > 2.3 / 1.7  # the goal, seen from the start
    wide = load_text(GATE.replace("[1.0, 1.7]", "[1.0, 4.0]"))
    assert len(apart(wide)) == 1 + int(np.log(4.0) / np.log(2.3 / 1.7))


def test_nothing_is_proven_where_members_may_come_one_after_the_other_or_turn_freely() -> None:
    assert len(apart(load_text(GATE.replace("G[3.5, 4]", "F[3.5, 4]")))) == 1
    assert len(apart(problem(traction=Interval(0.5, 1.7)))) == 1


SLOW_TURNS = UNICYCLES.replace("horizon", "  input_bounds: {v: [0, 2], omega: [-0.05, 0.05]}\nhorizon")
SLOW_TURNS = SLOW_TURNS.replace("[1.0, 1.7]", "[0.5, 1.5]")


@given(st.integers(0, 10**6))
@examples(40)
def test_no_random_control_brings_two_members_closer_than_the_bound_says(seed: int) -> None:
    whole, rng = load_text(SLOW_TURNS), np.random.default_rng(seed)
    fleet = whole.fleet
    controls = rng.uniform(fleet.input_lower, fleet.input_upper, (whole.steps, 2))
    pair = np.sort(rng.uniform(0.5, 1.5, (2, 1)), axis=0)
    meeting = next(iter(_meetings(whole)))
    relation = _arcs(whole, meeting, pair)
    assert relation is not None
    factor, start, image, error = relation
    at = round(meeting.begin / whole.step)
    one, other = fleet.trajectories(controls, pair, whole.step)[:, at, :2]
    assert np.linalg.norm(other - image - factor * (one - start)) <= error + 1e-12


def test_robots_that_turn_slowly_can_not_share_a_control() -> None:
    members = apart(load_text(SLOW_TURNS))
    assert len(members) >= 2
    ratio = members[1]["traction"] / members[0]["traction"]
    assert ratio > 2.3 / 1.7


def test_measured_members_are_compared_as_they_are() -> None:
    whole = load_text(GATE)
    rows = whole.with_(fleet=whole.fleet.with_distributions({"mass": Samples([1.0, 1.2, 2.0, 2.1])}))
    assert [member["mass"] for member in apart(rows)] == [1.0, 2.0]


def test_the_curve_climbs_as_far_as_the_channels_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A world where k channels keep 0.1 k metres, and what is proven is a little more than what was required."""
    asked: list[float] = []

    def groups(count: int, clearance: float) -> Grouped:
        solution = SimpleNamespace(certificate=SimpleNamespace(clearance=clearance))
        return Grouped((cast(Found, SimpleNamespace(solution=solution)),) * count, None, ({},), 1)

    def fewest(problem: Problem, most: int, ticks: int, clearance: float, **_: Any) -> Grouped:
        asked.append(clearance)
        needed = max(2, int(np.ceil(10 * clearance)))
        return groups(needed, clearance + 0.001) if needed <= most else Grouped((), problem.fleet, ({},), 1)

    monkeypatch.setattr(curves, "fewest", fewest)
    walled = load_text(UNICYCLES + "obstacles: {wall: {box: [[-9, -5], [1, 2]]}}\n")
    found = curves.curve(walled, groups(2, 0.03), 5)
    assert [len(point.groups) for point in found] == [2, 3, 5]
    assert all(point.clearance <= 0.1 * len(point.groups) + 0.001 for point in found)
    assert found[-1].clearance > 0.4
    assert max(asked) < 1.0
    assert [len(point.groups) for point in curves.curve(walled, groups(2, 0.03), 2)] == [2]


def half_widths(fleets: list[Fleet]) -> list[float]:
    return [float((fleet.upper - fleet.lower)[0] / 2) for fleet in fleets]


@given(st.floats(0.05, 0.9), st.floats(0.02, 0.3), st.integers(10, 200))
@examples(60)
def test_the_largest_size_is_found_however_hard_plans_are_to_find(widest: float, first: float, most: int) -> None:
    whole = problem(traction=Interval(0.95, 1.05))
    hard = exact(
        whole,
        lambda fleet: half_widths([fleet])[0] <= widest,
        lambda fleet: int(most * half_widths([fleet])[0] / widest),
        [],
    )
    search = Scaled(hard, lambda half: widened(whole.fleet, {"traction": half}))
    found = search.run(first, 0.95, 0.01)
    assert found <= widest + 1e-12
    assert widest - found <= 0.01 + 1e-9
    assert found == search.good
    sizes = half_widths(hard.tried)
    assert len({round(size, 12) for size in sizes}) == len(sizes), "nothing is tried twice"


def test_near_the_largest_size_steps_are_small_and_routes_are_looked_for_once() -> None:
    """After a plan that was hard to find the next size is wider by the tolerance, and one failing try is enough."""
    whole, screens = problem(traction=Interval(0.95, 1.05)), list[Fleet]()
    oracle = exact(
        whole,
        lambda fleet: half_widths([fleet])[0] <= 0.1128,
        lambda fleet: 120 if half_widths([fleet])[0] > 0.11 else 20,
        screens,
    )
    search = Scaled(oracle, lambda half: widened(whole.fleet, {"traction": half}))
    assert search.run(0.05, 0.95, 0.01) == pytest.approx(0.1125)
    assert half_widths(oracle.tried) == pytest.approx([0.05, 0.075, 0.1125, 0.1223, 0.1306], abs=1e-4)
    assert half_widths(screens) == pytest.approx([0.075, 0.1125, 0.1306], abs=1e-4)


def test_another_route_goes_on_beyond_the_first_ones_largest_size() -> None:
    """Continuations end at 0.11; routes that are looked for beyond lead on to 0.4."""
    whole = problem(traction=Interval(0.95, 1.05))
    elsewhere: list[bool] = []

    def good(fleet: Fleet) -> bool:
        half = half_widths([fleet])[0]
        elsewhere.extend([True] * (len(screens) > 0 and screens[-1] is fleet and half > 0.12))
        return half <= (0.4 if elsewhere else 0.1128)

    screens: list[Fleet] = []
    oracle = exact(whole, good, lambda fleet: 120 if half_widths([fleet])[0] > 0.11 else 20, screens)
    search = Scaled(oracle, lambda half: widened(whole.fleet, {"traction": half}))
    assert 0.39 <= search.run(0.05, 0.95, 0.01) <= 0.4


def test_a_search_that_is_stopped_keeps_what_it_found() -> None:
    whole = problem(linear_traction=Interval(0.95, 1.05), angular_traction=Interval(0.9, 1.1))
    oracle = exact(whole, lambda fleet: len(oracle.tried) <= 3)
    boxes = Boxes(oracle, ("linear_traction", "angular_traction")).run()
    assert len(boxes.boxes) == 1
    assert boxes.boxes[0].halves[0] > 0
    assert boxes.boxes[0].halves[1] == 0


def test_the_largest_box_of_two_parameters_is_that_of_the_largest_area() -> None:
    whole = problem(linear_traction=Interval(0.95, 1.05), angular_traction=Interval(0.9, 1.1))
    most = np.array([0.4, 0.6])  # an ellipse of half widths: the largest area is at both divided by sqrt(2)
    oracle = exact(whole, lambda fleet: float((((fleet.upper - fleet.lower) / 2 / most) ** 2).sum()) <= 1.0)
    boxes = Boxes(oracle, ("linear_traction", "angular_traction")).run()
    best = boxes.largest
    assert best is not None
    assert 0.93 * 2 * most.prod() <= best.area <= 2 * most.prod()
    assert [box.angle for box in boxes.boxes] == sorted(box.angle for box in boxes.boxes)
    assert boxes.boxes[0].halves[0] == pytest.approx(0.4, abs=0.02)
    assert boxes.boxes[-1].halves[1] == pytest.approx(0.6, abs=0.02)
    assert all((np.square(box.halves) / most**2).sum() <= 1.0 + 1e-9 for box in boxes.boxes)
    assert len(oracle.tried) < 80


def test_a_box_of_robots_on_the_plane_is_certified_and_on_its_curve() -> None:
    small = load_text(
        """
        fleet:
          model: unicycle
          parameters: {start_x: {range: [-0.1, 0.1]}, start_y: {range: [-0.1, 0.1]}}
          start: {position: [0, 0], heading: 0 deg}
        horizon: {duration: 4 s, steps: 8}
        regions: {goal: {box: [[2, 4], [-0.5, 0.5]]}}
        task: G[3.5, 4] in(goal)
        objective: {terminal: {target: [3, 0]}}
        verify: {members: 100}
        """
    )
    found = widest_box(small)
    assert found.plan is not None
    assert certify(found.plan.problem, found.plan.controls).proven == "yes"
    halves = [found.ranges[name].half_width for name in ("start_x", "start_y")]
    # members keep their offsets, so the box fits into the goal: 2 m by 1 m
    assert 0.85 < halves[0] < 1.0
    assert 0.42 < halves[1] < 0.5
    assert any(list(point.values()) == pytest.approx(halves) for point in found.curve)
    with pytest.raises(ProblemError, match=r"expected two of the fleet's \(start_x, start_y\), got mass, start_x"):
        widest_box(small, ("mass", "start_x"))


def test_a_fleet_of_equal_robots_needs_one_channel() -> None:
    found = channels(load_text(GATE.replace("  parameters: {mass: {range: [1.0, 1.7]}}\n", "")))
    assert [channel.ranges for channel in found.channels] == [{}]
    assert found.lower_bound == 1
    same = channels(problem(traction=Interval(1.0, 1.0)))
    assert len(same.channels) == 1
