"""What the tests of the command share."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ensemble_ctrl.cli.app import invoke

from .tools import SMALL, WALLED, Outcome

Command = Callable[..., Outcome]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of its own, with two problem files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "small.yaml").write_text(SMALL, encoding="utf-8")
    (tmp_path / "walled.yaml").write_text(WALLED, encoding="utf-8")
    return tmp_path


@pytest.fixture
def command(place: Path, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run the command within this process, in the working directory `place`."""

    def run(*arguments: str) -> Outcome:
        capsys.readouterr()
        code = invoke(list(arguments))
        streams = capsys.readouterr()
        return Outcome(code, streams.out, streams.err)

    return run


@pytest.fixture(scope="session")
def _planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the small problem, made once."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "small.yaml").write_text(SMALL, encoding="utf-8")
    assert invoke([str(folder / "small.yaml"), "-q", "--no-plots", "-o", str(folder / "results")]) == 0
    return folder / "results"


@pytest.fixture
def results(_planned: Path, place: Path) -> Path:
    """A copy of these results in the working directory."""
    shutil.copytree(_planned, place / "results")
    return place / "results"
