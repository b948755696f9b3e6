"""Ctrl-C and SIGTERM: once keeps the best plan so far, twice ends at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.results import write_results
from ensemble_ctrl.cli import run as run_module
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.watcher import BURST

from .conftest import Command
from .tools import COMMAND, environment, left

APART = 1.5 * BURST
"""Seconds between two signals that count as two."""
SLOW = ("small.yaml", "-v", "--set", "horizon.steps=800", "--set", "moments.order=8")


@contextmanager
def started(place: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A run that has begun to solve."""
    with subprocess.Popen(
        [*COMMAND, *SLOW, *arguments],
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    ) as running:
        until(running, "iteration 1,")
        yield running
        running.kill()


def until(running: subprocess.Popen[str], words: str) -> None:
    """Read stderr up to a line with these words."""
    assert running.stderr is not None
    for line in running.stderr:
        if words in line:
            return
    raise AssertionError(f"never said {words!r}")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_once_keeps_the_best_plan(place: Path, number: signal.Signals, code: int) -> None:
    with started(place) as running:
        running.send_signal(number)
        out, err = running.communicate(timeout=30)
    assert running.returncode == code
    assert "stopping after this iteration; the best plan so far is kept" in err
    assert "Traceback" not in err
    assert out.startswith("small: interrupted, best plan so far")
    assert ec.Plan.load(place / "plans/small").status == "interrupted"
    assert not list(place.rglob(".*"))
    assert not list(place.rglob("*.png"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_at_one_time_are_one(place: Path, number: signal.Signals) -> None:
    """GNU timeout signals the command and then its process group."""
    with started(place) as running:
        for _ in range(3):
            running.send_signal(number)
            os.killpg(running.pid, number)
            time.sleep(BURST / 20)
        out, err = running.communicate(timeout=30)
    assert running.returncode == 128 + number
    assert err.count("stopping after this iteration") == 1
    assert out.startswith("small: interrupted, best plan so far")


def test_twice_ends_at_once_and_leaves_nothing(place: Path) -> None:
    before = left(place)
    with started(place, "--members", "5000000", "--json") as running:
        running.send_signal(signal.SIGINT)
        until(running, "stopping after this iteration")
        time.sleep(APART)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=30)
    assert running.returncode == 130
    assert out.count("\n") == 1
    assert '"exit_code": 130' in out
    assert "error: interrupted twice; nothing was kept" in err
    assert left(place) == before


DEAF = """
import sys, time
from ensemble_ctrl.cli.progress import Progress, stoppable

progress = Progress()
with stoppable(progress, lambda: print("abandoned", flush=True)):
    print("begun", flush=True)
    while sys.argv[1] == "second" and progress.stop_signal is None:
        time.sleep(0.01)
    print("deaf", flush=True)
    sum(range(10**14))
"""
"""Hears no signal, or only the first one: a call that runs no Python for hours."""


@pytest.mark.parametrize("unheard", ["first", "second"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_twice_ends_at_once_within_a_long_call(unheard: str, number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", DEAF, unheard],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "begun\n"
        if unheard == "second":
            running.send_signal(number)
        assert running.stdout.readline() == "deaf\n"
        for _ in range(2 if unheard == "first" else 1):
            time.sleep(APART)  # to be in the call
            running.send_signal(number)
        try:
            out, err = running.communicate(timeout=30)
        finally:
            running.kill()
    assert running.returncode == -signal.SIGKILL
    assert out == "abandoned\n"
    assert "Traceback" not in err


def test_twice_ends_commands_that_keep_nothing(place: Path) -> None:
    program = (
        "import ensemble_ctrl.cli.app as app; app.invoke = lambda _: print('deaf', flush=True) or sum(range(10**14))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", f"{program}; app.main([])"], stdout=subprocess.PIPE, text=True, env=environment()
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "deaf\n"
        for _ in range(2):
            time.sleep(0.3)
            running.send_signal(signal.SIGINT)
        try:
            running.communicate(timeout=30)
        finally:
            running.kill()
    assert running.returncode == -signal.SIGINT


@pytest.mark.parametrize("signals", [1, 2])
def test_no_process_is_left(place: Path, signals: int) -> None:
    """Candidates are solved in processes of their own, in the group of the command's."""
    with started(place, "--set", "solve.routes=all") as running:
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does
        if signals == 2:
            until(running, "stopping after this iteration")
            time.sleep(APART)
            os.killpg(running.pid, signal.SIGINT)
        running.communicate(timeout=30)
    deadline = time.monotonic() + 10
    while group_exists(running.pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not group_exists(running.pid)
    assert running.returncode == 130


def group_exists(number: int) -> bool:
    """Whether a process group has any process."""
    try:
        os.killpg(number, 0)
    except ProcessLookupError:
        return False
    return True


def test_before_there_is_a_plan(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_module, "read", interrupted)
    done = command("small.yaml", "--json")
    assert done.code == done.data["exit_code"] == 130
    assert done.err == "error: interrupted; there is no plan yet\n"


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    progress = Progress(quiet=True)
    with stoppable(progress, lambda: None):
        assert signal.getsignal(signal.SIGINT) != before[0]
        assert not progress("solve", None)
        signal.raise_signal(signal.SIGINT)
        assert progress("solve", None)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_thread_installs_no_handlers() -> None:
    seen = []

    def work() -> None:
        with stoppable(Progress(quiet=True), lambda: None):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("as_json", [False, True])
def test_a_signal_after_the_search_is_in_the_result(
    command: Command, place: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int, as_json: bool
) -> None:
    def interrupted(*given: Any) -> None:
        write_results(*given)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(run_module, "write_results", interrupted)
    done = command("small.yaml", *(["--json"] if as_json else []))
    assert done.code == code
    words = "interrupted after the search ended"
    if as_json:
        assert done.data["status"] == "planned"
        assert done.data["interrupted"].startswith(words)
        assert done.data["exit_code"] == code
    else:
        head, second, *_ = done.out.splitlines()
        assert head.startswith("small: plan found, proven")
        assert second.startswith(f"  stopped    {words}")
    assert ec.Plan.load(place / "plans/small").status == "planned"
    assert not list(place.rglob("*.png"))


def test_an_uninterrupted_result_says_nothing_of_it(command: Command) -> None:
    done = command("small.yaml", "--no-plots", "--json")
    assert "interrupted" not in done.data


def test_widest_that_is_stopped_prints_what_is_proven(place: Path) -> None:
    arguments = ("widest", "small.yaml", "--tolerance", "1e-4")
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*COMMAND, *arguments], cwd=place, env=environment(), **pipes) as running:
        until(running, ": certified")
        running.send_signal(signal.SIGTERM)
        out, _ = running.communicate(timeout=60)
    assert running.returncode == 143
    assert "small: widest certified traction" in out
    assert "proven     clearance >=" in out
    assert "stopped    before its end" in out
