"""What fails is named with its amount, its time and whose parameter it is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import conflicts, unit_of_parts
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report.text import conflict_text, measured, proven
from ensemble_ctrl.report.words import certificate_words
from ensemble_ctrl.systems import OdeSystem
from tests.paths import CONFIGS

CONFIG = CONFIGS / "five_obstacles.yaml"
FORWARD = np.zeros((160, 2))
FORWARD[:, 0] = np.sqrt(2) * 4 / 16  # the nominal robot drives from (1, 1) to (5, 5) along the diagonal


@cache
def five() -> Problem:
    return load(CONFIG)


def test_every_obstacle_that_is_entered_and_every_part_that_fails_worst_first() -> None:
    found = {c.what: c for c in conflicts(five(), FORWARD)}
    assert set(found) == {"avoid(o1)", "avoid(o3)", "F[14,16] in(goal)"}
    amounts = [c.amount for c in conflicts(five(), FORWARD)]
    assert amounts == sorted(amounts, reverse=True)
    first = found["avoid(o1)"]
    assert first.amount == pytest.approx(0.5, abs=0.01)  # deepest at (2.5, 2.5)
    assert 1 + first.parameters["traction"] * first.time / 4 == pytest.approx(2.5, abs=0.02)
    goal = found["F[14,16] in(goal)"]
    assert goal.parameters["traction"] == 0.9
    assert goal.time == 16.0
    assert goal.amount == pytest.approx(6 - (1 + 0.9 * 4), abs=1e-9)


def test_nothing_fails_where_nothing_is_asked_in_vain() -> None:
    problem = five().with_(obstacles={}, task=parse("G[0,16] x >= 0"))
    assert conflicts(problem, FORWARD) == ()


def test_times_of_a_visit_and_of_avoidance() -> None:
    way = {"way": Polyhedron.box([[2.0, 2.5], [2.2, 2.6]])}
    problem = five().with_(obstacles={}, regions=way, task=parse("F[8,10] in(way)"))
    (visit,) = conflicts(problem, FORWARD)
    assert (visit.parameters["traction"], visit.time) == (1.1, 8.0)  # already past: the start of the window is closest
    assert visit.amount == pytest.approx(1 + 1.1 * 2 - 2.5, abs=1e-9)
    (failed,) = conflicts(problem.with_(task=parse("G[4,6] in(way)")), FORWARD)
    assert (failed.parameters["traction"], failed.time) == (0.9, 4.0)
    assert failed.amount == pytest.approx(2.2 - (1 + 0.9), abs=1e-9)


def test_a_region_that_must_be_avoided_conflicts_too() -> None:
    way = {"way": Polyhedron.box([[2.0, 2.5], [2.2, 2.6]])}
    for task in ("G avoid(way)", "G not in(way)"):
        problem = five().with_(obstacles={}, regions=way, task=parse(task))
        (only,) = conflicts(problem, FORWARD)
        assert "way" in only.what
        assert 0.1 < only.amount < 0.25


def test_only_the_window_of_avoidance_counts() -> None:
    wall = {"wall": (Obstacle.box([[2, 2.5], [2, 2.5]]),)}
    early, late = (five().with_(obstacles=wall, task=parse(f"G[{w}] avoid(wall)")) for w in ("0,3", "4,8"))
    assert conflicts(early, FORWARD) == ()
    assert len(conflicts(late, FORWARD)) == 1


def test_an_obstacle_crossed_between_two_grid_times_conflicts() -> None:
    dash = np.zeros((160, 2))
    dash[0] = 2.0, 0.0
    problem = five().with_(obstacles={"post": (Obstacle.box([[1.04, 1.11], [0.0, 3.0]]),)})
    assert "avoid(post)" in {c.what for c in conflicts(problem, dash)}


def test_a_window_that_starts_at_the_end_of_the_horizon() -> None:
    problem = load_text(
        """
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
        horizon: {duration: 4 s, steps: 20}
        regions: {goal: {box: [[1, 2], [-1, 1]]}}
        task: F[T, T] in(goal)
        """
    )
    (found,) = conflicts(problem, np.zeros((20, 2)))
    assert found.time == 4.0
    assert found.amount == 1.0


PASSED = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s, steps: 20}
obstacles: {post: {box: [[1, 2], [1, 2]]}}
task: G avoid(post)
"""


class Room(OdeSystem):
    """A heater: its place is where it stands, and the temperature is what a task is about."""

    name, states, positions = "room", ("x", "temp"), ("x",)
    controls, control_units, input_bounds = ("speed", "heat"), ("m/s", "K/s"), ((-1.0, 1.0), (0.0, 1.0))
    parameters: Mapping[str, float] = {"loss": 0.0}

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Any:
        """Moved and heated."""
        return [u[0], u[1] - psi["loss"]]


class Kelvin(Room):
    """The same with its units."""

    state_units = ("m", "K")


@pytest.mark.parametrize(
    ("system", "task", "words"),
    [
        (Kelvin(), "F temp >= 9", "9 K"),
        (Room(), "F temp >= 9", "9 in the unit of temp"),
        (Room(), "F x >= 9", "9 m"),
        (Room(), "F in(there)", "9 m"),
        (Kelvin(), "F (in(there) and temp >= -1)", "9 in mixed units (K, m)"),
        (Room(), "F (in(there) and temp >= -1)", "9 in m or the unit of temp"),
        (Kelvin(), "F 3*x + 4*temp >= 45", "9 in mixed units (K, m)"),
    ],
)
def test_what_falls_short_is_said_in_its_unit(system: OdeSystem, task: str, words: str) -> None:
    regions = {"there": Polyhedron([[1.0]], [9.0], [12.0])}
    fleet = Fleet(system, {})
    problem = Problem("room", fleet, 2.0, 4, parse(task), regions)
    (found,) = conflicts(problem, np.zeros((4, 2)))
    assert conflict_text(found).startswith(f"{found.what} by {words} (")
    run = replay(problem, np.zeros((4, 2)))
    shown = dict(measured(run, unit_of_parts(problem, problem.specification.parts)))
    assert shown["robustness"].startswith(f"-9.0000{words.removeprefix('9')} ")


def test_units_of_states_are_one_for_each_or_none() -> None:
    class Odd(Room):
        state_units = ("m",)

    with pytest.raises(ProblemError, match=r"Odd.state_units: expected one entry for each of x, temp, or none, got"):
        Odd().require_complete()


def test_what_is_proven_or_refuted_is_said_in_its_unit() -> None:
    fleet = Fleet(Kelvin(), {})
    cold = Problem("room", fleet, 2.0, 4, parse("G temp >= -9"))
    proof = certify(cold, np.zeros((4, 2)))
    assert proven(cold, proof)[0][1].startswith("for every instant: rest of the task >= ")
    assert re.search(r">= (8\.9999|9\.0000) K \(", proven(cold, proof)[0][1])
    assert certificate_words(cold, proof).bounds[0].endswith(" K to spare.")
    warm = Problem("room", fleet, 2.0, 4, parse("F temp >= 9"))
    proof = certify(warm, np.zeros((4, 2)))
    assert "violates F temp >= 9 by 9 K" in proven(warm, proof)[0][1]
    assert "breaks F temp >= 9 by 9 K" in certificate_words(warm, proof).lead


def test_no_text_claims_more_than_is_proven() -> None:
    """A clearance of 7.3568 mm is no 7.4 mm."""
    problem = load_text(PASSED)
    found = certify(problem, np.tile([0.5, 0.0], (problem.steps, 1)))
    proof = replace(found, clearances=(replace(found.clearances[0], proven=0.0073568),))
    assert "clearance >= 0.0073 m" in proven(problem, proof)[0][1]
    assert "clearance >= 0.0073 m" in repr(proof)
