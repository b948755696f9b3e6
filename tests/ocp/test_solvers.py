"""What a solve can end with, in our own words."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from ensemble_ctrl.ocp.program import Block, Program, assemble
from ensemble_ctrl.ocp.solvers import Iteration, Nlp, Outcome, SolverOptions, ipopt, solve
from ensemble_ctrl.ocp.solvers.ipopt import STATUS

Build = Callable[[Any, Any], Any]


def program(cost: Build, *rows: tuple[Build, float, float]) -> Program:
    """A program of two variables."""
    where, none = np.array([[0, 1]]), np.zeros((1, 0))
    blocks = [
        Block(f"row {i}", build, where, none, np.array([[low]]), np.array([[high]]))
        for i, (build, low, high) in enumerate(rows)
    ]
    return assemble(2, blocks, [Block("cost", cost, where, none, none, none)])


def valley(z: Any, d: Any) -> Any:
    """Rosenbrock's function, least at (1, 1)."""
    return 100 * (z[1] - z[0] ** 2) ** 2 + (1 - z[0]) ** 2


def run(which: Program, guess: tuple[float, float] = (-1.2, 1.0), watch: Any = None, **options: Any) -> Outcome:
    free = np.full(2, np.inf)
    return solve(Nlp(which, np.array(guess), -free, free), SolverOptions(**options), watch)


def test_a_solved_program() -> None:
    outcome = run(program(valley, (lambda z, d: z[0] + z[1], -np.inf, 1.0)), tolerance=1e-8)
    assert outcome.status == "solved"
    assert outcome.message == "solve succeeded"
    assert outcome.iterations > 3
    assert outcome.x.sum() == pytest.approx(1.0, abs=1e-6)
    assert outcome.cost == pytest.approx(float(valley(outcome.x, None)), rel=1e-9)
    x = np.linspace(0.5, 0.7, 20_001)
    assert outcome.cost == pytest.approx(valley((x, 1 - x), None).min(), abs=1e-6)


def test_bounds_of_the_variables_are_kept() -> None:
    nlp = Nlp(program(valley), np.zeros(2), np.array([-1.0, -1.0]), np.array([0.5, 2.0]))
    outcome = solve(nlp, SolverOptions())
    assert outcome.status == "solved"
    np.testing.assert_allclose(outcome.x, [0.5, 0.25], atol=1e-3)


def test_an_infeasible_program() -> None:
    apart = program(valley, (lambda z, d: z[0], 1.0, np.inf), (lambda z, d: z[0], -np.inf, -1.0))
    outcome = run(apart)
    assert outcome.status == "infeasible"
    assert np.isfinite(outcome.x).all()


def test_the_iteration_limit() -> None:
    outcome = run(program(valley), max_iterations=3)
    assert (outcome.status, outcome.iterations) == ("limit", 3)
    assert "iterations" in outcome.message
    assert valley(outcome.x, None) < valley((-1.2, 1.0), None)


def test_the_time_limit() -> None:
    def slow(_: Iteration) -> bool:
        time.sleep(0.02)
        return False

    outcome = run(program(valley), watch=slow, time_limit=0.05)
    assert outcome.status == "limit"
    assert "time" in outcome.message
    assert 0 < outcome.iterations < 10


def lingering(_: Iteration) -> bool:
    time.sleep(0.005)
    return False


def test_no_time_left_still_returns_the_guess() -> None:
    outcome = run(program(valley), watch=lingering, time_limit=-1.0)
    assert outcome.status == "limit"
    assert np.isfinite(outcome.x).all()


def test_a_watcher_sees_every_iteration_and_can_stop() -> None:
    seen: list[Iteration] = []

    def watch(iteration: Iteration) -> bool:
        seen.append(iteration)
        return iteration.count == 4

    outcome = run(program(valley, (lambda z, d: z[0] + z[1], 5.0, 5.0)), watch=watch)
    assert outcome.status == "interrupted"
    assert [i.count for i in seen] == [0, 1, 2, 3, 4]
    assert seen[0].cost == pytest.approx(valley((-1.2, 1.0), None))
    assert seen[0].violation == pytest.approx(5.2)
    assert seen[-1].violation < 1e-6
    assert outcome.x.sum() == pytest.approx(5.0)


@pytest.mark.parametrize("error", [ZeroDivisionError("in the watch"), KeyboardInterrupt()])
def test_an_exception_in_the_watch_is_raised_after_the_solve(error: BaseException) -> None:
    calls: list[int] = []

    def watch(iteration: Iteration) -> bool:
        calls.append(iteration.count)
        if iteration.count == 2:
            raise error
        return False

    with pytest.raises(type(error)) as caught:
        run(program(valley), watch=watch)
    assert caught.value is error
    assert calls == [0, 1, 2]


def test_a_word_that_is_not_known_means_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    undefined = run(program(lambda z, d: ca.sqrt(z[0]) + z[1] ** 2), guess=(-1.0, 0.0))
    assert undefined.status == "failed"
    assert undefined.message not in ("", "solve succeeded")
    monkeypatch.delitem(STATUS, "Solve_Succeeded")
    assert run(program(valley)).status == "failed"


def test_every_status_is_one_of_ours() -> None:
    assert set(STATUS.values()) == {"solved", "infeasible", "limit", "interrupted"}


def test_the_solver_writes_its_log_to_a_file_and_nothing_to_the_screen(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "ipopt.log"
    for _ in range(2):
        run(program(valley), log=log)
    assert log.read_text().count("EXIT: Optimal Solution Found") == 2
    shown = capfd.readouterr()
    assert (shown.out, shown.err) == ("", "")


def again_and_again(which: Program, watch: Any) -> None:
    for _ in range(10_000):
        run(which, watch=watch)


@pytest.mark.parametrize("watched", [True, False])
def test_ctrl_c_stops_the_solve_and_is_raised(watched: bool, capfd: pytest.CaptureFixture[str]) -> None:
    """CasADi takes it for a failed evaluation and goes on, if it sees it."""
    before, hilly = signal.getsignal(signal.SIGINT), program(valley)
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        again_and_again(hilly, (lambda _: False) if watched else None)
    timer.join()
    assert signal.getsignal(signal.SIGINT) == before
    assert "KeyboardInterruptException" not in capfd.readouterr().err


def test_a_handler_that_raises_nothing_stops_nothing() -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))

    def watch(iteration: Iteration) -> bool:
        if iteration.count == 1:
            signal.raise_signal(signal.SIGINT)
        return False

    try:
        outcome = run(program(valley), watch=watch)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (outcome.status, seen) == ("solved", [signal.SIGINT])


@pytest.mark.skipif(sys.platform != "linux", reason="address space is read and limited as on Linux")
def test_a_lack_of_memory_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenBLAS would ask for its buffer for ever."""
    import resource

    monkeypatch.setattr(ipopt, "_reserved", set())
    built, before = program(valley), resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 120_000_000, before[1]))
    try:
        with pytest.raises(MemoryError, match="the solver needs 180 MB more of address space"):
            run(built)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert run(built).status == "solved"
