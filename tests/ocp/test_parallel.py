"""Candidates side by side: order, stops, deaths, and that no process is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.solvers import BUILDING, Iteration, Watch
from tests.processes import children

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")
SOURCES = Path(parallel.__file__).parents[2]


@pytest.fixture(autouse=True)
def two_workers(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two processes at a time, whatever the machine has; afterwards none is left."""
    before = children()
    monkeypatch.setattr(parallel, "workers", lambda count: min(count, 2))
    yield
    assert children() <= before


def go_on(*_: object) -> bool:
    return False


def plenty() -> float:
    return 60.0


def until_told(_: int, watch: Watch) -> str:
    """Iterate until asked to stop."""
    for count in range(10_000):
        if watch(Iteration(count, 0.0, 0.0)):
            return "stopped"
        time.sleep(0.005)
    return "never stopped"


def test_results_come_in_order_from_processes_of_their_own() -> None:
    def work(candidate: int, _: Watch) -> tuple[int, int]:
        time.sleep(0.2 if candidate == 0 else 0.0)
        return candidate, os.getpid()

    results = parallel.each(work, 5, go_on, plenty)
    assert [result and result[0] for result in results] == [0, 1, 2, 3, 4]
    processes = {result[1] for result in results if result}
    assert len(processes) == 5
    assert os.getpid() not in processes


def test_a_large_result_arrives_whole() -> None:
    results = parallel.each(lambda i, _: bytes([i]) * 1_000_000, 3, go_on, plenty)
    assert results == [bytes([i]) * 1_000_000 for i in range(3)]


def test_every_iteration_is_told() -> None:
    seen: list[tuple[int, int]] = []

    def work(_: int, watch: Watch) -> None:
        for count in range(20):
            watch(Iteration(count, 1.5, 0.5))

    def tell(candidate: int, iteration: Iteration) -> bool:
        seen.append((candidate, iteration.count))
        return False

    parallel.each(work, 3, tell, plenty)
    assert sorted(seen) == [(candidate, count) for candidate in range(3) for count in range(20)]


def test_the_solver_is_loaded_before_processes_are_forked() -> None:
    code = """
from pathlib import Path
from ensemble_ctrl.ocp import parallel
libraries = lambda _: "libipopt" in Path("/proc/self/maps").read_text()
print(libraries(None), parallel.alone(libraries, lambda _: False, lambda: 60.0))
"""
    environment = {**os.environ, "PYTHONPATH": str(SOURCES)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "False True\n"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_process_has_no_result_and_the_others_go_on(number: signal.Signals) -> None:
    def work(candidate: int, _: Watch) -> int:
        if candidate == 1:
            os.kill(os.getpid(), number)
        return candidate

    assert parallel.each(work, 4, go_on, plenty) == [0, None, 2, 3]


@pytest.mark.parametrize(
    ("end", "message"),
    [
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "was ended by SIGKILL; was there too little memory?"),
        (lambda: os.kill(os.getpid(), signal.SIGALRM), "was ended by SIGALRM$"),
        (lambda: os._exit(0), "ended without a result$"),
    ],
)
def test_how_the_only_process_ended_is_said_at_once(end: Callable[[], None], message: str) -> None:
    with pytest.raises(WorkerError, match=message):
        parallel.alone(lambda _: end(), go_on, plenty)


def test_a_group_that_is_asked_to_stop_is_no_error() -> None:
    assert parallel.alone(lambda _: os.kill(os.getpid(), signal.SIGTERM), go_on, plenty) is None


def test_one_that_raises_has_no_result_and_the_others_go_on() -> None:
    assert parallel.each(lambda i, _: 1 // i, 3, go_on, plenty) == [None, 1, 0]


def test_what_the_first_raised_is_raised_where_there_is_no_result_with_its_place_as_a_note() -> None:
    with pytest.raises(ZeroDivisionError, match="by zero") as refusal:
        parallel.alone(lambda _: 1 // 0, go_on, plenty)
    assert "test_parallel.py" in refusal.value.__notes__[0]


def test_a_silent_one_can_be_stopped_and_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi hears nothing while it builds a program."""
    monkeypatch.setattr(parallel, "GRACE", 0.1)
    monkeypatch.setattr(parallel, "SILENCE", 0.1)
    seen: list[Iteration] = []

    def tell(iteration: Iteration) -> bool:
        seen.append(iteration)
        return len(seen) == 2

    assert parallel.alone(lambda _: time.sleep(60), tell, plenty) is None
    assert seen == [BUILDING, BUILDING]


def test_ctrl_c_is_left_to_the_parent() -> None:
    def work(candidate: int, _: Watch) -> int:
        os.kill(os.getpid(), signal.SIGINT)
        return candidate

    assert parallel.each(work, 2, go_on, plenty) == [0, 1]


def test_a_stop_reaches_all_and_no_more_are_begun() -> None:
    results = parallel.each(until_told, 4, lambda i, it: it.count >= 3, plenty)
    assert results == ["stopped", "stopped", None, None]


def test_one_that_does_not_stop_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "GRACE", 0.3)

    def deaf(candidate: int, watch: Watch) -> str:
        if candidate == 1:
            time.sleep(60)
        return until_told(candidate, watch)

    assert parallel.each(deaf, 2, lambda *_: True, plenty) == ["stopped", None]


def test_nothing_is_begun_without_time_and_an_endless_one_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    assert parallel.each(until_told, 2, go_on, lambda: 0.0) == [None, None]
    monkeypatch.setattr(parallel, "GRACE", 0.1)
    ends = time.monotonic() + 0.2
    assert parallel.each(until_told, 2, go_on, lambda: ends - time.monotonic()) == [None, None]


def test_an_exception_of_the_listener_ends_all() -> None:
    def tell(*_: object) -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        parallel.each(until_told, 2, tell, plenty)


def test_one_at_a_time_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "workers", lambda _: 0)
    assert parallel.each(lambda i, _: (i, os.getpid()), 3, go_on, plenty) == [(i, os.getpid()) for i in range(3)]
    assert parallel.each(until_told, 3, lambda i, it: it.count >= 3, plenty) == ["stopped", None, None]
    assert parallel.each(lambda i, _: 1 // i, 3, go_on, plenty) == [None, 1, 0]
    with pytest.raises(ZeroDivisionError):
        parallel.each(lambda i, _: 1 // 0, 2, go_on, plenty)


def test_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2})
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    assert [parallel.workers(count) for count in (0, 1, 2, 9)] == [1, 1, 2, 3]
    assert parallel.each(lambda i, _: parallel.workers(9), 1, go_on, plenty) == [0]  # no processes of processes
    monkeypatch.setattr(threading, "active_count", lambda: 2)
    assert parallel.workers(9) == 0


ENDLESS = """
import os, time
from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.ocp import parallel
parallel.workers = lambda count: 2
def work(candidate, watch):
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)
parallel.each(work, 2, lambda *_: False, lambda: 60.0)
"""


def test_children_end_with_a_parent_that_is_killed() -> None:
    environment, command = {**os.environ, "PYTHONPATH": str(SOURCES)}, [sys.executable, "-c", ENDLESS]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as parent:
        assert parent.stdout is not None
        children = [int(parent.stdout.readline()) for _ in range(2)]
        assert all(is_running(child) for child in children)
        parent.kill()
    deadline = time.monotonic() + 10
    while any(is_running(child) for child in children) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(is_running(child) for child in children)


def is_running(process: int) -> bool:
    """Whether a process exists and has not ended."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "ZX"
