"""Tasks laid out in time: against every walk there is, and as guesses from which a plan is found."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import milp

from ensemble_ctrl import load
from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Eventually,
    Formula,
    Inside,
    Not,
    Or,
    Until,
    negation_normal_form,
    parse,
)
from ensemble_ctrl.constraints.stl.dense import shrunk
from ensemble_ctrl.ocp.guesses import first_guesses
from ensemble_ctrl.ocp.guesses import laid_out as laid_out_module
from ensemble_ctrl.ocp.guesses.itinerary import Journey, itinerary
from ensemble_ctrl.ocp.guesses.laid_out import laid_out, repeats
from ensemble_ctrl.ocp.guesses.registry import Request
from ensemble_ctrl.planning.planner import solve
from tests.paths import CONFIGS

STEPS = 6
PLACES = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
NAMES = {"a": 0, "b": 1, "c": 2}
WAYS = [Journey(0, 1, 1, np.zeros((0, 2))), Journey(1, 0, 1, np.zeros((0, 2))), Journey(1, 2, 1, np.zeros((0, 2)))]
WAYS += [Journey(2, 0, 2, PLACES[1:2]), Journey(0, 2, 2, PLACES[1:2] + 0.5)]


def holds(formula: Formula, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a part without temporal operators holds at some places."""
    match formula:
        case Inside(name=name):
            return np.asarray(np.all(points == PLACES[NAMES[name]], axis=-1))
        case Not(child=child):
            return ~holds(child, points)
        case And(children=children):
            return np.asarray(np.all([holds(child, points) for child in children], axis=0))
        case Or(children=children):
            return np.asarray(np.any([holds(child, points) for child in children], axis=0))
    raise AssertionError(formula)


def walks(places: list[NDArray[np.float64]], at: int, moved: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Every way to spend the steps from a place on: steps travelled, and the place at each step."""
    left = STEPS - len(places) + 1
    if left == 0:
        yield moved, np.array(places)
        return
    yield from walks([*places, PLACES[at]], at, moved)
    for way in WAYS:
        if way.begin == at and way.steps <= left:
            yield from walks([*places, *way.passed, PLACES[way.end]], way.end, moved + way.steps)


def true(formula: Formula, track: NDArray[np.float64], k: int) -> bool:
    """The plain meaning of a formula on a track, windows cut at its end."""
    match formula:
        case Eventually(child=child, a=a, b=b):
            return any(true(child, track, j) for j in window(a, b, k))
        case Always(child=child, a=a, b=b):
            return all(true(child, track, j) for j in window(a, b, k))
        case Until(left=left, right=right, a=a, b=b):
            inside = window(a, b, k)
            return any(true(right, track, j) and all(true(left, track, i) for i in range(k, j + 1)) for j in inside)
        case And(children=children):
            return all(true(child, track, k) for child in children)
        case Or(children=children):
            return any(true(child, track, k) for child in children)
    return bool(holds(formula, track[k : k + 1])[0])


def window(a: float | None, b: float | None, k: int) -> range:
    first, last = (0, STEPS) if a is None or b is None else (round(a), round(b))
    return range(min(k + first, STEPS), min(k + last, STEPS) + 1)


@pytest.mark.parametrize(
    "text",
    [
        "F in(c)",
        "F[2,3] in(c) and F[5,6] in(a)",
        "G[0,3] F[0,3] in(a) and F in(c)",
        "G[0,2] F[0,2] in(a) and F in(c)",
        "G (not in(b) or F[0,2] in(c)) and F in(b) and F[6,6] in(a)",
        "(not in(c)) U[3,6] in(b) and F in(c)",
        "(not in(c)) U[3,6] in(b) and F[0,2] in(c)",
        "not in(b) U[0,4] in(c)",
        "G[1,6] (in(b) or in(c)) and F in(c)",
        "F G[0,3] in(c) and F[0,1] in(b)",
        "G not in(b) and F[0,2] in(c)",
        "F[0,1] in(c)",
    ],
)
def test_the_shortest_of_all_walks_is_found(text: str) -> None:
    task = negation_normal_form(parse(text))
    stops = itinerary(task, PLACES, WAYS, STEPS, 1.0, holds)
    good = sorted(moved for moved, track in walks([PLACES[0]], 0, 0) if true(task, track, 0))
    assert (stops is None) == (not good)
    if stops is not None:
        assert sum(WAYS[stop.journey].steps for stop in stops[1:]) <= 1.5 * good[0] + 1
        track = np.full((STEPS + 1, 2), np.nan)
        for stop in stops:
            track[stop.arrive : stop.leave + 1] = PLACES[stop.place]
            if stop.journey >= 0:
                way = WAYS[stop.journey]
                track[stop.arrive - way.steps + 1 : stop.arrive] = way.passed
        assert true(task, track, 0)


def test_the_last_place_can_be_given() -> None:
    task = parse("F in(c)")
    free, back = (itinerary(task, PLACES, WAYS, STEPS, 1.0, holds, last) for last in (None, 0))
    assert free is not None
    assert back is not None
    assert (free[-1].place, back[-1].place) == (2, 0)


def test_windows_shrink_where_visits_are_repeated_only() -> None:
    assert shrunk(parse("F[0,5] in(a) and G[0,9] F[0,5] in(a)"), 0.5) == parse("F[0,5] in(a) and G[0,9] F[0.5,5] in(a)")
    assert shrunk(parse("G[0,9] (in(b) U[1,5] in(a))"), 0.5) == parse("G[0,9] (in(b) U[1.5,5] in(a))")
    short = parse("G[0,9] F[0,0.5] in(a)")
    assert shrunk(short, 0.5) == short


def test_repeated_and_conditional_visits_are_laid_out_in_time() -> None:
    problem = load(CONFIGS / "stl" / "patrol.yaml")
    assert repeats(problem)
    assert not repeats(load(CONFIGS / "stl" / "door_puzzle.yaml"))
    (guess,) = laid_out(Request(problem, problem.steps))
    assert guess.kind == "itinerary"
    assert {"west", "east", "sample", "radio"} <= set(guess.visits)
    assert [one.kind for one in first_guesses(Request(problem, problem.steps))] == ["itinerary"]
    quick = first_guesses(Request(problem, problem.steps, quick=True))
    assert {one.kind for one in quick} == {"route"}


def test_itineraries_are_looked_for_in_a_part_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load(CONFIGS / "stl" / "patrol.yaml")
    assert laid_out(Request(problem, problem.steps, left=lambda: 0.0)) == []
    limits: list[float] = []
    monkeypatch.setattr(laid_out_module, "itinerary", lambda *given: limits.append(given[-1]))
    assert laid_out(Request(problem, problem.steps, left=lambda: 8.0)) == []
    assert limits == [2.0, 2.0, 2.0]


@pytest.mark.slow
def test_repeated_and_conditional_visits_are_planned() -> None:
    found = solve(load(CONFIGS / "stl" / "patrol.yaml"))
    assert found.certificate is not None
    assert found.certificate.proven == "yes"


def test_the_solver_prints_nothing(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """HiGHS writes to the terminal past its own switch."""

    def loud(*given: Any, **options: Any) -> Any:
        os.write(1, b"Presolve\n")
        return milp(*given, **options)

    monkeypatch.setattr("scipy.optimize.milp", loud)
    task = Eventually(Inside("b"), 0.0, 6.0)
    assert itinerary(task, PLACES, WAYS, STEPS, 1.0, holds) is not None
    assert capfd.readouterr().out == ""
