"""Members of different starts keep apart: the proof against pairs of members by hand, replay, planning and messages."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.__main__ import main as prove_again
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.constraints.stl import Apart, parse
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.planning.planner.one_frame import in_one_frame
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.systems import Mecanum
from tests.paths import ROOT

Floats = NDArray[np.float64]

ARCS = """\
fleet:
  model: unicycle
  parameters: {linear_traction: {range: [0.95, 1.05]}, angular_traction: {range: [0.97, 1.03]}}
  start: {position: [1, 0], heading: 30 deg}
  starts: {ann: [0, 0], bob: [-0.9, 0], cid: [0, 0.8]}
horizon: {duration: 4 s, steps: 16}
regions: {all: {box: [[-50, 50], [-50, 50]]}}
task: "G apart(0.3 m) and G in(all)"
verify: {members: 60}
"""
STATES = """\
fleet:
  model: double_integrator
  parameters: {mass: {range: [0.8, 1.25]}, start_x: {range: [-0.05, 0.05]}}
  start: {position: [0, 0]}
  starts: {ann: [0, 0], bob: [-0.9, 0.1]}
horizon: {duration: 3 s, steps: 9}
regions: {all: {box: [[-50, 50], [-50, 50]]}}
task: "G apart(0.3 m) and G in(all)"
verify: {members: 60}
"""
OFFSETS = {"ann": (0.0, 0.0), "bob": (-0.9, 0.0), "cid": (0.0, 0.8)}


def drive(seed: int) -> Floats:
    """Commands of a drive forwards, with turns."""
    generator = np.random.default_rng(seed)
    return np.column_stack([generator.uniform(0.4, 1.0, 16), generator.uniform(-0.8, 0.8, 16)])


def on_arcs(controls: Floats, psi: Floats, time: float) -> Floats:
    """Where a unicycle that starts at the origin at 30 degrees is, by its arcs."""
    place, heading, step = np.zeros(2), np.pi / 6, 0.25
    for n, (v, omega) in enumerate(controls):
        dt = float(np.clip(time - n * step, 0.0, step))
        v, omega = psi[0] * v, psi[1] * omega
        turn = omega * dt
        chord = v * dt * np.sinc(turn / 2 / np.pi)
        place = place + chord * np.array([np.cos(heading + turn / 2), np.sin(heading + turn / 2)])
        heading += turn
    return place


def pushed(controls: Floats, psi: Floats, time: float) -> Floats:
    """Where a point mass that starts at rest at (start_x, 0) is, by parabolas."""
    place, speed, step = np.array([psi[1], 0.0]), np.zeros(2), 1 / 3
    for n, force in enumerate(controls):
        dt = float(np.clip(time - n * step, 0.0, step))
        place = place + speed * dt + force / psi[0] * dt**2 / 2
        speed = speed + force / psi[0] * dt
    return place


def closest(where, controls: Floats, offset: Floats, box: Floats, duration: float) -> float:  # type: ignore[no-untyped-def]
    """The least distance of two members, by many samples and a search from the nearest of them."""

    def away(x: Floats) -> float:
        return float(np.linalg.norm(offset + where(controls, x[:2], x[4]) - where(controls, x[2:4], x[4])))

    low, high = np.concatenate([box, box, [[0.0, duration]]]).T
    generator = np.random.default_rng(0)
    ends = generator.integers(0, 2, (400, 5)).astype(float)
    ends[:, 4] = generator.random(400)
    tried = low + (high - low) * np.concatenate([ends, generator.random((200, 5))])
    values = np.array([away(x) for x in tried])
    best = [tried[k] for k in np.argsort(values)[:3]]
    bounds = list(zip(low, high, strict=True))
    return min(float(minimize(away, x, bounds=bounds, method="L-BFGS-B").fun) for x in best)


@pytest.mark.parametrize("seed", range(3))
def test_no_pair_on_arcs_is_closer_than_proven(seed: int) -> None:
    controls = drive(seed)
    certificate = certify(ec.load_text(ARCS), controls)
    box = np.array([[0.95, 1.05], [0.97, 1.03]])
    for bound, (one, other) in zip(certificate.clearances, combinations(OFFSETS, 2), strict=True):
        assert bound.obstacle == f"apart(0.3 m) of {one} and {other}"
        true = closest(on_arcs, controls, np.subtract(OFFSETS[one], OFFSETS[other]), box, 4.0) - 0.3
        assert bound.proven <= true <= bound.sampled + 0.05
        assert bound.proven >= true - 0.06


@pytest.mark.parametrize("seed", range(2))
def test_no_pair_of_states_is_closer_than_proven(seed: int) -> None:
    controls = np.random.default_rng(seed).uniform([-0.2, -0.3], [0.6, 0.3], (9, 2))
    certificate = certify(ec.load_text(STATES), controls)
    (bound,) = certificate.clearances
    box = np.array([[0.8, 1.25], [-0.05, 0.05]])
    true = closest(pushed, controls, np.array([0.9, -0.1]), box, 3.0) - 0.3
    assert bound.proven <= true <= bound.sampled + 0.05
    assert bound.proven >= true - 0.06


def test_members_of_equal_parameters_keep_their_offsets() -> None:
    text = ARCS.replace("[0.95, 1.05]", "[1, 1]").replace("[0.97, 1.03]", "[1, 1]")
    for bound, away in zip(certify(ec.load_text(text), drive(7)).clearances, (0.9, 0.8, 1.45**0.5), strict=True):
        assert bound.proven <= away - 0.3 <= bound.sampled
        assert bound.proven == pytest.approx(away - 0.3, abs=5e-3)


def test_pairs_that_come_too_close_refute_a_plan_within_the_window_only() -> None:
    straight = np.tile([1.0, 0.0], (16, 1))  # in 4 s, members of ann and bob come 0.4 m closer
    far, near = "G apart(0.6 m)", "G[0, 1] apart(0.6 m)"
    certificate = certify(ec.load_text(ARCS.replace("G apart(0.3 m)", far)), straight)
    assert certificate.proven == "no"
    found = certificate.counter_example
    assert found is not None
    assert found.what == "apart(0.6 m) of ann and bob"
    assert found.time is not None
    psi = [[found.parameters[f"{kind}_traction of {who}"] for kind in ("linear", "angular")] for who in ("ann", "bob")]
    away = on_arcs(straight, np.array(psi[0]), found.time) - on_arcs(straight, np.array(psi[1]), found.time)
    distance = float(np.linalg.norm(away + np.array([0.9, 0.0])))
    assert 0.6 - distance >= found.amount - 1e-9 > 0
    assert certify(ec.load_text(ARCS.replace("G apart(0.3 m)", near)), straight).proven == "yes"
    late = ec.load_text(ARCS.replace("G apart(0.3 m)", "G[4, 4] apart(0.6 m)"))
    assert certify(late, straight).proven == "no"


def test_a_replay_compares_pairs_of_members() -> None:
    straight = np.tile([1.0, 0.0], (16, 1))
    problem = ec.load_text(ARCS.replace("apart(0.3 m)", "apart(0.6 m)"))
    run = ec.replay(problem, straight)
    named = {c.obstacle: c for c in run.clearances}
    # 0.9 m less 10 % of 4 m; the corners of the ranges are among the members
    assert named["apart(0.6 m) of ann and bob"].distance == pytest.approx(np.hypot(0.9 - 0.4 * 0.75**0.5, 0.2) - 0.6)
    assert named["apart(0.6 m) of ann and bob"].time == 4.0
    assert run.worst[0] == min(c.distance for c in run.clearances)
    assert {start for start, bad in zip(run.starts, run.violating, strict=True) if bad} >= {"ann", "bob"}
    assert any(
        "apart(0.6 m) of ann and bob" in one.what for one in ec.Plan(problem, straight, "planned", {}).conflicts()
    )


def test_a_plan_keeps_apart_who_would_meet_without_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "configs/vehicles/three_apart.yaml").read_text(encoding="utf-8")
    text = text.replace("steps: 45", "steps: 30").replace("members: 3000", "members: 300")
    problem = ec.load_text(text)
    blind = ec.plan(ec.load_text(text.replace(" and G apart(0.5 m)", "")))
    assert blind.certificate is not None
    assert blind.certificate.proven == "yes"
    assert certify(problem, blind.controls).proven == "no"
    (tmp_path / "apart.yaml").write_text(text, encoding="utf-8")
    folder = tmp_path / "plan"
    assert invoke([str(tmp_path / "apart.yaml"), "-o", str(folder), "--quiet"]) == 0
    assert " of ann and " in capsys.readouterr().out
    assert prove_again([str(folder)]) == 0
    plan = ec.Plan.load(folder)
    assert ec.replay(problem, plan.controls, members=600, substeps=4).satisfied == 1.0


def test_states_are_planned_apart() -> None:
    text = STATES.replace("{all:", "{goal: {box: [[1.2, 4], [-0.5, 0.8]]}, all:").replace(
        "G in(all)", "G[2.8, 3] in(goal) and G[2.8, 3] apart(0.5 m) and G in(all)"
    )
    plan = ec.plan(ec.load_text(text.replace("[0.8, 1.25]", "[0.95, 1.05]")))
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0


def test_starts_whose_enclosures_cut_time_differently() -> None:
    # relative to its coordinates, the polynomial of who starts further away is good enough on longer pieces
    text = """\
fleet:
  model: mecanum
  parameters: {vx_factor: {range: [0.97, 1.03]}}
  start: {position: [0, 0]}
  starts: {far: [30, 30], near: [0, 0]}
  input_bounds: {vx: [-5, 5], vy: [-5, 5], omega: [-3, 3]}
horizon: {duration: 10 s, steps: 4}
regions: {all: {box: [[-99, 99], [-99, 99]]}}
task: "G apart(42 m) and G in(all)"
verify: {members: 60}
"""
    problem = ec.load_text(text)
    controls = np.array([[2.0, 0.0, 1.0], [2.0, 0.0, -1.0], [3.0, 3.0, 0.0], [3.0, 3.0, 0.0]])
    parts = [GeneralProof(one, controls, one.fleet.parameters).enclosure.parts for one in by_start(problem).values()]
    assert parts == [1, 2]
    # far and slow against near and fast: at the end they are at most this far from each other
    system = Mecanum()

    def end(factor: float) -> Floats:
        x, psi = [0.0, 0.0, 0.0], {"vx_factor": factor, "vy_factor": 1.0, "omega_factor": 1.0}
        for command in controls:
            x = list(system.exact(x, command, psi, 2.5))
        return np.array(x[:2])

    least = float(np.linalg.norm(end(0.97) + 30.0 - end(1.03)))
    assert least < 41.8
    certificate = certify(problem, controls)
    assert certificate.proven == "no"
    assert certificate.clearances[-1].proven <= least - 42.0
    near = ec.load_text(text.replace("42 m", f"{least - 0.5} m"))
    bound = certify(near, controls).clearances[-1]
    assert 0 <= bound.proven <= 0.5


def test_nothing_is_proven_of_the_common_frame() -> None:
    base = in_one_frame(ec.load_text(ARCS))
    assert len(base.pairs) == 3
    certificate = certify(base, np.zeros((16, 2)))
    assert certificate.proven == "undecided"
    assert "several starts in one frame" in certificate.reason


def test_its_text() -> None:
    task = parse("G[1, 2] apart(50 cm) and in(goal)")
    assert str(task) == "G[1,2] apart(0.5 m) and in(goal)"
    assert parse(str(task)) == task
    assert str(parse("G apart(2)")) == "G apart(2 m)"
    with pytest.raises(ProblemError, match=r"apart\(\.\.\.\): expected a distance above 0 m, got -1 m"):
        Apart(-1.0)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("G apart(1 m) and G in(all)", r":5:30: error: fleet.starts.bob: this is 0.9 m from ann at the start"),
        ("G apart(0.3 m)", "expected more than apart"),
        ("F apart(0.3 m) and G in(all)", r":8:16: error: task: apart\(0.3 m\) within another part"),
        ("G (apart(0.3 m) or in(all))", r"task: apart\(0.3 m\) within another part of the task is not supported"),
        ("G apart(all) and G in(all)", "expected a distance, got 'all'"),
        ("G apart(0) and G in(all)", "expected a distance above 0 m, got 0"),
        ("G apart(3 s) and G in(all)", r"expected '\)', or a unit \(m, cm, mm\), got 's'"),
    ],
)
def test_what_is_wrong_is_said_at_its_place(task: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ec.load_text(ARCS.replace("G apart(0.3 m) and G in(all)", task))


def test_where_it_is_not_supported() -> None:
    alone = ARCS.replace("  starts: {ann: [0, 0], bob: [-0.9, 0], cid: [0, 0.8]}\n", "")
    with pytest.raises(ConfigError, match=r"is about members of different starts, and all start at one place"):
        ec.load_text(alone)
    shaken = ARCS.replace("  start:", "  uncertainty: {disturbance: {x: 1 mm/s}}\n  start:")
    with pytest.raises(ConfigError, match=r"not supported for robots with errors of the model"):
        ec.load_text(shaken)
