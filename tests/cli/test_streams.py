"""Terminals, pipes and closed pipes."""

from __future__ import annotations

import io
import os
import pty
import subprocess
from pathlib import Path

import pytest

from ensemble_ctrl.cli.progress import Progress
from ensemble_ctrl.ocp.solvers import Iteration

from .tools import COMMAND, environment, process

REWRITE = "\r\x1b[K"


class Screen(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def shown(stream: io.StringIO, *, quiet: bool = False, verbose: bool = False) -> str:
    """What a short run writes to a stream."""
    progress = Progress(quiet, verbose, stream)
    progress("check", None)
    progress("solve", None)
    for count in range(3):
        progress("solve", Iteration(count, 1.0, 1e-3))
    progress.finish()
    return stream.getvalue()


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")


def test_on_a_terminal_one_line_is_rewritten_and_wiped() -> None:
    text = shown(Screen())
    assert f"{REWRITE}solve: iteration 2, cost 1.0000, violation 1.0e-03" in text
    assert text.count("\n") == 1
    assert text.split(REWRITE)[-1].startswith("check 0.00 s, solve 0.00 s")


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_a_plain_terminal_gets_plain_lines(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(name, value)
    assert "\x1b" not in shown(Screen())
    assert "\r" not in shown(Screen())


def test_in_a_pipe_a_plain_line_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter(x / 4 for x in range(1000))
    monkeypatch.setattr("ensemble_ctrl.cli.progress.time.monotonic", lambda: next(now))
    stream = io.StringIO()
    progress = Progress(stream=stream)
    for count in range(12):
        progress("solve", Iteration(count, 1.0, 1e-3))
    assert [line.split(",")[0] for line in stream.getvalue().splitlines()] == [
        "solve: iteration 3",
        "solve: iteration 7",
        "solve: iteration 11",
    ]


def test_quiet_writes_nothing() -> None:
    assert shown(Screen(), quiet=True) == ""
    assert shown(io.StringIO(), quiet=True) == ""


def test_a_stream_that_is_gone_is_no_reason_to_fail() -> None:
    stream = io.StringIO()
    progress = Progress(verbose=True, stream=stream)
    stream.close()
    progress("solve", Iteration(0, 1.0, 1e-3))
    progress.finish()


def test_a_real_terminal(place: Path) -> None:
    ours, theirs = pty.openpty()
    done = subprocess.Popen(
        [*COMMAND, "small.yaml", "--no-plots"],
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=environment(TERM="xterm"),
    )
    os.close(theirs)
    seen = b""
    try:
        while block := os.read(ours, 4096):
            seen += block
    except OSError:
        pass  # the other side is closed
    out = done.communicate(timeout=30)[0]
    os.close(ours)
    assert done.returncode == 0
    assert b"\r\x1b[Ksolve" in seen
    assert b"\x1b" not in out
    assert seen.rstrip().split(b"\x1b[K")[-1].startswith(b"check ")


def test_a_reader_that_went_away(place: Path, results: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    for arguments in (["show", "results"], ["--help"]):
        done = subprocess.run(
            [*COMMAND, *arguments], cwd=place, stdout=writer, stderr=subprocess.PIPE, env=environment(), timeout=60
        )
        assert (done.returncode, done.stderr) == (0, b""), arguments
    os.close(writer)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_an_output_that_is_full(place: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, "models"], cwd=place, stdout=full, stderr=subprocess.PIPE, text=True, env=environment()
        )
    assert done.returncode == 1
    assert done.stderr == "error: output: No space left on device\n"


def test_names_that_the_terminal_can_not_show(place: Path) -> None:
    text = (place / "small.yaml").read_text().replace("block", "m\N{LATIN SMALL LETTER U WITH DIAERESIS}ll")
    (place / "small.yaml").write_text(text, encoding="utf-8")
    done = process("small.yaml", "--no-plots", "-q", cwd=place, PYTHONIOENCODING="ascii")
    assert done.code == 0, done.err
    assert "m\\xfcll" in done.out
