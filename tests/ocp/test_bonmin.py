"""Bonmin in its own process: its answers, its limits, and every way in which the process can end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import ensemble_ctrl.ocp.solvers.bonmin as module
from ensemble_ctrl.ocp.program import Block, Program, assemble
from ensemble_ctrl.ocp.solvers.bonmin import BonminOptions, Branching, MixedOutcome, bonmin, progress_of
from tests.paths import ROOT

N = 40
"""Binaries of the slow problem."""


def small() -> Program:
    """Minimise (x - 1.3)^2 + 0.1 z with x + z >= 1.5."""
    cost = Block("cost", lambda z, d: (z[0] - 1.3) ** 2 + 0.1 * z[1], np.array([[0, 1]]), *nothing(1))
    row = Block("row", lambda z, d: z[0] + z[1], np.array([[0, 1]]), np.zeros((1, 0)), at(1.5), at(np.inf))
    return assemble(2, [row], [cost])


def slow() -> Program:
    """Half of many numbers on a hard knapsack with a wavy cost: a tree that no limit of these tests lets finish."""
    weight = np.sqrt(np.arange(2.0, N + 2))

    def knapsack(z: ca.SX, d: ca.SX) -> ca.SX:
        total: ca.SX = ca.dot(ca.DM(weight), z)
        return total

    def wavy(z: ca.SX, d: ca.SX) -> ca.SX:
        cost: ca.SX = (ca.dot(ca.DM(weight), z) - 0.37 * weight.sum()) ** 2 + 0.01 * ca.sum1(
            ca.sin(9 * ca.DM(weight) * z)
        )
        return cost

    columns = np.arange(N)[None]
    row = Block("row", knapsack, columns, np.zeros((1, 0)), at(0.3 * weight.sum()), at(0.4 * weight.sum()))
    return assemble(N, [row], [Block("cost", wavy, columns, *nothing(1))])


def at(value: float) -> Any:
    """A bound of one row."""
    return np.full((1, 1), value)


def nothing(instances: int) -> Any:
    """Data and bounds of a term."""
    return [np.zeros((instances, 0))] * 3


def run(program: Program, discrete: Any = None, options: BonminOptions | None = None, **kwargs: Any) -> MixedOutcome:
    """Solve from zero, variables in [0, 1] unless they are continuous."""
    n = program.nlp["x"].numel()
    mask = np.ones(n, dtype=bool) if discrete is None else np.array(discrete)
    return bonmin(
        program,
        mask,
        np.zeros(n),
        np.where(mask, 0.0, -5.0),
        np.where(mask, 1.0, 5.0),
        options or BonminOptions(),
        **kwargs,
    )


def children() -> set[str]:
    """Processes of this machine that run the child."""
    listed = subprocess.run(["ps", "-ewwo", "pid,args"], capture_output=True, text=True, check=True).stdout
    return {line.split()[0] for line in listed.splitlines() if "bonmin_child.py" in line and "<defunct>" not in line}


def test_it_finds_the_best_choice(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log = tmp_path / "solver.log"
    found = run(small(), [False, True], BonminOptions(log=log))
    assert found.status == "solved"
    assert found.x is not None
    np.testing.assert_allclose(found.x, [1.5, 0.0], atol=1e-5)
    assert found.branching.cost == pytest.approx(0.04, abs=1e-5)
    assert capfd.readouterr() == ("", "")
    assert "Cbc" in log.read_text()


def test_a_cutoff_below_the_best_leaves_nothing() -> None:
    found = run(small(), [False, True], BonminOptions(cutoff=0.03))
    assert found.status == "infeasible"
    assert found.x is None
    assert found.branching.cost == np.inf


def test_the_limit_is_kept_and_nothing_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "OWN_SHARE", 1000.0)
    before = children()
    began = time.perf_counter()
    found = run(slow(), options=BonminOptions(time_limit=1.0))
    assert time.perf_counter() - began < 3.0
    assert (found.status, found.x, found.message) == ("limit", None, "ended at the time limit")
    assert children() <= before


@pytest.mark.slow
def test_its_own_limit_returns_what_it_has() -> None:
    found = run(slow(), options=BonminOptions(time_limit=8.0))
    assert found.status in ("limit", "solved")
    assert found.x is None or np.isfinite(found.x).all()


def test_the_watcher_sees_progress_and_may_end_it() -> None:
    seen: list[Branching] = []

    def watch(now: Branching) -> bool:
        seen.append(now)
        return len(seen) >= 3

    before = children()
    found = run(slow(), options=BonminOptions(time_limit=30.0), watch=watch)
    assert (found.status, found.message) == ("interrupted", "ended on request")
    assert len(seen) == 3
    assert children() <= before


def test_a_watcher_that_raises_leaves_no_process() -> None:
    def watch(_: Branching) -> bool:
        raise KeyboardInterrupt

    before = children()
    with pytest.raises(KeyboardInterrupt):
        run(slow(), options=BonminOptions(time_limit=30.0), watch=watch)
    assert children() <= before


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])
def test_a_child_that_is_killed_is_a_status(number: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    started = module._started

    def killed(*files: Any) -> subprocess.Popen[bytes]:
        child = started(*files)
        threading.Timer(0.7, child.send_signal, [number]).start()
        return child

    monkeypatch.setattr(module, "_started", killed)
    found = run(slow(), options=BonminOptions(time_limit=30.0))
    assert (found.status, found.x) == ("failed", None)
    assert number.name in found.message


def test_a_child_without_memory_is_a_status() -> None:
    found = run(slow(), options=BonminOptions(time_limit=30.0, memory=2**26))
    assert (found.status, found.x) == ("failed", None)
    assert "failed with exit code" in found.message or "ended by" in found.message


@pytest.mark.parametrize("interpreter", ["/nowhere/python", "/bin/false"])
def test_a_child_that_cannot_start_is_a_status(interpreter: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", interpreter)
    found = run(small(), [False, True])
    assert (found.status, found.x) == ("failed", None)
    assert found.message.startswith("bonmin")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the child ends at its own limit only")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_child_outlives_its_parent(number: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        sys.path.insert(0, {str(ROOT)!r})
        from tests.ocp.test_bonmin import BonminOptions, run, slow
        print("begun", flush=True)
        run(slow(), options=BonminOptions(time_limit=60.0), watch=lambda now: print("running", flush=True))
        """)
    )
    before = children()
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=dict(os.environ),
    )
    assert parent.stdout is not None
    while "running" not in parent.stdout.readline():
        assert parent.poll() is None
    time.sleep(0.5)
    assert children() - before
    parent.send_signal(number)
    parent.wait()
    for _ in range(50):
        if children() <= before:
            return
        time.sleep(0.1)
    pytest.fail("a child outlived its parent")


LOG = """
NLP0014I             1         OPT 0.21        11 0.616872
Cbc0012I Integer solution of 0.61790459 found by DiveMIPFractional after 0 iterations and 0 nodes (1.56 seconds)
Cbc0010I After 100 nodes, 23 on tree, 0.55 best solution, best possible 0.5 (12.30 seconds)
"""


@pytest.mark.parametrize(
    ("log", "seen"),
    [
        ("", Branching()),
        ("nonsense 12 nodes\nNLP0014I  1 OPT 3.0", Branching()),
        (LOG, Branching(100, 0.55, 0.5)),
        (
            "Cbc0010I After 7 nodes, 3 on tree, 1e+50 best solution, best possible -1.5 (1 seconds)",
            Branching(7, np.inf, -1.5),
        ),
        (
            "Cbc0005I Partial - best objective 1e+50 (best possible 1.0384), took 5 iterations and 9 nodes (2 s)",
            Branching(9, np.inf, 1.0384),
        ),
        ("Cbc0001I Search completed - best objective -0.25, took 4 iterations and 2 nodes (1 s)", Branching(2, -0.25)),
    ],
)
def test_the_log_says_how_far_it_is(log: str, seen: Branching) -> None:
    assert progress_of(log) == seen


def test_what_was_known_is_kept() -> None:
    assert progress_of("Cbc0010I After 9 nodes", Branching(3, 0.5, 0.1)) == Branching(9, 0.5, 0.1)
