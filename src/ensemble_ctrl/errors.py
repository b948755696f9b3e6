"""The errors a caller may catch, all children of `EnsembleError`."""

from __future__ import annotations

from typing import Any


class EnsembleError(Exception):
    """Base of every error this package raises on purpose."""


class ConfigError(EnsembleError):
    """A problem file is not what was wanted; the message has file, line and column.

    Attributes
    ----------
    diagnostics : tuple of ensemble_ctrl.config.Diagnostic
        The same errors one by one, for editors and JSON.
    """

    def __init__(self, message: str, diagnostics: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.diagnostics = diagnostics


class ProblemError(EnsembleError, ValueError):
    """A problem, or an argument, is not what was wanted; the message names it.

    Attributes
    ----------
    findings : tuple of ensemble_ctrl.checks.Finding
        What a check of the whole problem found, one by one; empty for a single argument.
    """

    findings: tuple[Any, ...] = ()


class SolveError(EnsembleError):
    """No plan was found; `plan` holds the last iterate so that it can be drawn."""

    def __init__(self, message: str, plan: object = None) -> None:
        super().__init__(message)
        self.plan = plan


class UnsupportedError(EnsembleError, NotImplementedError):
    """The request is well-formed but outside what the planner can do."""
