"""Unknown keys and words of a problem file; what a validator raises is `FieldError`."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from ensemble_ctrl.core.errors import MOST_LETTERS
from ensemble_ctrl.problem.arguments.errors import FieldError, is_number, show


def only(keys: Iterable[Any], known: Iterable[str], path: tuple[str | int, ...] = ()) -> None:
    """No other keys than those known in a section at `path`.

    Raises
    ------
    FieldError
        About the first other one.
    """
    known = sorted(known)
    for key in sorted(str(key) for key in keys if key not in known):
        hint = suggestion(key, known) or f"known here: {', '.join(known)}"
        raise FieldError("unknown field", hint, (*path, key), on_key=True)


def suggestion(word: Any, known: Iterable[str]) -> str:
    """The known word most like this one, as a hint; empty if none is."""
    close = get_close_matches(str(word)[:MOST_LETTERS], list(known), n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else ""


__all__ = ["FieldError", "is_number", "only", "show", "suggestion"]
