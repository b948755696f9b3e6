"""Errors of the model on arcs: no robot that is run within the bounds leaves the tube, and tubes are about as wide."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.certificate import PROOFS, certify
from ensemble_ctrl.certificate.certify import ArcsProof
from ensemble_ctrl.certificate.enclosure import Flow, first_cells
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.adversary import attack
from ensemble_ctrl.problem.evaluation.disturbed import channels, disturbed, drawn
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.examples import examples

Floats = NDArray[np.float64]

STEPS = 40
CONTROLS = np.column_stack([np.full(STEPS, 0.55), 0.6 * np.cos(np.arange(STEPS) / 6)])
CONTROLS[10:14, 0] = -0.3
STEERED = np.column_stack([np.full(STEPS, 0.5), 0.3 * np.cos(np.arange(STEPS) / 6)])
ONE = {"traction": Interval(0.9, 1.1)}
TWO = {"linear_traction": Interval(0.9, 1.1), "angular_traction": Interval(0.95, 1.0), "start_x": Interval(-0.05, 0.05)}
BOUNDS = {
    "drift": Uncertainty({"position": 0.004}),
    "along an axis": Uncertainty({"y": 0.004}),
    "turn": Uncertainty({"heading": 0.01}),
    "large turn": Uncertainty({"heading": 0.5}),
    "held": Uncertainty({"heading": 0.05}, heading_hold=0.6),
    "speed": Uncertainty(actuators={"v": 0.02}),
    "commands": Uncertainty(shares={"v": 0.02}, quantisation={"v": 0.01}),
    "varies": Uncertainty(varies={"traction": 0.02}),
    "delay": Uncertainty(delay=0.25),
    "jitter": Uncertainty(jitter=0.04),
    "all": Uncertainty(
        {"position": 0.002, "heading": 0.01}, {"v": 0.01}, {"v": 0.01}, {"v": 0.01}, {"traction": 0.01}, 0.2, 0.03
    ),
    "all, held": Uncertainty(
        {"x": 0.002, "heading": 0.05}, {"v": 0.01}, {}, {}, {"angular_traction": 0.02}, 0.2, 0.03, 0.4
    ),
}


def fleet(bounds: Uncertainty, bicycle: bool = False, two: bool = False, heading_from: str = "x") -> Fleet:
    """A fleet with errors."""
    system = Bicycle(heading_from=heading_from) if bicycle else Unicycle(heading_from=heading_from)  # type: ignore[arg-type]
    return Fleet(system, TWO if two else ONE, [0.0, 0.0], 0.3, [-2.0, -1.0], [2.0, 1.0], uncertainty=bounds)


def problem(bounds: Uncertainty, **changes: object) -> Problem:
    """A problem with an obstacle beside the way and a goal."""
    return Problem(
        name="errors",
        fleet=fleet(bounds),
        duration=4.0,
        steps=STEPS,
        task=parse("F[3.5,4] in(goal) and G avoid(post)"),
        regions={"goal": Polyhedron.box([[0.4, 3.0], [-0.4, 2.2]])},
        obstacles={"post": (Obstacle.box([[0.75, 1.05], [-0.15, 0.2]]),)},
    ).with_(**changes)


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("kind", ["unicycle", "bicycle", "from y", "three parameters"])
def test_no_run_within_the_bounds_leaves_the_tube(name: str, kind: str) -> None:
    bicycle = kind == "bicycle"
    bounds = BOUNDS[name]
    movers = fleet(bounds, bicycle, kind == "three parameters", "y" if kind == "from y" else "x")
    controls, robots = STEERED if bicycle else CONTROLS, 90
    whole = problem(bounds, fleet=movers)
    members = movers.sample(robots, 0)
    paths = disturbed(whole, controls, members, drawn(whole, robots, STEPS, 1), 4)
    models = movers.trajectories(np.repeat(controls, 4, axis=0), members, whole.step / 4)
    flow = Flow.of(whole, controls)
    off = np.linalg.norm(paths - models, axis=2).max(axis=0)
    width = np.repeat(flow.error + flow.lag, 4)
    assert (off[1:] <= width + 1e-12).all()
    assert off.max() > 0.2 * width.max()  # a tube that is not out of proportion


def test_the_mutual_place_of_a_delayed_robot_is_the_past_one_of_another() -> None:
    whole = problem(BOUNDS["delay"])
    members = whole.fleet.sample(60, 0)
    paths = disturbed(whole, CONTROLS, members, drawn(whole, 60, STEPS, 1), 4)
    for path, member in zip(paths, members, strict=True):
        late = whole.fleet.trajectories(np.repeat(CONTROLS, 64, axis=0), member[None], whole.step / 64)[0]
        apart = np.linalg.norm(path[:, None] - late, axis=2).min(axis=1)
        assert apart.max() < 6e-3  # of one another's samples


def test_a_constant_turn_against_the_integral_of_arbitrary_precision() -> None:
    whole = problem(Uncertainty({"heading": 0.02}), fleet=Fleet(Unicycle(), {}, [0.0, 0.0], 0.0))
    whole = whole.with_(fleet=whole.fleet.with_(uncertainty=Uncertainty({"heading": 0.02})))
    controls = np.column_stack([np.full(STEPS, 0.5), np.full(STEPS, 0.4)])
    mp.mp.dps = 30

    def place(turn: float) -> mp.mpc:
        return mp.quad(lambda t: 0.5 * mp.expj(turn * t), [0, 4])

    true = float(abs(place(mp.mpf("0.42")) - place(mp.mpf("0.4"))))
    width = float(Flow.of(whole, controls).error[-1])
    assert true <= width <= 1.15 * true


def test_an_attack_keeps_to_the_window() -> None:
    whole = problem(BOUNDS["drift"], task="G[3,4] avoid(post)")
    found = attack(whole, CONTROLS)
    assert 3 <= found.time <= 4
    assert found.clearance >= certify(whole, CONTROLS).clearance - 1e-9


@pytest.mark.parametrize("name", ["drift", "turn", "held", "varies", "delay"])
def test_no_attack_gets_below_what_is_proven(name: str) -> None:
    whole = problem(BOUNDS[name])
    proof, found = certify(whole, CONTROLS), attack(whole, CONTROLS)
    model = certify(problem(Uncertainty()), CONTROLS).clearance
    assert found.clearance >= proof.clearance - 1e-9
    assert found.runs > 100
    if name in ("drift", "turn"):  # what it takes away is most of what is proven to be lost at most
        assert model - found.clearance > 0.6 * (model - proof.clearance)


@examples(8)
@given(st.sampled_from(sorted(BOUNDS)), st.floats(0.2, 3.0), st.integers(0, 10), st.booleans())
def test_no_disturbed_member_does_worse_than_is_proven(name: str, scale: float, seed: int, moving: bool) -> None:
    bounds = BOUNDS[name].scaled(min(scale, 1.2) if BOUNDS[name].jitter else scale)
    motions = {"post": Motion.steady([0.05, -0.03], 4.0)} if moving else {}
    whole = problem(bounds, motions=motions)
    proof = certify(whole, CONTROLS)
    run = replay(whole, CONTROLS, members=60, substeps=8, seed=seed)
    assert run.disturbed
    assert min(c.distance for c in run.clearances) >= proof.clearance - 1e-9
    assert run.worst[0] >= min(proof.clearance, proof.robustness) - 1e-9


def test_shares_and_windows_count_the_errors() -> None:
    bounds = Uncertainty({"position": 0.02})
    for task in (
        "share(0.5, G avoid(post))",
        "share(0.5, G[1,2.5] avoid(post))",
        "G[1,2.5] avoid(post)",
        "mean(F[3.5,4] in(goal))",
        "share(0.5, F in(goal))",
    ):
        with_, without = (certify(problem(b, task=task), CONTROLS) for b in (bounds, Uncertainty()))
        least = [min(c.clearance, c.robustness) for c in (with_, without)]
        assert least[0] < least[1] - 0.02, task
        assert with_.uncertainty == {"disturbance": {"position": 0.02}}
        assert with_.inputs != without.inputs


def test_a_delay_takes_nothing_from_what_stands_still_all_the_time() -> None:
    late, prompt = (certify(problem(b), CONTROLS) for b in (BOUNDS["delay"], Uncertainty()))
    assert late.clearance == pytest.approx(prompt.clearance, abs=1e-6)
    assert late.robustness < prompt.robustness - 0.05
    after = round(prompt.clearances[0].time + 0.2, 1)
    window = problem(BOUNDS["delay"], task=f"G[{after},4] avoid(post)")
    assert certify(window, CONTROLS).clearance < certify(window.with_(fleet=fleet(Uncertainty())), CONTROLS).clearance


def test_a_robot_that_follows_its_model_is_what_is_seen() -> None:
    whole = problem(Uncertainty({"position": 0.5}))
    proof = certify(whole, CONTROLS)
    assert proof.proven == "undecided"  # the model itself does the task: no counter-example
    assert proof.counter_example is None
    assert proof.clearances[0].sampled > 0 > proof.clearance


@pytest.mark.parametrize("own", [{"jitter": 0.06}, {"actuators": {"omega": np.inf}}])
def test_what_has_no_bound_is_refused(own: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"jitter|omega"):
        problem(Uncertainty(**own))  # type: ignore[arg-type]


def test_steering_beyond_a_right_angle_proves_nothing() -> None:
    steep = Fleet(
        Bicycle(), ONE, [0.0, 0.0], 0.3, [-2.0, -1.5], [2.0, 1.5], uncertainty=Uncertainty(actuators={"delta": 0.2})
    )
    with pytest.raises(ValueError, match="expected delta with its error within"):
        problem(Uncertainty(), fleet=steep)
    narrow = problem(Uncertainty(), fleet=steep.with_(input_upper=[2.0, 1.0], input_lower=[-2.0, -1.0]))
    beyond = np.add(STEERED, [0.0, 1.2])
    assert certify(narrow, STEERED).clearance > -np.inf
    assert certify(narrow, beyond).proven != "yes"
    assert certify(narrow, beyond).clearance == -np.inf


def test_channels_are_those_with_a_bound() -> None:
    assert [c.kind for c in channels(problem(BOUNDS["all"]))] == [
        "disturbance", "position", "position", "command", "varies", "delay", "jitter",
    ]  # fmt: skip
    assert channels(problem(Uncertainty(heading_hold=1.0))) == ()


def test_an_enclosure_that_does_not_count_errors_proves_nothing_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    class Careless(ArcsProof):
        counts_errors = False

    monkeypatch.setitem(PROOFS, "arcs", Careless)
    assert certify(problem(Uncertainty()), CONTROLS).proven == "yes"
    refused = certify(problem(Uncertainty({"position": 1e-6})), CONTROLS)
    assert (refused.proven, refused.reason) == ("undecided", "this enclosure does not count errors of the model")


@pytest.mark.parametrize("two", [False, True])
def test_members_of_each_cell_stay_within_the_bound_of_their_cell(two: bool) -> None:
    given = problem(Uncertainty({"heading": 0.01}), fleet=fleet(Uncertainty({"heading": 0.01}), two=two))
    flow = Flow.of(given, CONTROLS)
    assert flow.errors is not None
    assert (flow.errors <= flow.error).all()
    bent = flow.bent()
    centres, half = first_cells(bent.lower, bent.upper, bent.grid)
    assert len(flow.errors) == len(centres)
    assert flow.errors[:, -1].min() < 0.95 * flow.errors[:, -1].max()
    rng, rest = np.random.default_rng(4), given.fleet.center[bent.directions.shape[0] :]
    ratios = []
    for centre, width, bound in zip(centres, half, flow.errors, strict=True):
        members = np.array([[*(centre + sign * width), *rest] for sign in rng.choice([-1.0, 1.0], (4, len(centre)))])
        settings = np.repeat(np.array([1.0, -1.0, 1.0, -1.0])[:, None, None], STEPS, axis=2)
        settings = settings * np.where(np.arange(STEPS) < rng.integers(0, STEPS), -1.0, 1.0)
        settings[:2] = np.array([[[1.0]], [[-1.0]]])
        states = disturbed(given, CONTROLS, members, settings, 4)[..., :2]
        model = disturbed(given, CONTROLS, members, 0 * settings, 4)[..., :2]
        away = np.linalg.norm(states - model, axis=-1)
        assert (away[:, 1:].reshape(4, STEPS, 4).max(axis=(0, 2)) <= bound).all()
        ratios.append(away[:, -1].max() / bound[-1])
    assert 0.5 < max(ratios) <= 1.0
