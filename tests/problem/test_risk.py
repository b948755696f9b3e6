"""Risk in the objective: the conditional value at risk against its definition, the program against exact paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load_text, read
from ensemble_ctrl.ocp.chance import all_hyperplanes
from ensemble_ctrl.ocp.risk import risk_cost
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, transcribe
from ensemble_ctrl.ocp.truncation import choose, points
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Objective, Problem
from ensemble_ctrl.problem.evaluation.arrival import risk
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.risk import Loss, Risk, value_at_risk
from ensemble_ctrl.problem.specification import clearances
from tests.paths import CONFIGS

Floats = NDArray[np.float64]
FILES = CONFIGS / "risk"
GATE = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.85, 1.25], distribution: beta, a: 2, b: 6}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-2, 2], omega: [-2, 2]}
horizon: {duration: 6 s, steps: 30}
moments: {order: auto}
regions: {goal: {box: [[3, 5], [-1, 1]]}}
obstacles: {o: {box: [[1.4, 2.0], [-1.0, 0.1]]}}
task: "F[5, 6] in(goal) and G avoid(o)"
objective: {robustness: 0, terminal: {target: [4, 0.2], weight: 0}, effort: 0.1}
verify: {members: 200}
"""


def priced(of: Loss, level: float = 0.9, weight: float = 5.0, text: str = GATE) -> Problem:
    """The gate with a risk penalty."""
    problem = load_text(text)
    return problem.with_(objective=replace(problem.objective, cvar=Risk(of, level, weight)))


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=30), st.floats(0, 0.99))
def test_it_is_the_least_of_rockafellar_and_uryasev(losses: list[float], level: float) -> None:
    given_ = np.array(losses)

    def objective(t: float) -> float:
        return t + float(np.maximum(given_ - t, 0).mean()) / (1 - level)

    least = min(objective(t) for t in losses)
    threshold, found = value_at_risk(losses, level)
    assert found == pytest.approx(least, abs=1e-9)
    assert objective(threshold) == pytest.approx(least, abs=1e-9)
    assert minimize_scalar(objective, bounds=(-11, 11), method="bounded").fun >= found - 1e-6


@given(st.integers(1, 9), st.integers(0, 2**31))
def test_it_is_the_mean_of_the_worst(tenths: int, seed: int) -> None:
    losses = np.random.default_rng(seed).normal(size=20)
    worst = np.sort(losses)[2 * tenths :]
    assert value_at_risk(losses, tenths / 10)[1] == pytest.approx(worst.mean())
    assert value_at_risk(losses, 0.0)[1] == pytest.approx(losses.mean())


@pytest.mark.parametrize("of", ["terminal", "clearance"])
def test_the_program_prices_what_exact_paths_cost(of: Loss) -> None:
    problem = priced(of)
    v = np.full(30, 0.7)
    controls = np.column_stack([v, np.concatenate([np.full(10, 0.25), np.full(20, -0.14)])])
    truncation = choose(problem, controls)
    hyperplanes = all_hyperplanes(problem, truncation, points(problem, controls, truncation))
    program = transcribe(problem, truncation, Iterate(controls), Avoiding(hyperplanes, hyperplanes.active))
    priceless = problem.with_(objective=replace(problem.objective, cvar=None))
    without = transcribe(priceless, truncation, Iterate(controls), Avoiding(hyperplanes, hyperplanes.active))
    values = [float(p.program.functions["grad_f"](p.guess, p.program.parameters)[0]) for p in (program, without)]
    price = values[0] - values[1]
    assert price == pytest.approx(risk_cost(problem, controls), abs=0.06 if of == "terminal" else 0.3)
    if of == "clearance":
        assert price >= risk_cost(problem, controls) - 1e-6  # hyperplanes leave no more than there is


def test_clearances_are_those_of_shapely() -> None:
    from shapely import LineString, Polygon

    problem = priced("clearance")
    controls = np.column_stack([np.full(30, 0.7), np.concatenate([np.full(10, 0.25), np.full(20, -0.14)])])
    paths = trajectories(problem, controls, problem.fleet.representatives(5), 40)
    block = Polygon(problem.obstacles["o"][0].vertices)
    wanted = [min(1.0, LineString(path).distance(block)) for path in paths]
    np.testing.assert_allclose(clearances(problem, paths, 1.0), wanted, atol=2e-4)


def test_a_price_at_the_end_lowers_the_worst_distances() -> None:
    problem = priced("terminal")
    mean = problem.with_(objective=Objective(0.0, np.array([4.0, 0.2]), 5.0, 0.1))
    ours, theirs = solve(problem), solve(mean)
    assert ours.certificate is not None
    assert ours.certificate.proven == "yes"
    found = [risk(problem, plan.controls)["cvar"] for plan in (ours, theirs)]
    assert found[0] < found[1] - 5e-3
    assert ours.attempt.value.risk == pytest.approx(5.0 * found[0], rel=0.1)


def test_a_price_on_the_way_raises_the_least_clearances() -> None:
    problem = priced("clearance", weight=1.0)
    free = problem.with_(objective=replace(problem.objective, cvar=None))
    ours, theirs = solve(problem), solve(free)
    assert ours.certificate is not None
    assert ours.certificate.proven == "yes"
    found = [-risk(problem, plan.controls)["cvar"] for plan in (ours, theirs)]
    assert found[0] > found[1] + 0.05
    assert ours.certificate.clearance > found[1]


def test_each_command_has_a_weight() -> None:
    text = GATE.replace("effort: 0.1", "effort: {v: 0.1, omega: 0.4}")
    problem = load_text(text)
    assert problem.objective.efforts().tolist() == [0.1, 0.4]
    assert load_text(dump(problem)).objective.efforts().tolist() == [0.1, 0.4]
    assert load_text(dump(load_text(GATE))).objective.effort == 0.1
    found = solve(problem)
    step = problem.duration / len(found.attempt.controls)
    energy = step * (found.attempt.controls**2).sum(axis=0)
    assert found.attempt.value.effort == pytest.approx(0.1 * energy[0] + 0.4 * energy[1])
    turning = (solve(load_text(GATE)).controls[:, 1] ** 2).sum()
    assert (found.controls[:, 1] ** 2).sum() < turning


@pytest.mark.parametrize("name", ["cvar_terminal", "cvar_clearance", "share"])
def test_configs_load_without_a_warning_and_are_written_again(name: str) -> None:
    loaded = read(FILES / f"{name}.yaml")
    assert loaded.warnings == ()
    assert load_text(dump(loaded.problem)).objective.cvar == loaded.problem.objective.cvar


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("effort: 0.1", "cvar: {of: time}, effort: 0.1", "objective.cvar.of: 'time' is not one of terminal, clearance"),
        ("effort: 0.1", "cvar: {of: terminal, level: 1}, effort: 0.1", "expected a share from 0 to below 1, got 1"),
        ("target: [4, 0.2]", "target: {moments: [[1, 2]]}", "got moments of the whole fleet"),
        ("terminal: {target: [4, 0.2], weight: 0}, ", "", "expected a place, or a place for each member"),
        ("effort: 0.1", "effort: {v: 0.1, delta: 0.2}", "expected weights of v and omega, got 'delta'"),
        ("effort: 0.1", "effort: {v: -0.1}", "expected a number without a unit, 0 or more, got -0.1"),
    ],
)
def test_mistakes_are_told(old: str, new: str, wanted: str) -> None:
    text = GATE.replace(old, new)
    if "target" in old:
        text = text.replace("effort: 0.1", "cvar: {of: terminal}, effort: 0.1")
    with pytest.raises(ConfigError) as error:
        load_text(text)
    assert wanted in str(error.value)


def test_numbers_from_python_are_checked() -> None:
    with pytest.raises(ProblemError, match="expected a level from 0 to below 1, got 1"):
        Risk("terminal", 1.0)
    with pytest.raises(ProblemError, match="expected finite weights >= 0"):
        Objective(effort=np.array([0.1, -1.0]))
