"""The compiled task: made once, of the problem that it belongs to, with exact windows."""

from __future__ import annotations

import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Predicate, leaves, parse
from ensemble_ctrl.planning.online.mapped import with_map
from ensemble_ctrl.problem.specification import Specification, TaskPart

FLEET = ec.Fleet(
    ec.Unicycle(), {"traction": ec.Interval(0.9, 1.1)}, np.zeros(2), 0.0, np.full(2, -2.0), np.full(2, 2.0), radius=0.1
)
GOAL = ec.Polyhedron.box([[3, 6], [-1, 1]])
ASIDE = ec.Obstacle.box([[0, 1], [3, 4]])
IN_THE_WAY = ec.Obstacle.box([[1.0, 2.0], [-0.5, 0.5]])
FORWARD = np.tile([1.0, 0.0], (8, 1))


def problem_of(task: str = "G avoid(obstacles) and F[2,T] in(goal)", **changes: object) -> ec.Problem:
    """Four metres straight ahead, an obstacle aside."""
    problem = ec.Problem("p", FLEET, 4.0, 8, parse(task), {"goal": GOAL}, {"post": (ASIDE,)})
    return problem.with_(**changes) if changes else problem


def test_it_is_compiled_once() -> None:
    problem = problem_of()
    assert problem.specification is problem.specification


@pytest.mark.parametrize(
    "changes",
    [
        {"task": parse("G[1,2] avoid(post) and F in(goal)")},
        {"duration": 5.0},
        {"obstacles": {"post": (ASIDE,), "way": (IN_THE_WAY,)}},
        {"regions": {"goal": ec.Polyhedron.box([[2, 6], [-1, 1]])}},
        {"fleet": replace(FLEET, radius=0.2)},
        {"motions": {"post": Motion.steady((0.1, 0.0), 4.0)}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_changed_problem_is_compiled_anew(changes: dict[str, object]) -> None:
    """Also where the change goes past the constructor, which drops what was compiled."""
    problem = problem_of()
    before = problem.specification
    changed = copy(problem)
    for name, value in changes.items():
        object.__setattr__(changed, name, value)
    for other in (replace(problem, **changes), changed):  # type: ignore[arg-type]
        assert other.specification is not before
        assert other.specification.is_of(other)
        assert not before.is_of(other)
    assert problem.specification is before


def test_a_proof_is_of_the_map_that_the_problem_has() -> None:
    problem = problem_of()
    assert certify(problem, FORWARD).proven == "yes"
    assert certify(with_map(problem, {"way": (IN_THE_WAY,)}, {}), FORWARD).proven == "no"


def test_what_is_compiled_survives_a_pickle() -> None:
    problem = problem_of()
    names = [avoid.name for avoid in problem.specification.avoid]
    again = pickle.loads(pickle.dumps(problem))
    assert [avoid.name for avoid in again.specification.avoid] == names == ["post"]
    assert again.specification.is_of(again)


def test_windows_are_resolved_and_leaves_are_predicates() -> None:
    problem = problem_of("G[1,T] avoid(post) and F[2,T] in(goal) and x >= 0")
    specification = problem.specification
    assert [(a.name, a.begin, a.end, a.radius) for a in specification.avoid] == [("post", 1.0, 4.0, 0.1)]
    visit, there = specification.parts
    assert (visit.begin, visit.end, str(visit)) == (2.0, 4.0, "F[2,T] in(goal)")
    assert (there.begin, there.end) == (0.0, 4.0)
    assert {type(leaf) for leaf in leaves(visit.formula)} == {Predicate}
    assert TaskPart.of(problem, parse("F[2,T] in(goal)")).formula == visit.formula


def test_conjuncts_that_others_imply_are_left_out() -> None:
    specification = problem_of("G avoid(post) and G[1,2] avoid(post) and F[2,3] in(goal) and F in(goal)").specification
    assert [(a.begin, a.end) for a in specification.avoid] == [(0.0, 4.0)]
    assert [str(part) for part in specification.parts] == ["F[2,3] in(goal)"]


def test_a_share_of_the_fleet_avoids_and_arrives() -> None:
    specification = problem_of("share(0.9, G avoid(post) and F in(goal)) and F[0,4] x >= 1").specification
    assert specification.avoid == ()
    (chance,) = specification.chance
    assert ([a.name for a in chance.avoid], [str(p) for p in chance.rest]) == (["post"], ["F in(goal)"])
    assert [str(part) for part in specification.rest] == ["F[0,4] x >= 1"]
    assert specification.parts[0] is chance.part
    assert [a.name for a in specification.avoided_by_anyone] == ["post"]
    assert len(problem_of("share(1, F in(goal))").specification.chance) == 1


def test_it_names_what_it_was_compiled_from() -> None:
    problem = problem_of()
    assert Specification.of(problem).sources[0] is problem.task
