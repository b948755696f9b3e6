"""What goes where: results on stdout; what was wrong on stderr and, with ``--json``, as the object on stdout."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ensemble_ctrl.errors import ConfigError, EnsembleError


def say(text: str) -> None:
    """Write a result to stdout; a reader that went away is nobody's fault."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        silence()


def silence() -> None:
    """Send further output nowhere: Python flushes stdout once more at exit."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def complain(text: str) -> None:
    """Write to stderr, if there is one."""
    with suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


def fail(code: int, message: str, as_json: bool, diagnostics: Sequence[Any] = ()) -> int:
    """Say what was wrong; returns the exit code."""
    if as_json:
        from ensemble_ctrl.results import SCHEMA, to_json

        found = [diagnostic_data(item) for item in diagnostics]
        say(
            to_json(
                {
                    "schema": SCHEMA,
                    "status": "error",
                    "exit_code": code,
                    "message": message,
                    "diagnostics": found,
                }
            )
        )
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
