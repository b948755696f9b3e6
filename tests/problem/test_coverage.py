"""What is said of obstacles that nobody avoids all the time, and of windows that contain each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import (
    Always,
    ExactOps,
    StateSignals,
    conjuncts,
    resolve,
    robustness,
    without_implied,
)
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.problem.checks import coverage_text, findings
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.specification import NOTHING_REQUIRED, clearances
from ensemble_ctrl.report import summary_lines
from ensemble_ctrl.report.words import certificate_words
from tests.examples import examples

NAMES = ("o1", "o2", "o3", "post")


def box(left: float) -> tuple[ec.Obstacle]:
    """An obstacle beside the way."""
    return (ec.Obstacle.box(np.array([[left, left + 0.3], [0.8, 0.9]])),)


def problem(task: str, **changes: Any) -> ec.Problem:
    """Twenty seconds, a goal and four obstacles beside the way."""
    fleet = ec.Fleet(
        ec.Unicycle(), {"traction": ec.Interval(0.9, 1.1)}, np.zeros(2), 0.0, np.full(2, -2.0), np.full(2, 2.0)
    )
    fields: dict[str, Any] = {
        "regions": {"goal": ec.Polyhedron.box([[1.0, 2.0], [-0.5, 0.5]])},
        "obstacles": {name: box(0.5 + i) for i, name in enumerate(NAMES)},
    }
    return ec.Problem("covered", fleet, 20.0, 100, ec.parse(task), **{**fields, **changes})


def warnings(task: str, **changes: Any) -> list[str]:
    """The texts without hints."""
    return [found.message for found in findings(problem(task, **changes)) if found.severity == "warning"]


NEVER = "the task never mentions this obstacle, so robots may drive through it"
START = "holds at t = 0 only, as it is outside of every temporal operator"


@pytest.mark.parametrize(
    ("task", "said", "line"),
    [
        ("G avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("G[0,20] avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("G[0,T] avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("not F not avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("G[0,9] avoid(obstacles) and G[8,20] avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("G[0,8] G[0,12] avoid(obstacles) and F in(goal)", [], "throughout: o1..o3, post"),
        ("G (avoid(obstacles) and x <= 9) and F in(goal)", [], "throughout: o1..o3, post"),
        (
            "G[0,16] avoid(obstacles) and F in(goal)",
            ["o1..o3, post are not avoided 16..20 s"],
            "only 0..16 s: o1..o3, post",
        ),
        (
            "G[0,4] avoid(post) and G[6,20] avoid(post) and G avoid(o1) and G avoid(o2) and G avoid(o3) and F in(goal)",
            ["post is not avoided 4..6 s"],
            "throughout: o1..o3; only 0..4 s and 6..20 s: post",
        ),
        (
            "G[16,T] avoid(o1) and G[0,16] avoid(obstacles) and F in(goal)",
            ["o2, o3, post are not avoided 16..20 s"],
            "throughout: o1; only 0..16 s: o2, o3, post",
        ),
        (
            "F[6,8] in(goal) and avoid(post)",
            [NEVER] * 3 + ["post is avoided at t = 0 s only", f"avoid(post) {START}"],
            "only at t = 0 s: post; never: o1..o3",
        ),
        (
            "F[6,8] (in(goal) and avoid(post)) and G avoid(o1) and G avoid(o2)",
            [NEVER, "post is avoided at some time only, which the plan chooses"],
            "throughout: o1, o2; never: o3, post",
        ),
        ("avoid(obstacles) U in(goal)", [], "as the task says: o1..o3, post"),
        ("F (in(goal) or G avoid(obstacles))", [], "as the task says: o1..o3, post"),
        ("share(0.9, G avoid(obstacles)) and F in(goal)", [], "as the task says: o1..o3, post"),
        ("in(goal) -> G avoid(obstacles)", [f"in(goal) {START}"], "as the task says: o1..o3, post"),
        ("x <= 1 and G avoid(obstacles) and F in(goal)", [f"-x >= -1 {START}"], "throughout: o1..o3, post"),
        (
            "F in(goal)",
            ["the task never mentions the obstacles, so robots may drive through them"],
            "throughout: none; never: o1..o3, post",
        ),
    ],
)
def test_what_is_not_avoided_is_named_with_its_time(task: str, said: list[str], line: str) -> None:
    if "->" in task:
        left, right = task.split(" -> ")
        task = f"not {left} or {right}"
        said = [text.replace("in(goal) holds", "not in(goal) holds") for text in said]
    assert warnings(task) == said
    assert coverage_text(problem(task)) == f"avoided {line}"


def test_a_longer_horizon_leaves_a_gap_after_an_explicit_window() -> None:
    task = "G[0,20] avoid(obstacles) and F in(goal)"
    longer = problem(task).with_(duration=24.0)
    assert [found.message for found in findings(longer)] == ["o1..o3, post are not avoided 20..24 s"]


def test_what_is_meant_is_listed() -> None:
    task = "G[0,16] avoid(o1) and G avoid(o2) and F in(goal)"
    meant = problem(task, ignore=["o1", "o3", "post"])
    assert findings(meant) == ()
    assert coverage_text(meant) == "avoided throughout: o2; only 0..16 s: o1; never: o3, post"
    assert load_text(dump(meant)).ignore == ("o1", "o3", "post")
    assert warnings(task, ignore=["o1", "o3", "post", "p0st"]) == ["there is no obstacle 'p0st'"]
    assert "did you mean 'post'?" in [found.hint for found in findings(problem(task, ignore=["o3", "p0st"]))]


def test_the_summary_says_it_and_no_clearance_is_infinite() -> None:
    none = ec.Plan(problem("F in(goal)"), np.tile([0.08, 0.0], (100, 1)), "planned")
    seen = replace(none, replayed=none.replay(members=5), certificate=none.certify())
    lines = summary_lines(seen)
    assert "  obstacles  avoided throughout: none; never: o1..o3, post" in lines
    assert "  clearance  no obstacle is to be avoided" in lines
    for text in (repr(seen.replayed), repr(seen.certificate), *lines):
        assert "inf" not in text.replace("infeasible", "")


END = st.tuples(st.integers(0, 8), st.booleans())
WINDOW = st.none() | st.tuples(END, END).map(sorted)
PART = st.tuples(st.sampled_from("GF"), WINDOW, st.sampled_from(["x >= 0", "y >= 0.2"]))


def window_text(ends: list[tuple[int, bool]]) -> str:
    """A window of a plan of 8 s, each end counted from the beginning or from the end."""
    low, high = (f"T-{8 - time}" if late else str(time) for time, late in ends)
    return f"[{low},{high}]"


@given(st.lists(PART, min_size=2, max_size=8), st.integers(0, 1000))
@examples(60)
def test_conjuncts_that_are_left_out_say_nothing_more(parts: list[Any], seed: int) -> None:
    texts = [f"{op}{'' if window is None else window_text(window)} {leaf}" for op, window, leaf in parts]
    task = ec.parse(" and ".join(texts))
    kept = without_implied(conjuncts(task), 8.0)
    signals = StateSignals(np.random.default_rng(seed).normal(size=(3, 9, 2)), ("x", "y"), 1.0)
    whole, least = (float(robustness(f, signals, ExactOps())) for f in (task, kept[0]))
    for part in kept[1:]:
        least = min(least, float(robustness(part, signals, ExactOps())))
    assert least == whole
    assert without_implied(kept, 8.0) == kept


@pytest.mark.parametrize("part", ["x <= 6", "avoid(wall)", "share(0.5, x <= 6)", "mean(x <= 6)"])
def test_windows_that_are_counted_from_the_end_are_where_they_are(part: str) -> None:
    """Robots at 1 m a second are past 6 m from 6 s on: it is not enough to look until T - 5."""
    fleet = ec.Fleet(ec.Unicycle(), {}, np.zeros(2), 0.0, np.full(2, -2.0), np.full(2, 2.0))
    wall = {"wall": (ec.Obstacle.box(np.array([[6.0, 9.0], [-1.0, 1.0]])),)}
    controls = np.tile([1.0, 0.0], (10, 1))
    for task in (f"G[0,T-5] {part} and G[0,8] {part}", f"G[T-9,T-8] {part} and G[T-3,T] {part}"):
        assert ec.certify(ec.Problem("late", fleet, 10.0, 10, ec.parse(task), {}, wall), controls).proven == "no"


def test_a_window_counted_from_the_end_ends_where_its_decimals_say() -> None:
    resolved = resolve(ec.parse("G[0,T-0.1] x <= 0.2"), 0.3)
    assert isinstance(resolved, Always)
    assert resolved.b == 0.2


def test_a_thousand_windows_that_contain_each_other_are_one() -> None:
    text = " and ".join(
        f"G[0,{20 - i / 1000:g}] avoid(obstacles) and F[0,{20 - i / 1000:g}] in(goal)" for i in range(500)
    )
    many, one = problem(text), problem("G avoid(obstacles) and F[0,19.501] in(goal)")
    assert [(d.name, d.begin, d.end) for d in many.specification.avoid] == [
        (d.name, d.begin, d.end) for d in one.specification.avoid
    ]
    assert [part.written for part in many.specification.parts] == [part.written for part in one.specification.parts]
    controls = np.tile([0.08, 0.01], (100, 1))
    for parameters in ([0.9], [1.1]):
        left, right = (replay(p, controls, parameters=parameters).robustness for p in (many, one))
        assert np.array_equal(left, right)
    paths = np.zeros((1, 101, 2))
    assert np.array_equal(clearances(many, paths, 9.0), clearances(one, paths, 9.0))


@pytest.mark.parametrize("task", ["G avoid(obstacles)", "share(0.5, G avoid(obstacles))"])
def test_of_a_task_that_asks_nothing_nothing_is_claimed(task: str) -> None:
    free = problem(task, obstacles={})
    made = ec.Plan(free, np.tile([0.08, 0.0], (100, 1)), "planned")
    seen = replace(made, replayed=made.replay(members=5), certificate=made.certify())
    assert seen.certificate is not None
    assert (seen.certificate.proven, seen.certificate.empty) == ("yes", True)
    lines = summary_lines(seen)
    assert lines[0].startswith("covered: plan found, nothing is required, ")
    assert f"  proven     {NOTHING_REQUIRED}" in lines
    lead = certificate_words(free, seen.certificate).lead
    assert lead.startswith("Nothing is required: ")
    for text in (repr(seen.replayed), repr(seen.certificate), lead, *lines):
        assert "inf" not in text
        assert "proven for every" not in text


def test_what_is_asked_in_part_is_claimed() -> None:
    made = ec.Plan(problem("F in(goal)"), np.tile([0.08, 0.0], (100, 1)), "planned")
    assert not made.certify().empty
    assert not ec.Plan(problem("G avoid(obstacles)"), made.controls, "planned").certify().empty
