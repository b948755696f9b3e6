"""Terminals, pipes and closed pipes."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
from pathlib import Path

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli.progress import Progress
from ensemble_ctrl.ocp.solvers import Iteration
from tests.examples import quick

from .tools import COMMAND, Outcome, environment, process

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
    assert re.match(r"check \d+\.\d\d s, solve \d+\.\d\d s", text.split(REWRITE)[-1])


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
    assert done.stderr == "error: standard output can't be written (No space left on device)\n"


def test_names_that_the_terminal_can_not_show(place: Path) -> None:
    text = (place / "small.yaml").read_text().replace("block", "m\N{LATIN SMALL LETTER U WITH DIAERESIS}ll")
    (place / "small.yaml").write_text(text, encoding="utf-8")
    done = process("small.yaml", "--no-plots", "-q", cwd=place, PYTHONIOENCODING="ascii")
    assert done.code == 0, done.err
    assert "m\\xfcll" in done.out


def redirected(place: Path, text: str, **changes: str) -> Outcome:
    """Run a shell's line in which ``CMD`` is the command."""
    line = text.replace("CMD", f"'{COMMAND[0]}' -m ensemble_ctrl.cli")
    done = subprocess.run(
        ["sh", "-c", line], cwd=place, capture_output=True, text=True, env=environment(**changes), timeout=60
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize(("stream", "reason"), [("/dev/full", "No space left on device"), ("&-", "it is closed")])
@pytest.mark.parametrize("form", quick(["", "--json"], "--json"))
def test_a_result_that_can_not_be_said_is_kept(place: Path, stream: str, reason: str, form: str) -> None:
    done = redirected(place, f"CMD small.yaml -q --no-plots {form} >{stream}")
    assert done.code == 1
    assert done.err == f"error: standard output can't be written ({reason}); the results are in plans/small\n"
    assert ec.Plan.load(place / "plans/small").status == "planned"


def test_every_command_says_that_its_output_is_lost(place: Path) -> None:
    for arguments in ("check small.yaml", "check no.yaml --json", "examples", "schema", "--help", "models"):
        done = redirected(place, f"CMD {arguments} >/dev/full")
        assert done.code in (1, 2), arguments
        assert "No space left on device" in done.err or "no.yaml" in done.err, arguments
        assert "Traceback" not in done.err, arguments
        assert "Exception ignored" not in done.err, arguments


@pytest.mark.parametrize("stream", quick(["2>&-", "2>/dev/full", "<&- 2>&-"], "<&- 2>&-"))
def test_without_a_place_for_messages_there_is_a_plan(place: Path, stream: str) -> None:
    done = redirected(place, f"CMD small.yaml --no-plots --json {stream}")
    assert done.code == 0
    assert done.data["folder"] == "plans/small"
    text = (place / "plans/small/controls.csv").read_text()
    assert text.startswith("t [s],v [m/s],omega [rad/s]\n0.0,")


def test_a_closed_stdin_is_said(place: Path) -> None:
    done = redirected(place, "CMD check - <&-")
    assert done.code == 2
    assert "<stdin>: error: standard input is closed" in done.err


def test_no_name_steers_the_terminal(place: Path) -> None:
    name = "a\x1b[31mb\x9b2J\u202ec.yaml"
    done = redirected(place, 'CMD check "$NAME"; CMD show "$NAME"', NAME=name)
    assert "a\\x1b[31mb\\x9b2J\\u202ec.yaml" in done.err
    for text in (done.out, done.err):
        assert not set(text) & {"\x1b", "\x9b", "\u202e"}
    stream = Screen()
    Progress(stream=stream).note(f"warning: {name}")
    assert stream.getvalue() == "warning: a\\x1b[31mb\\x9b2J\\u202ec.yaml\n"


def test_names_that_are_no_utf_8(place: Path) -> None:
    os.rename("small.yaml", b"m\xfcll.yaml")
    done = subprocess.run(
        [*COMMAND, b"m\xfcll.yaml", "-q", "-o", b"\xfcber"],
        cwd=place,
        capture_output=True,
        env=environment(LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0"),
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"files      \\udcfcber" in done.stdout
    found = os.listdir(b"\xfcber")
    assert {b"report.html", b"plan.npz", b"provenance.json", b"trajectories.png"} <= set(found)
