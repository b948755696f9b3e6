"""The errors a caller may catch, all children of `EnsembleError`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

MOST_LISTED = 20
"""Findings that a message lists; of further ones it gives the number."""

MOST_LETTERS = 60
"""Letters of a name that a message repeats."""

_LONG_WORD = re.compile(rf"[^\s,;]{{{MOST_LETTERS + 1},}}")


def shortened(text: str) -> str:
    """A name as a message repeats it.

    Examples
    --------
    >>> len(shortened("a" * 1000))
    60
    """
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 3]}..."


def with_short_words(text: str) -> str:
    """A message with each long name in it shortened."""
    return _LONG_WORD.sub(lambda word: shortened(word[0]), text)


def first_of(lines: Sequence[object]) -> list[str]:
    """The first lines of a long list, and how many more there are.

    Examples
    --------
    >>> first_of(range(22))[-2:]
    ['19', 'and 2 more']
    """
    rest = len(lines) - MOST_LISTED
    return [*map(str, lines[:MOST_LISTED]), *([f"and {rest} more"] if rest > 0 else [])]


class EnsembleError(Exception):
    """Base of every error this package raises on purpose."""


class ConfigError(EnsembleError):
    """A problem file is not what was wanted; the message has file, line and column.

    Attributes
    ----------
    diagnostics : tuple of ensemble_ctrl.files.config.Diagnostic
        The same errors one by one, for editors and JSON.
    """

    def __init__(self, message: str, diagnostics: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.diagnostics = diagnostics


class ProblemError(EnsembleError, ValueError):
    """A problem, or an argument, is not what was wanted; the message names it.

    Attributes
    ----------
    findings : tuple of ensemble_ctrl.problem.checks.Finding
        What a check of the whole problem found, one by one; empty for a single argument.
    """

    findings: tuple[Any, ...] = ()


class RunawayError(ProblemError):
    """States under some controls leave all bounds, or change too fast for their accuracy to be known.

    Attributes
    ----------
    what : str
        Which state does what, when and for whom.
    parameters : dict of str to float
        Of the member.
    time : float
        Seconds.
    """

    def __init__(self, message: str, what: str, parameters: dict[str, float], time: float) -> None:
        super().__init__(message)
        self.what, self.parameters, self.time = what, parameters, time

    def __reduce__(self) -> tuple[Any, ...]:
        """All arguments: an error is made again from its message alone otherwise."""
        return type(self), (str(self), self.what, self.parameters, self.time)


class SolveError(EnsembleError):
    """No plan was found; `plan` holds the last iterate, and a notebook draws it with the message."""

    def __init__(self, message: str, plan: object = None) -> None:
        super().__init__(message)
        self.plan = plan

    def _repr_html_(self) -> str:
        """The message above the card of the plan that fell short."""
        from html import escape

        card = getattr(self.plan, "_repr_html_", None)
        return f"<div><p><b>{escape(str(self))}</b></p>{card() if card else ''}</div>"

    def _render_traceback_(self) -> list[str]:
        """What IPython prints in place of a traceback: nothing is broken, so the card is shown and the message said."""
        try:
            from IPython.display import HTML, display
        except ImportError:  # some other shell that knows this method
            return [f"{type(self).__name__}: {self}"]
        display(HTML(self._repr_html_()))  # type: ignore[no-untyped-call]
        return [f"{type(self).__name__}: {self}", "(the exception's plan attribute holds what is drawn)"]


class WorkerError(EnsembleError):
    """A process that was given a part of the work ended without a result; the message says how."""


class UnsupportedError(EnsembleError, NotImplementedError):
    """The request is well-formed but outside what the planner can do."""
