"""What goes where: results on stdout; what was wrong on stderr and, with ``--json``, as the object on stdout."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ensemble_ctrl.core.errors import ConfigError, EnsembleError
from ensemble_ctrl.core.plain import visible


class OutputError(EnsembleError):
    """Standard output can't be written."""


def say(text: str, kept: str | None = None) -> None:
    """Write a result to stdout; a reader that went away is nobody's fault.

    Parameters
    ----------
    text : str
        The result; marks that would steer a terminal are written as escapes.
    kept : str, optional
        Where the result is kept, in case it can't be said.

    Raises
    ------
    OutputError
        If stdout is closed, or its disk is full.
    """
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, "it is closed")
        print(visible(text), flush=True)
    except BrokenPipeError:
        silence()
    except OSError as error:
        silence()
        where = "" if kept is None else f"; the results are in {kept}"
        raise OutputError(f"standard output can't be written ({error.strerror or error}){where}") from None


def silence() -> None:
    """Send further output nowhere: Python flushes stdout once more at exit."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def keep_standard_streams() -> None:
    """Put nothing in the place of closed streams: else a file that is opened later gets their number, and what
    libraries write there.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def complain(text: str) -> None:
    """Write to stderr, if there is one."""
    with suppress(OSError, ValueError):
        print(visible(text), file=sys.stderr, flush=True)


def fail(code: int, message: str, as_json: bool, diagnostics: Sequence[Any] = ()) -> int:
    """Say what was wrong; returns the exit code."""
    if as_json:
        from ensemble_ctrl.api.results import SCHEMA, to_json

        found = [diagnostic_data(item) for item in diagnostics]
        facts = {"schema": SCHEMA, "status": "error", "exit_code": code, "message": message, "diagnostics": found}
        with suppress(OutputError):  # stderr has it, too
            say(to_json(facts))
    complain(message if diagnostics else f"error: {message}")
    return code


def fail_with(code: int, error: EnsembleError, as_json: bool) -> int:
    """Say what an error of ours says."""
    return fail(code, str(error), as_json, error.diagnostics if isinstance(error, ConfigError) else ())


def diagnostic_data(item: Any) -> dict[str, object]:
    """One diagnostic as plain data."""
    return {
        "source": item.source,
        "line": item.line,
        "column": item.column,
        "severity": item.severity,
        "path": item.path,
        "message": item.message,
        "hint": item.hint,
    }
