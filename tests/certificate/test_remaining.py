"""The proof for a set of states, against members of the set that are driven."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.certify import part_bound
from ensemble_ctrl.certificate.remaining import certify_set
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Known, parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples

FLEET = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)}, np.zeros(2), 0.1, np.full(2, -2.0), np.full(2, 2.0), 0.05)
PROBLEM = Problem(
    name="set",
    fleet=FLEET,
    duration=4.0,
    steps=40,
    task=parse("F[3,4] in(goal) and G avoid(obstacles)"),
    regions={"goal": Polyhedron.box([[1.4, 3.0], [-0.6, 1.4]])},
    obstacles={"low": (Obstacle.box([[0.8, 1.2], [-0.8, -0.3]]),), "far": (Obstacle.box([[0.0, 0.3], [0.9, 1.2]]),)},
)
CONTROLS = np.column_stack([np.full(40, 0.55), 0.15 * np.cos(np.arange(40) / 10)])


@examples(12)
@given(st.floats(0, 0.05), st.floats(0, 0.08), st.integers(0, 100), st.booleans())
def test_no_member_of_the_set_is_below_what_is_proven(away: float, turn: float, seed: int, moving: bool) -> None:
    motions = {"low": Motion.steady([0.0, 0.03], 4.0)} if moving else {}
    problem = PROBLEM.with_(motions=motions)
    certificate = certify_set(problem, CONTROLS, away, turn)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        angle, far = rng.uniform(0, 2 * np.pi), away * np.sqrt(rng.choice([1.0, rng.random()]))
        place = far * np.array([np.cos(angle), np.sin(angle)])
        fleet = FLEET.with_(position=place, heading=FLEET.heading + turn * rng.choice([-1.0, 1.0, 0.3]))
        run = replay(problem.with_(fleet=fleet), CONTROLS, members=5, substeps=8)
        assert min(c.distance for c in run.clearances) >= min(certificate.clearance, 1e3) - 1e-9
        assert run.worst[0] >= certificate.least - 1e-9
    if certificate.proven:
        assert certificate.least >= 0


@pytest.mark.parametrize("task", ["G (heading within 0.1 of 0.1)", "G (v >= 0.54)", "G (heading <= 0.2)"])
def test_nothing_is_proven_of_headings_and_speeds(task: str) -> None:
    # the middle pose keeps 0.1 rad, and others of the set are off by 0.12 rad from it
    problem = PROBLEM.with_(task=parse(task), duration=0.01, steps=1)
    certificate = certify_set(problem, CONTROLS[:1], 0.0, 0.12)
    assert (certificate.proven, certificate.robustness) == (False, -np.inf)


def test_nothing_is_proven_of_bodies() -> None:
    fleet = FLEET.with_(footprint=Footprint.rectangle(0.3, 0.1))
    problem = PROBLEM.with_(fleet=fleet, task=parse("F (x >= -9) and G avoid(low)"))
    assert certify_set(PROBLEM, CONTROLS, 0.0, 0.0).clearance > 0
    assert certify_set(problem, CONTROLS, 0.0, 0.0).clearance == -np.inf


def test_cells_of_which_enough_is_proven_are_left_alone() -> None:
    (part,) = PROBLEM.specification.parts
    tight = part_bound(PROBLEM, CONTROLS, FLEET.parameters, part, FLEET, cells=4)
    loose = part_bound(PROBLEM, CONTROLS, FLEET.parameters, part, FLEET, cells=4, enough=0.01)
    assert 0.01 <= loose.proven < tight.proven - 1e-5
    wanted = tight.proven + 1.0  # more than there is: as if nothing were enough
    assert part_bound(PROBLEM, CONTROLS, FLEET.parameters, part, FLEET, cells=4, enough=wanted).proven == tight.proven


def test_a_set_of_one_pose_is_the_fleet() -> None:
    whole, alone = certify(PROBLEM, CONTROLS), certify_set(PROBLEM, CONTROLS, 0.0, 0.0)
    assert whole.proven == "yes"
    assert alone.proven
    assert 2e-3 <= alone.robustness <= whole.robustness + 1e-9
    assert 2e-3 <= alone.clearance <= whole.clearance + 1e-9


def test_what_robots_may_differ_by_more_is_taken_off() -> None:
    plain = certify_set(PROBLEM, CONTROLS, 0.01, 0.01)
    more = certify_set(PROBLEM, CONTROLS, 0.01, 0.01, np.full(40, 0.5))
    assert plain.proven
    assert not more.proven
    assert more.clearance < -0.1
    assert more.worst == "avoid(low)"


@pytest.mark.parametrize("away", [np.nan, np.inf])
@pytest.mark.parametrize("task", ["F[3,4] in(goal)", "G avoid(obstacles)"])
def test_a_set_without_a_size_proves_nothing(away: float, task: str) -> None:
    problem = PROBLEM.with_(task=parse(task))
    assert certify_set(problem, CONTROLS, 0.0, 0.0).proven
    assert not certify_set(problem, CONTROLS, away, 0.0).proven
    assert not certify_set(problem, CONTROLS, 0.0, 0.0, np.full(40, away)).proven


def test_nothing_left_to_do_is_proven() -> None:
    assert certify_set(PROBLEM.with_(task=Known(0.2)), CONTROLS, 0.01, 0.01).proven
    assert not certify_set(PROBLEM.with_(task=Known(-0.2)), CONTROLS, 0.01, 0.01).proven


def test_a_turn_that_leads_into_an_obstacle_is_not_proven() -> None:
    turned = PROBLEM.with_(fleet=FLEET.with_(heading=FLEET.heading - 0.5))
    assert replay(turned, CONTROLS, members=5, substeps=8).violating.any()
    assert certify_set(PROBLEM, CONTROLS, 0.0, 0.0).proven
    assert not certify_set(PROBLEM, CONTROLS, 0.0, 0.5).proven


def test_a_start_that_leads_into_an_obstacle_is_not_proven() -> None:
    moved = PROBLEM.with_(fleet=FLEET.with_(position=np.array([0.0, -0.5])))
    assert replay(moved, CONTROLS, members=5, substeps=8).violating.any()
    assert not certify_set(PROBLEM, CONTROLS, 0.5, 0.0).proven
