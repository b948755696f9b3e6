"""``ensemble-plan check``: read problem files and say what is wrong, without loading a solver."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from ensemble_ctrl.cli import codes
from ensemble_ctrl.config import Diagnostic, read
from ensemble_ctrl.errors import ConfigError


def check_files(names: Sequence[str], as_json: bool, quiet: bool) -> int:
    """Check every file; returns 0, or 2 if any can't be used."""
    reports = [_check(name) for name in names]
    good = all(error is None for _, error, _ in reports)
    if as_json:
        from ensemble_ctrl.results import SCHEMA, to_json

        print(to_json({"schema": SCHEMA, "ok": good, "files": [_as_data(report) for report in reports]}))
    else:
        for name, error, warnings in reports:
            _say(name, error, warnings, quiet)
    return codes.OK if good else codes.USAGE


Report = tuple[str, ConfigError | None, tuple[Diagnostic, ...]]


def _check(name: str) -> Report:
    """The error of one file, if any, and its warnings."""
    try:
        return name, None, read(name).warnings
    except ConfigError as error:
        return name, error, ()


def _say(name: str, error: ConfigError | None, warnings: Sequence[Diagnostic], quiet: bool) -> None:
    """Errors and warnings on stderr, a line for a good file on stdout."""
    for warning in warnings:
        print(warning, file=sys.stderr)
    if error is not None:
        print(error, file=sys.stderr)
    elif not quiet:
        print(f"{name}: ok" + (f" ({len(warnings)} warning(s))" if warnings else ""))


def _as_data(report: Report) -> dict[str, object]:
    """One file's report as plain data."""
    name, error, warnings = report
    found = [*(error.diagnostics if error else ()), *warnings]
    return {
        "file": name,
        "ok": error is None,
        "diagnostics": [
            {
                "line": d.line,
                "column": d.column,
                "severity": d.severity,
                "path": d.path,
                "message": d.message,
                "hint": d.hint,
            }
            for d in found
        ],
    }
