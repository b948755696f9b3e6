"""Too little memory is said in a line, before a solver could hang."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from ensemble_ctrl.cli import run as run_module
from ensemble_ctrl.cli.memory import LEAST
from ensemble_ctrl.core.errors import WorkerError

from .conftest import Command
from .tools import COMMAND, environment

resource = pytest.importorskip("resource")


@pytest.mark.parametrize("arguments", [["small.yaml"], ["compare", "small.yaml"], ["online", "small.yaml", "--json"]])
def test_a_limit_that_is_too_low_is_said(place: Path, arguments: list[str]) -> None:
    done = subprocess.run(
        [*COMMAND, *arguments],
        cwd=place,
        env=environment(),
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (400_000_000, 400_000_000)),
    )
    words = f"planning needs at least {LEAST // 1_000_000} MB of address space, but this process is limited to 400 MB"
    assert done.returncode == 1
    assert done.stderr == f"error: {words} (ulimit -v)\n"
    assert ('"exit_code": 1' in done.stdout) == ("--json" in arguments)
    assert not (place / "plans").exists()


def test_memory_that_runs_out_is_said(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(run_module, "read", exhausted)
    done = command("small.yaml", "--json")
    assert done.code == done.data["exit_code"] == 1
    assert done.err.startswith("error: out of memory")


def test_a_process_that_the_system_ended_is_said(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def killed(*_: object, **__: object) -> None:
        raise WorkerError("the solver's process was ended by SIGKILL; was there too little memory?")

    monkeypatch.setattr(run_module, "plan", killed)
    done = command("small.yaml", "--json")
    assert done.code == done.data["exit_code"] == 1
    assert done.err.splitlines()[-1] == "error: the solver's process was ended by SIGKILL; was there too little memory?"
