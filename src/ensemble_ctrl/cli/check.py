"""``ensemble-plan check``: read problem files and say what is wrong, without loading a solver."""

from __future__ import annotations

from collections.abc import Sequence

from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.streams import complain, diagnostic_data, say
from ensemble_ctrl.core.errors import ConfigError, first_of
from ensemble_ctrl.files.config import Diagnostic, read

Report = tuple[str, ConfigError | None, tuple[Diagnostic, ...]]


def check_files(names: Sequence[str], as_json: bool, quiet: bool, overrides: Sequence[str] = ()) -> int:
    """Check every file, with some fields changed; returns 0, or 2 if any can't be used."""
    reports = [_check(name, overrides) for name in names]
    good = all(error is None for _, error, _ in reports)
    code = codes.OK if good else codes.USAGE
    if as_json:
        from ensemble_ctrl.api.results import SCHEMA, to_json

        files = [_as_data(report) for report in reports]
        say(to_json({"schema": SCHEMA, "ok": good, "exit_code": code, "files": files}))
        return code
    for report in reports:
        _say(*report, quiet)
    return code


def _check(name: str, overrides: Sequence[str]) -> Report:
    """The error of one file, if any, and its warnings."""
    try:
        return name, None, read(name, overrides).warnings
    except ConfigError as error:
        return name, error, ()


def _say(name: str, error: ConfigError | None, warnings: Sequence[Diagnostic], quiet: bool) -> None:
    """Errors and warnings on stderr, a line for a good file on stdout."""
    if not quiet:
        for line in first_of(warnings):
            complain(line)
    if error is not None:
        complain(str(error))
    elif not quiet:
        count = len(warnings)
        say(f"{name}: ok" + (f" ({count} warning{'s' * (count > 1)})" if warnings else ""))


def _as_data(report: Report) -> dict[str, object]:
    """One file's report as plain data."""
    name, error, warnings = report
    found = [*(error.diagnostics if error else ()), *warnings]
    return {"file": name, "ok": error is None, "diagnostics": [diagnostic_data(item) for item in found]}
