"""Zones: speed limits and areas to keep out of, against geometry by shapely, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.files.config import dump, to_data
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.remaining import of_one_robot
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay, trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.plain import problem_of, proven_part
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.systems import DoubleIntegrator, Unicycle
from tests.paths import ROOT

Floats = NDArray[np.float64]

FILE = ROOT / "configs" / "vehicles" / "slow_zone.yaml"
BOX = Obstacle.box([[2.0, 3.0], [-1.0, 1.0]])
AREA = shapely.box(2.0, -1.0, 3.0, 1.0)
STEPS, STEP, RADIUS, LIMIT = 40, 0.25, 0.2, 0.3


def problem(zone: Zone | None = None, task: str = "F x >= 0.5", **fleet: Any) -> Problem:
    """Robots that drive through a zone."""
    given: dict[str, Any] = {"radius": RADIUS} | fleet
    who = Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)}, [0.0, 0.0], 0.0, [-1.0, -1.0], [1.0, 1.0], **given)
    zones = {"slow": Zone((BOX,), LIMIT) if zone is None else zone}
    return Problem(name="z", fleet=who, duration=STEPS * STEP, steps=STEPS, task=parse(task), zones=zones)


def straight(speeds: Floats) -> Floats:
    """Commands without a turn."""
    return np.column_stack([speeds, np.zeros(len(speeds))])


def speeding(one: Problem, controls: Floats, members: Floats, looks: int = 20) -> Floats:
    """Largest excess of each member's speed over the limit while its body touches the area, by shapely."""
    paths = trajectories(one, controls, members, looks)
    body = AREA.buffer(RADIUS, quad_segs=256)
    inside = shapely.covers(body, shapely.points(paths))
    speed = np.abs(members[:, :1] * np.repeat(controls[:, 0], looks))
    # a sample counts for the pieces of time before and after it
    during = inside[:, :-1] | inside[:, 1:]
    return np.asarray(np.where(during, speed - LIMIT, -np.inf).max(axis=1))


@pytest.mark.parametrize("early", [-4, -1, 0, 1, 3])
def test_a_plan_is_proven_where_no_member_is_too_fast_and_refuted_where_one_is(early: int) -> None:
    one = problem()
    # the fastest member's body touches at x = 1.8 after 8.18 steps of 0.8 m/s; slow from `early` steps before step 8 on
    speeds = np.where(np.arange(STEPS) < 8 - early, 0.8, LIMIT / 1.1)
    controls = straight(speeds)
    fastest = speeding(one, controls, np.linspace(0.9, 1.1, 81)[:, None]).max()
    verdict = certify(one, controls)
    (rule,) = [part for part in verdict.parts if "avoid(slow)" in part.part]
    assert (fastest <= 1e-12) == (rule.proven >= -1e-12 and early >= 0)
    if fastest > 1e-9:
        assert rule.sampled < 0
        assert verdict.proven == "no"
    run = replay(one, controls, members=200, substeps=20)
    assert (run.robustness < -1e-9).any() == (fastest > 1e-9)


def test_random_speeds_are_never_proven_where_shapely_finds_one_too_fast() -> None:
    random, one, proven, refuted = np.random.default_rng(5), problem(task="F x >= -9"), 0, 0
    members = np.linspace(0.9, 1.1, 41)[:, None]
    for _ in range(30):
        turn = random.uniform(-0.4, 0.4)
        speeds = np.where(random.random(STEPS) < 0.3, random.uniform(0.3, 1.0, STEPS), random.uniform(0.2, 0.29, STEPS))
        slow = random.integers(5, 20)
        speeds[slow:] = np.minimum(speeds[slow:], random.uniform(0.2, 0.3))
        controls = np.column_stack([speeds, np.where(np.arange(STEPS) < 4, turn, 0.0)])
        worst = speeding(one, controls, members).max()
        verdict = certify(one, controls).proven
        proven += verdict == "yes"
        refuted += verdict == "no"
        assert not (verdict == "yes" and worst > 0)
        assert not (verdict == "no" and worst < -0.02)
    assert proven >= 3
    assert refuted >= 3


def test_errors_of_the_speed_count() -> None:
    # 0.26 times 1.1 is 0.286: 14 mm/s are left
    controls = straight(np.full(STEPS, 0.26))
    assert certify(problem(task="F x >= 1"), controls).proven == "yes"
    for error, verdict in ((0.012, "yes"), (0.013, "undecided")):
        bounds = Uncertainty(actuators={"v": error})
        assert certify(problem(task="F x >= 1", uncertainty=bounds), controls).proven == verdict


def test_a_zone_to_keep_out_of_is_kept_out_of() -> None:
    one = problem(Zone((BOX,)), "F x >= 1")
    verdict = certify(one, straight(np.full(STEPS, 0.16)))  # the fastest ends at 1.76, 4 cm before it with its body
    assert verdict.clearance == pytest.approx(0.04, abs=1e-6)
    assert [bound.obstacle for bound in verdict.clearances] == ["slow"]
    assert certify(one, straight(np.full(STEPS, 0.17))).proven == "no"


def test_a_proof_is_bound_to_the_zones_and_the_checker_reads_them() -> None:
    one, controls = problem(), straight(np.full(STEPS, 0.2))
    others = [Zone((BOX,), 0.31), Zone((BOX,)), Zone((Obstacle.box([[2.0, 3.0], [-1.0, 1.1]]),), LIMIT)]
    prints = {fingerprint(p, controls, p.fleet.parameters) for p in (one, *map(problem, others), one.with_(zones={}))}
    assert len(prints) == 5
    for each in (one, problem(Zone((BOX, Obstacle.polygon([[4.0, 0.0], [5.0, 0.0], [4.0, 1.0]]))))):
        part = proven_part(to_data(each)) | {"horizon": {"duration": each.duration, "steps": each.steps}}
        read = problem_of(json.loads(to_json(part)))
        assert fingerprint(read, controls, read.fleet.parameters) == fingerprint(each, controls, each.fleet.parameters)
        again = ec.load_text(dump(each), "again")
        assert fingerprint(again, controls, again.fleet.parameters) == fingerprint(
            each, controls, each.fleet.parameters
        )


def test_the_program_plans_through_a_zone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "zone"
    assert invoke([str(FILE), "-o", str(folder), "--no-plots", "-q"]) == 0
    plan = ec.Plan.load(folder)
    assert plan.certify().proven == "yes"
    area = shapely.box(1.8, -0.7, 3.2, 0.9).buffer(0.2, quad_segs=256)
    members = np.linspace(0.95, 1.05, 11)[:, None]
    paths = trajectories(plan.problem, plan.controls, members, 10)
    inside = shapely.covers(area, shapely.points(paths))
    speed = np.abs(members * np.repeat(plan.controls[:, 0], 10))
    assert inside.any(axis=1).all()
    assert speed[inside[:, :-1] | inside[:, 1:]].max() <= 0.3
    assert speed.max() > 0.6  # and elsewhere it drives faster
    assert "zones      slow: |v| <= 0.3 m/s; loading: keep out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("v: 0.3 m/s}", "v: 0.3 m}", ":21:45: error: zones.slow.v: expected a speed in m/s, cm/s or km/h"),
        ("v: 0.3 m/s}", "v: -1}", "zones.slow.v: expected a limit above 0 m/s, got -1"),
        (", v: 0.3 m/s}", "}", ":21:9: error: zones.slow: expected one of v and keep_out: true, got neither"),
        ("v: 0.3 m/s}", "v: 1, keep_out: true}", "zones.slow: expected one of v and keep_out: true, got both"),
        ("  slow:", "  goal:", ":21:3: error: zones.goal: expected a name of its own, got that of a region"),
        ("[[1, 1.6], [4", "[[-1, -0.6], [4", "inside zone 'loading', which robots keep out of"),
        ("model: unicycle", "model: double_integrator", "speed limits of zones are not for the double_integrator"),
    ],
)
def test_what_is_wrong_is_said_at_its_place(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = FILE.read_text().replace(old, new, 1)
    if "double_integrator" in new:
        text = text.replace(", heading: 0 deg", "").replace("traction: {range: [0.95", "mass: {range: [0.95")
        text = text.replace("  input_bounds: {v: [-1, 1], omega: [-1, 1]}\n", "")
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    assert invoke(["check", str(file)]) == 2
    assert message in capsys.readouterr().err


def test_what_no_proof_knows_is_refused() -> None:
    with pytest.raises(ProblemError, match="a speed limit can't be promised of robots whose"):
        problem(uncertainty=Uncertainty(delay=0.1))
    with pytest.raises(ProblemError, match="the moment form does not have the speed limit of slow"):
        problem().with_(solve=ec.SolveOptions(guarantee="moment"))
    with pytest.raises(UnsupportedError, match="zones are not for a loop"):
        of_one_robot(problem())
    slow = problem()
    with pytest.raises(ProblemError, match="robots start in it and drive at least"):
        slow.with_(fleet=slow.fleet.with_(position=[2.5, 0.0], input_lower=[0.5, -1.0]))
    with pytest.raises(ProblemError, match="expected a limit above 0 m/s, got -1"):
        Zone((BOX,), -1.0)
    with pytest.raises(ProblemError, match="expected one or more Obstacles"):
        Zone(())
    fleet = Fleet(DoubleIntegrator(), {"mass": Interval(0.9, 1.1)})
    solid = ec.Solid.box([[2, 3], [0, 1], [0, 1]])
    with pytest.raises(ProblemError, match="expected 2 dimensions"):
        Problem(name="z", fleet=fleet, duration=1.0, steps=4, task=parse("F x >= 0"), zones={"a": Zone((solid,))})


def test_a_limit_beside_a_footprint_is_one_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(FILE.read_text().replace("  radius:", "  footprint: {length: 0.6 m, width: 0.3 m}  # radius:", 1))
    assert "footprint" in file.read_text()
    assert invoke(["check", str(file)]) == 2
    told = capsys.readouterr().err
    assert "speed limits of zones are not for fleets with a footprint" in told
    assert "1 error in " in told
