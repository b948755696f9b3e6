"""CasADi's warnings go to the solver's log, and nothing else does."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.solvers.evaluation_warnings import MOST, STAMP, Sieve, kept_warnings
from ensemble_ctrl.systems.arrays import log


class Root(ec.OdeSystem):
    """A rate that is a number only where x is positive."""

    name, states, positions = "root", ("x",), ("x",)
    controls, control_units, input_bounds = ("u",), ("1",), ((-2.0, 2.0),)

    def xdot(self, x, u, psi):  # type: ignore[no-untyped-def]
        return [log(x[0]) + u[0]]


@pytest.mark.parametrize("in_a_process", [True, False])
def test_a_search_among_states_that_are_no_numbers_is_silent(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, in_a_process: bool
) -> None:
    if not in_a_process:
        monkeypatch.setattr(parallel, "workers", lambda _: 0)
    fleet = ec.Fleet(Root(), {"start_x": ec.Interval(-0.05, 0.05)}, start={"x": 0.3})
    problem = ec.Problem("root", fleet, duration=2.0, steps=10, task=parse("G[1, 2] (x >= -1 and x <= 0.2)"))
    options = ec.SolveOptions(max_iterations=30)
    ec.plan(problem.with_(solve=options), log=tmp_path / "solver.log", check=False)
    written = capfd.readouterr()
    assert written.out == written.err == ""
    assert "NaN detected" in (tmp_path / "solver.log").read_text()


def test_pieces_of_warnings_are_kept_and_all_else_is_passed_on() -> None:
    behind = io.StringIO()
    sieve = Sieve(behind)
    for piece in ("one\n", STAMP, "a", " warning\n", "two\n", f"{STAMP}another\n", "three"):
        sieve.write(piece)
    assert behind.getvalue() == "one\ntwo\nthree"
    assert sieve.text() == f"{STAMP}a warning\n{STAMP}another\n"


def test_the_log_stays_short_and_the_stream_is_put_back(tmp_path: Path) -> None:
    before, log_file = sys.stderr, tmp_path / "solver.log"
    with kept_warnings(log_file):
        for _ in range(MOST + 7):
            sys.stderr.write(f"{STAMP}warning\n")
    assert sys.stderr is before
    lines = log_file.read_text().splitlines()
    assert len(lines) == MOST + 1
    assert lines[-1] == "... and 7 more warnings"


def test_a_closed_stream_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    with kept_warnings(None):
        print("nothing", file=sys.stderr)
    assert np.isfinite(1.0)
