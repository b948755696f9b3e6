"""Patches of terrain: no robot that an independent integrator drives through them leaves what is proven."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate import terrain as terrain_module
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.remaining import certify_set
from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.ocp.disturbance import growth
from ensemble_ctrl.ocp.terrain import crossed
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.adversary import attack
from ensemble_ctrl.problem.evaluation.disturbed import channels, disturbed, drawn
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.examples import examples

Floats = NDArray[np.float64]

STEPS = 30
CONTROLS = np.column_stack([np.full(STEPS, 0.6), 0.5 * np.cos(np.arange(STEPS) / 5)])


def ground(area: Any, parameters: dict[str, tuple[float, float]]) -> Patch:
    """A patch; its area may be written as a box or a list, too."""
    return Patch(area, parameters)


MUD = Obstacle.polygon(np.array([[0.5, -0.4], [1.1, -0.2], [1.0, 1.0], [0.4, 0.9]]))
ICE = Obstacle.box([[1.3, 1.9], [-0.5, 2.0]])
PATCHES = {
    "slow": {"mud": ground(MUD, {"linear_traction": (0.6, 0.8)})},
    "turning": {"mud": ground(MUD, {"angular_traction": (0.7, 1.2)})},
    "both": {"mud": ground(MUD, {"traction": (0.6, 0.8)})},
    "two": {"mud": ground(MUD, {"traction": (0.7, 0.8)}), "ice": ground(ICE, {"linear_traction": (1.1, 1.4)})},
    "overlapping": {
        "mud": ground(MUD, {"linear_traction": (0.7, 0.8)}),
        "ice": ground([[[0.8, 1.4], [-0.5, 0.8]]], {"linear_traction": (1.1, 1.3)}),
    },
    "one of two pieces": {"mud": ground([MUD, [[1.0, 1.5], [-0.2, 0.6]]], {"linear_traction": (0.5, 0.9)})},
}
FLEETS = {
    "one": {"linear_traction": Interval(0.9, 1.1)},
    "start": {"linear_traction": Interval(0.95, 1.0), "start_y": Interval(-0.2, 0.3)},
    "none": {},
}


def problem(patches: str = "slow", fleet: str = "one", bicycle: bool = False, **changes: object) -> Problem:
    """A robot whose way crosses patches, an obstacle beside it, and a goal."""
    bounds = changes.pop("uncertainty", Uncertainty())
    system = Bicycle() if bicycle else Unicycle()
    movers = Fleet(system, FLEETS[fleet], [0.0, 0.0], 0.0, [-2.0, -1.0], [2.0, 1.0], uncertainty=bounds)  # type: ignore[arg-type]
    whole = Problem(
        name="terrain",
        fleet=movers,
        duration=4.5,
        steps=STEPS,
        task=parse("F[4,4.5] in(goal) and G avoid(post)"),
        regions={"goal": Polyhedron.box([[1.0, 3.0], [-1.0, 2.2]])},
        obstacles={"post": (Obstacle.box([[1.2, 1.5], [1.1, 1.4]]),)},
        terrain=PATCHES[patches],
    )
    return whole.with_(**changes)


Choice = Callable[[str, float, float, float], float]


def driven(whole: Problem, controls: Floats, member: Floats, choose: Choice, sub: int = 4) -> Floats:
    """Positions by an integrator that stops at every border, shape (steps * sub + 1, 2).

    In patches a parameter is ``choose(name, low, high, time)``, constant in each step.
    """
    fleet = whole.fleet
    own = {name: float(value[0]) for name, value in fleet.psi(member[None]).items()}
    shapes = {
        name: shapely.union_all([shapely.Polygon(piece.vertices) for piece in patch.pieces])
        for name, patch in whole.terrain.items()
    }

    def signed(name: str, state: Floats) -> float:
        point = shapely.Point(state[:2])
        away = float(shapes[name].distance(point))
        return away if away > 0 else -float(shapes[name].boundary.distance(point))

    x, y, heading = fleet.coefficients(member[None])[0, [3, 4, 2]]
    state, found = np.array([x, y, heading]), [np.array([x, y])]
    step = whole.duration / len(controls)
    for n, command in enumerate(controls):
        v, omega = fleet.arcs.rates(*command)
        for k in range(sub):
            time, end = (n + k / sub) * step, (n + (k + 1) / sub) * step
            while time < end - 1e-13:
                # where it is a moment later decides on which side of a border it is
                ahead = state + 1e-9 * v * np.array([np.cos(state[2]), np.sin(state[2]), 0.0])
                within = [name for name in shapes if signed(name, ahead) <= 0]
                psi = dict(own)
                for name, value in own.items():
                    given = [whole.terrain[w].parameters for w in within]
                    ends = [value, *(end for each in given if name in each for end in each[name])]
                    psi[name] = choose(name, min(ends), max(ends), n * step) if len(ends) > 1 else value
                a = psi["traction"] * psi["linear_traction"]
                b = psi["traction"] * psi["angular_traction"]

                rates = partial(_rates, speed=a * v, turn=b * omega)
                events = [partial(_border, signed=partial(signed, name), begin=time, ahead=ahead) for name in shapes]
                for event in events:
                    event.terminal = True  # type: ignore[attr-defined]
                finest = step / sub / 3
                run = solve_ivp(rates, (time, end), state, events=events, rtol=1e-10, atol=1e-12, max_step=finest)
                time, state = float(run.t[-1]), run.y[:, -1]
            found.append(state[:2].copy())
    return np.array(found)


def _rates(_: float, state: Floats, speed: float, turn: float) -> list[float]:
    """The unicycle's right-hand side."""
    return [speed * np.cos(state[2]), speed * np.sin(state[2]), turn]


def _border(time: float, state: Floats, signed: Callable[[Floats], float], begin: float, ahead: Floats) -> float:
    """The signed distance from a patch, past the border at which a piece begins."""
    return signed(state if time > begin + 1e-8 else ahead)


def choices(seed: int) -> dict[str, Choice]:
    """Constant at both ends, random in each step, and with a change of sign."""
    return {
        "low": lambda name, low, high, time: low,
        "high": lambda name, low, high, time: high,
        "random": lambda name, low, high, time: float(
            np.random.default_rng([seed, round(time * 1e6)]).uniform(low, high)
        ),
        "bang-bang": lambda name, low, high, time: low if time < 1.5 + 0.3 * seed else high,
    }


@pytest.mark.parametrize("patches", PATCHES)
@pytest.mark.parametrize("fleet", ["one", "start"])
def test_no_robot_of_an_independent_integrator_leaves_the_tube(patches: str, fleet: str) -> None:
    whole = problem(patches, fleet)
    flow = Flow.of(whole, CONTROLS)
    width, largest = np.repeat(flow.error, 2), 0.0
    corners = whole.fleet.corners
    for k, choose in enumerate(choices(1).values()):
        member = corners[k % len(corners)]
        path = driven(whole, CONTROLS, member, choose, 2)
        model = whole.fleet.trajectories(np.repeat(CONTROLS, 2, axis=0), member[None], whole.step / 2)[0]
        off = np.linalg.norm(path - model, axis=1)
        assert (off[1:] <= width + 1e-9).all()
        largest = max(largest, off.max())
    assert 0.1 * width.max() < largest < width.max()


@pytest.mark.parametrize("patches", PATCHES)
@pytest.mark.parametrize("bicycle", [False, True])
def test_the_replay_drives_as_the_integrator(patches: str, bicycle: bool) -> None:
    whole = problem(patches, bicycle=bicycle)
    member = whole.fleet.corners[1]
    steered = CONTROLS * [1.0, 0.4]
    names = [channel.name for channel in channels(whole)]
    for setting, choose in ((-1.0, choices(0)["low"]), (1.0, choices(0)["high"])):
        settings = np.full((1, len(names), STEPS), setting)
        run = disturbed(whole, steered, member[None], settings, 2)[0]
        assert run == pytest.approx(driven(whole, steered, member, choose, 2), abs=2e-6)


ERRORS = {
    "none": Uncertainty(),
    "drift": Uncertainty({"position": 0.01, "heading": 0.02}),
    "commands": Uncertainty(shares={"v": 0.03, "omega": 0.02}, varies={"linear_traction": 0.03}),
    "late": Uncertainty(delay=0.3, jitter=0.05),
    "held": Uncertainty({"heading": 0.1}, jitter=0.05, heading_hold=0.5),
}


@examples(6)
@given(st.sampled_from(sorted(PATCHES)), st.sampled_from(sorted(ERRORS)), st.integers(0, 20), st.floats(-1.5, 1.0))
def test_no_run_of_the_replay_leaves_the_tube(patches: str, errors: str, seed: int, bend: float) -> None:
    whole = problem(patches, uncertainty=ERRORS[errors])
    controls = CONTROLS * [1.0, bend]
    members = whole.fleet.sample(45, seed)
    run = disturbed(whole, controls, members, drawn(whole, 45, STEPS, seed), 4)
    models = whole.fleet.trajectories(np.repeat(controls, 4, axis=0), members, whole.step / 4)
    flow = Flow.of(whole, controls)
    off = np.linalg.norm(run - models, axis=2).max(axis=0)
    assert (off[1:] <= np.repeat(flow.error + flow.lag, 4) + 1e-11).all()


def test_a_strip_across_the_way_costs_what_the_slowest_robot_loses() -> None:
    strip = {"strip": ground([[1.0, 2.0], [-1.0, 1.0]], {"linear_traction": (0.5, 0.9)})}
    whole = problem(fleet="none", terrain=strip, duration=8.0, steps=160, task="G avoid(post)")
    straight = np.column_stack([np.full(160, 0.5), np.zeros(160)])
    error = Flow.of(whole, straight).error
    # 1 m at half the speed: 2 s late at 0.5 m/s; contact is counted in whole steps
    assert 1.0 <= error[-1] <= 1.05
    assert error[38] < 1e-9 < error[39]  # the step that ends on the border, at 2 s
    shifted = whole.with_(terrain={"strip": ground([[1.005, 2.005], [-1.0, 1.0]], {"linear_traction": (0.5, 0.9)})})
    assert driven(shifted, straight, np.zeros(0), choices(0)["low"], 1)[-1, 0] == pytest.approx(3.0, abs=1e-6)
    about = growth(whole, straight)
    assert about is not None
    assert about.within[-1] == pytest.approx(error[-1], rel=0.05)
    assert crossed(whole, straight)["strip"].begin == pytest.approx(2.0, abs=0.11)
    stuck = whole.with_(terrain={"strip": ground([[1.0, 2.0], [-1.0, 1.0]], {"linear_traction": (1e-3, 1.0)})})
    assert Flow.of(stuck, straight).error[-1] == pytest.approx(3.0 * 0.999, rel=0.01)  # perhaps never out again


def test_what_nobody_touches_changes_no_bound() -> None:
    far = {"mud": ground([[0.0, 3.0], [3.5, 4.0]], {"traction": (0.1, 2.0)})}
    with_, without = (certify(problem(terrain=one), CONTROLS) for one in (far, {}))
    assert with_.clearance == pytest.approx(without.clearance, abs=1e-9)
    assert with_.uncertainty == {"terrain": {"mud": far["mud"].data()}}
    assert without.uncertainty == {}
    assert with_.inputs != without.inputs
    other = {"mud": ground([[0.0, 3.0], [3.5, 4.0]], {"traction": (0.1, 2.5)})}
    assert certify(problem(terrain=other), CONTROLS).inputs != with_.inputs


def test_the_border_is_inside() -> None:
    # a way along the border of a patch, at no distance
    beside = {"mud": ground([[0.5, 1.5], [0.0, 1.0]], {"linear_traction": (0.5, 0.9)})}
    straight = np.column_stack([np.full(STEPS, 0.5), np.zeros(STEPS)])
    whole = problem(fleet="none", terrain=beside, task="G avoid(post)")
    assert Flow.of(whole, straight).error[-1] > 0.4
    slow = disturbed(whole, straight, np.zeros((1, 0)), -np.ones((1, 1, STEPS)))[0, -1, 0]
    assert slow < 1.8 < whole.fleet.trajectories(straight, np.zeros((1, 0)), whole.step)[0, -1, 0]


@pytest.mark.parametrize("patches", ["slow", "two"])
def test_no_attack_gets_below_what_is_proven(patches: str) -> None:
    whole = problem(patches)
    proof, found = certify(whole, CONTROLS), attack(whole, CONTROLS)
    run = replay(whole, CONTROLS, members=200, substeps=4)
    assert run.disturbed
    assert found.clearance >= proof.clearance - 1e-9
    assert min(c.distance for c in run.clearances) >= proof.clearance - 1e-9
    assert run.worst[0] >= min(proof.clearance, proof.robustness) - 1e-9


def test_who_touches_a_patch_a_moment_too_late_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    real = terrain_module._gap
    whole, member = problem("slow"), problem("slow").fleet.corners[1]
    path = driven(whole, CONTROLS, member, choices(0)["low"], 1)
    model = whole.fleet.trajectories(CONTROLS, member[None], whole.step)[0]
    off = np.linalg.norm(path - model, axis=1)[1:] - 1e-9
    assert (off <= Flow.of(whole, CONTROLS).error).all()
    monkeypatch.setattr(terrain_module, "_gap", lambda hulls, patch: real(hulls, patch) + 0.3)
    assert not (off <= Flow.of(whole, CONTROLS).error).all()


def test_nothing_is_proven_of_a_set_of_states_on_terrain() -> None:
    far = {"mud": ground([[0.0, 3.0], [3.5, 4.0]], {"traction": (0.1, 2.0)})}
    assert certify_set(problem(terrain={}), CONTROLS, 0.01, 0.01).proven
    found = certify_set(problem(terrain=far), CONTROLS, 0.01, 0.01)
    assert not found.proven
    assert found.clearance == -np.inf
