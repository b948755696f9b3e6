"""Headings, speeds, turn rates and steering angles in tasks: proofs against SciPy, sampled errors and whole turns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.constraints.stl import StateSignals, member_robustness, parse
from ensemble_ctrl.constraints.stl.operations import ExactOps
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.disturbed import channels, disturbed, drawn
from ensemble_ctrl.problem.evaluation.sampled import replay, states
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.signals import columns, with_signals
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.systems import Bicycle, Unicycle
from tests.examples import examples

Floats = NDArray[np.float64]

STEPS, STEP = 8, 0.5
CONTROLS = np.column_stack([0.5 + 0.2 * np.cos(np.arange(STEPS)), 0.5 * np.sin(1.0 + np.arange(STEPS))])
RANGES = {
    "linear_traction": Interval(0.9, 1.1),
    "angular_traction": Interval(0.8, 1.2),
    "start_heading": Interval(-0.1, 0.1),
}


def problem(task: str, system: Any = None, bounds: Uncertainty | None = None) -> Problem:
    """A fleet that nothing stands in the way of."""
    system = Bicycle() if system is None else system
    fleet = Fleet(system, RANGES, [0.0, 0.0], 0.3, [-2.0, -1.4], [2.0, 1.4], uncertainty=bounds)
    return Problem(name="signals", fleet=fleet, duration=STEPS * STEP, steps=STEPS, task=parse(task))


def integrated(system: Any, member: Floats, times: Floats) -> dict[str, Floats]:
    """Signals of one member by SciPy from its equations, at times inside of steps."""
    a, b, g = member
    found: dict[str, list[Floats]] = {name: [] for name in ("heading", "v", "omega", "delta")}
    x = np.array([0.0, 0.0, 0.3 + g])
    for n, (v, second) in enumerate(CONTROLS):
        omega = v * np.tan(second) / system.wheelbase if system.name == "bicycle" else second
        omega = omega if system.heading_from == "x" else -omega

        def rates(_: float, at: Floats, v: float = v, omega: float = omega) -> list[float]:
            return [a * v * np.cos(at[2]), a * v * np.sin(at[2]), b * omega]

        here = times[(times >= n * STEP) & (times < (n + 1) * STEP)]
        run = solve_ivp(rates, (0.0, STEP), x, t_eval=np.append(here - n * STEP, STEP), rtol=1e-11, atol=1e-12)
        found["heading"].append(run.y[2, :-1])
        for name, value in (("v", a * v), ("omega", b * omega), ("delta", second)):
            found[name].append(np.full(len(here), value))
        x = run.y[:, -1]
    return {name: np.concatenate(parts) for name, parts in found.items()}


@pytest.mark.parametrize("system", [Bicycle(), Unicycle(), Unicycle(heading_from="y"), Bicycle(heading_from="y")])
@pytest.mark.parametrize("signal", ["heading", "v", "omega", "2*heading - v", "delta"])
def test_a_bound_is_the_least_of_all_members_by_scipy(system: Any, signal: str) -> None:
    if signal == "delta" and system.name == "unicycle":
        return
    begin, end = 0.75, 3.25
    plan = certify(problem(f"G[{begin},{end}] {signal} >= -20", system), CONTROLS)
    (part,) = plan.parts
    assert plan.proven == "yes"
    times = np.linspace(begin, end, 41)[1:-1]
    least = np.inf
    for signs in np.ndindex(2, 2, 2):
        member = np.array([r.upper if s else r.lower for r, s in zip(RANGES.values(), signs, strict=True)])
        seen = integrated(system, member, times)
        value = 2 * seen["heading"] - seen["v"] if signal == "2*heading - v" else seen[signal.split()[0]]
        least = min(least, float(np.min((value + 20) / (np.sqrt(5) if " " in signal else 1))))
    # corners attain the bound, but for headings near the ends of the window, which are not among the times
    assert least - 0.15 <= part.proven <= least + 1e-9
    # upper bounds count the commands of either step where two meet
    assert " " in signal or part.sampled - part.proven < 1e-6


def test_an_instant_between_steps_is_proven_for_the_commands_of_both() -> None:
    at = 2 * STEP  # v falls from step 1 to 2
    slow = min(CONTROLS[1, 0], CONTROLS[2, 0]) * 0.9
    (part,) = certify(problem(f"G[{at},{at}] v >= 0"), CONTROLS).parts
    assert part.proven == pytest.approx(slow, abs=1e-9)
    # one that only one of both does is neither proven nor refuted
    between = (CONTROLS[1, 0] + CONTROLS[2, 0]) / 2
    narrow = {name: Interval(1.0, 1.0) for name in ("linear_traction", "angular_traction")}
    alone = problem(f"G[{at},{at}] v >= {between}")
    alone = alone.with_(fleet=alone.fleet.with_(parameters=narrow))
    assert certify(alone, CONTROLS).proven == "undecided"


@given(st.floats(-179, 180), st.floats(5, 170), st.integers(0, 3))
@examples(25)
def test_whole_turns_make_no_difference(centre: float, half: float, seed: int) -> None:
    controls = np.random.default_rng(seed).uniform(-1.4, 1.4, (STEPS, 2)) * [0.0, 1.0] + [0.4, 0.3]
    one = problem(f"G heading within {half:.3f} deg of {centre:.3f} deg", Unicycle())
    members = one.fleet.corners
    read = with_signals(one, states(one, controls, members), controls, members, one.step)
    values = member_robustness(
        one.specification.parts[0].formula, StateSignals(read, columns(one), one.step), ExactOps()
    )
    heading = read[..., 2]
    off = np.abs(np.angle(np.exp(1j * (heading - np.radians(round(centre, 3))))))
    assert values[:, 0] == pytest.approx((np.radians(round(half, 3)) - off).min(axis=1), abs=1e-9)
    (part,) = certify(one, controls).parts
    assert part.proven <= values.min() + 1e-9
    # the negation is proven of no member that is within
    (other,) = certify(
        one.with_(task=parse(f"F not heading within {half:.3f} deg of {centre:.3f} deg")), controls
    ).parts
    assert other.proven <= -values.min() + 1e-9


BOUNDS = {
    "turn": Uncertainty({"heading": 0.02}),
    "held": Uncertainty({"heading": 0.05}, heading_hold=0.6),
    "commands": Uncertainty(actuators={"v": 0.02, "delta": 0.01}, shares={"v": 0.02}),
    "varies": Uncertainty(varies={"linear_traction": 0.02, "angular_traction": 0.03}),
    "delay": Uncertainty({"heading": 0.02}, delay=0.25),
    "jitter": Uncertainty(jitter=0.1),
}


@pytest.mark.parametrize("heading_from", ["x", "y"])
@pytest.mark.parametrize("name", BOUNDS)
def test_no_robot_within_the_bounds_of_its_errors_breaks_a_proof(name: str, heading_from: Any) -> None:
    bounds, system = BOUNDS[name], Bicycle(heading_from=heading_from)
    signals = ["heading", "v", "omega", "delta"]
    if bounds.delay or bounds.jitter:
        signals = ["heading"]
    if bounds.heading_hold:
        signals = ["heading", "v", "delta"]
    for signal in signals:
        for sign in (1, -1):
            one = problem(f"G {sign}*{signal} >= -20", system, bounds)
            (part,) = certify(one, CONTROLS).parts
            members = np.concatenate([one.fleet.corners, one.fleet.sample(40, 1)])
            settings = drawn(one, len(members), STEPS, 3)
            settings[:8] = -1.0
            settings[8:16] = 1.0
            assert settings.shape[1] == len(channels(one))
            seen = sign * disturbed(one, CONTROLS, members, settings, 4)[..., 2]
            assert part.proven <= seen.min() + 20 + 1e-9, signal
            (exact,) = certify(problem(f"G {sign}*{signal} >= -20", system), CONTROLS).parts
            assert part.proven <= exact.proven + 1e-9
            assert part.proven > exact.proven - 1.0  # and still says something


def test_a_replay_reads_signals_alike_by_polynomials_and_by_states() -> None:
    one = problem("G[1,3] heading >= -1 and F[0,4] (v >= 0.4 and abs(omega) <= 2)")
    run = replay(one, CONTROLS, members=400, substeps=3)
    whole = replay(one, CONTROLS, parameters=run.parameters[:50], substeps=3)
    read = with_signals(
        one,
        states(one, CONTROLS, run.parameters[:50], 3),
        np.repeat(CONTROLS, 3, axis=0),
        run.parameters[:50],
        STEP / 3,
    )
    signals = StateSignals(read, columns(one), STEP / 3)
    each = [member_robustness(part.formula, signals, ExactOps())[:, 0] for part in one.specification.parts]
    assert whole.robustness == pytest.approx(np.min(each, axis=0), abs=1e-9)
    assert run.robustness[:50] == pytest.approx(whole.robustness, abs=1e-9)


def test_units_are_said() -> None:
    one = problem("G heading >= -9 and G v >= -9 and G x >= -9")
    assert [part.unit for part in certify(one, CONTROLS).parts] == ["rad", "m/s", ""]


def test_nothing_is_claimed_of_an_angle_that_turns_further_than_its_task_was_written_out_for() -> None:
    one = problem("G[3,4] not heading within 40 deg of 0 deg", Unicycle(), None)
    turning = np.column_stack([np.full(STEPS, 0.1), np.full(STEPS, 50.0)])  # beyond the input bounds, sixteen turns
    assert certify(one, turning).proven != "yes"
    wide = {"angular_traction": Interval(0.8, 60.0)}
    assert certify(one, np.column_stack([np.full(STEPS, 0.1), np.ones(STEPS)]), wide).proven != "yes"
