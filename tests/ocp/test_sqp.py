"""Sequential quadratic programs on the same programs as the interior-point method."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from ensemble_ctrl.ocp.chance import all_hyperplanes
from ensemble_ctrl.ocp.guesses.roadmap import roadmap_guesses
from ensemble_ctrl.ocp.solvers import SOLVERS, Iteration, Nlp, Outcome, SolverOptions, solve
from ensemble_ctrl.ocp.state_rounds import Stage, whole
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, Transcription, transcribe
from ensemble_ctrl.ocp.truncation import coarse, points, tail

from .problems import five
from .test_shooting import problem as masses
from .test_solvers import program, valley


@cache
def arcs() -> Transcription:
    """Robots on arcs around five obstacles, on a coarse grid, from the shortest route."""
    problem, truncation = five(), coarse(five())
    controls = roadmap_guesses(problem, 32, 1)[0].controls
    hyperplanes = all_hyperplanes(problem, truncation, points(problem, controls, truncation))
    spare = (tail(problem, controls, truncation), 0.0)
    return transcribe(problem, truncation, Iterate(controls), Avoiding(hyperplanes, hyperplanes.active), spare)


@cache
def states() -> Transcription:
    """Point masses around a block, pushed to the goal."""
    problem = masses()
    stage = Stage(problem, whole(problem), 1)
    push = np.where(np.arange(20) < 10, 0.3, -0.3)
    iterate = stage.simulated(np.column_stack([push, 0.6 * np.cos(np.arange(20) / 4)]))
    return transcribe(problem, stage.truncation, iterate, stage.avoiding(iterate))


def run(nlp: Nlp, solver: str = "sqp", watch: Any = None, **options: Any) -> Outcome:
    return solve(nlp, SolverOptions(solver=solver, **{"tolerance": 1e-4, "max_iterations": 100} | options), watch)


def worst(nlp: Nlp, x: np.ndarray[Any, Any]) -> float:
    """The largest violation of a row or a bound."""
    g = np.array(nlp.program.functions["g"](x, nlp.program.parameters)).ravel()
    rows = np.maximum(nlp.program.lower - g, g - nlp.program.upper)
    return float(max(rows.max(), (nlp.lower - x).max(), (x - nlp.upper).max()))


@pytest.mark.parametrize("transcription", [arcs, states])
def test_neither_solver_improves_much_on_the_other(transcription: Any) -> None:
    """From the one's solution the other finds nothing that costs a percent less."""
    nlp = transcription().nlp
    ours = run(nlp)
    assert ours.status == "solved"
    assert worst(nlp, ours.x) < 1e-3
    start = float(nlp.program.functions["grad_f"](nlp.guess, nlp.program.parameters)[0])
    assert ours.cost < start - 0.5
    again = run(replace(nlp, guess=ours.x), "ipopt")
    assert again.cost == pytest.approx(ours.cost, abs=1e-2 * (1 + abs(ours.cost)))
    assert run(replace(nlp, guess=again.x)).cost <= again.cost + 1e-3


def test_a_program_without_equations() -> None:
    free = np.full(2, np.inf)
    row = (lambda z, d: z[0] + z[1], -np.inf, 1.0)
    nlp = Nlp(program(valley, row), np.array([-1.2, 1.0]), -free, free)
    assert run(nlp, tolerance=1e-9).cost == pytest.approx(run(nlp, "ipopt", tolerance=1e-9).cost, abs=1e-4)


def test_rows_that_contradict_each_other_fall_short() -> None:
    free = np.full(2, np.inf)
    rows = [(lambda z, d: z[0], 2.0, np.inf), (lambda z, d: z[0], -np.inf, 1.0)]
    found = run(Nlp(program(lambda z, d: z[0] ** 2 + z[1] ** 2, *rows), np.zeros(2), -free, free))
    assert (found.status, found.message) == ("infeasible", "falls short")


def test_limits_and_watchers_end_it() -> None:
    seen: list[Iteration] = []

    def watch(iteration: Iteration) -> bool:
        seen.append(iteration)
        return len(seen) == 3

    assert run(arcs().nlp, watch=watch).status == "interrupted"
    assert [iteration.count for iteration in seen] == [0, 1, 2]
    assert seen[2].cost < seen[0].cost
    assert run(arcs().nlp, max_iterations=2).status == "limit"
    assert run(arcs().nlp, time_limit=0.0).message == "out of time"


def test_it_needs_to_know_what_the_equations_determine() -> None:
    found = run(replace(arcs().nlp, dependent=np.zeros(0, dtype=np.int64)))
    assert found.status == "failed"
    assert found.x is arcs().nlp.guess


def test_the_table_of_words_covers_what_it_says() -> None:
    for solver in SOLVERS.values():
        assert set(solver.statuses.values()) <= {"solved", "infeasible", "limit", "interrupted", "failed"}
