"""The task as pieces that one clicks: visit, stay, avoid, each in a window; and back as a formula."""

from __future__ import annotations

import re
from typing import Any

from ensemble_ctrl.constraints.stl import conjuncts, parse
from ensemble_ctrl.core.errors import EnsembleError

KINDS = {"visit": ("F", "in"), "stay": ("G", "in"), "avoid": ("G", "avoid")}
"""Operator and leaf of each kind of piece."""
_PIECE = re.compile(r"([FG])(?:\[([^\[\]]+)\])? (in|avoid)\(([^()]+)\)")
_SIDE = re.compile(r"[\w .*/+-]+")


def pieces(task: Any) -> list[dict[str, Any]] | None:
    """The parts of a task that all have to hold.

    Parameters
    ----------
    task : str
        A formula.

    Returns
    -------
    list of dict or None
        ``kind`` (visit, stay, avoid, other), ``place``, ``window`` (``[from, to]`` as texts, or None for the whole
        horizon), ``text``; None where the task is no formula.

    Examples
    --------
    >>> [piece["kind"] for piece in pieces("F[14, 16] in(goal) and G avoid(obstacles) and x <= 3")]
    ['visit', 'avoid', 'other']
    """
    try:
        return [_piece(str(part)) for part in conjuncts(parse(task))]
    except (EnsembleError, ValueError, TypeError, AttributeError):
        return None


def task_of(parts: list[dict[str, Any]]) -> str:
    """The formula of pieces; see `pieces`.

    Raises
    ------
    EnsembleError
        For a piece that is none.

    Examples
    --------
    >>> task_of([{"kind": "visit", "place": "goal", "window": ["2", "4 s"]}, {"kind": "other", "text": "x <= 3"}])
    'F[2, 4 s] in(goal) and (x <= 3)'
    """
    return " and ".join(_text(part) for part in parts)


def without_place(task: Any, name: str) -> str | None:
    """The task without the pieces about one place; None where nothing of it would be left, or it is not in pieces."""
    parts = pieces(task)
    if parts is None:
        return None
    left = [part for part in parts if part["place"] != name]
    return task_of(left) if left and len(left) < len(parts) else None


def with_renamed(task: Any, old: str, new: str) -> Any:
    """The task with another name for a place."""
    pattern = re.compile(rf"(\b(?:in|avoid)\(\s*){re.escape(old)}(\s*\))")
    return pattern.sub(lambda found: found[1] + new + found[2], task) if isinstance(task, str) else task


def _piece(text: str) -> dict[str, Any]:
    """One part."""
    match = _PIECE.fullmatch(text)
    kinds = {pair: kind for kind, pair in KINDS.items()}
    kind = kinds.get((match[1], match[3]), "other") if match else "other"
    if match is None or kind == "other":
        return {"kind": "other", "place": None, "window": None, "text": text}
    window = [side.strip() for side in match[2].split(",")] if match[2] else None
    return {"kind": kind, "place": match[4], "window": window, "text": text}


def _text(part: dict[str, Any]) -> str:
    """One part as a formula."""
    kind = part.get("kind")
    if kind not in KINDS:
        text = str(part.get("text", ""))
        parse(text)
        return text if _PIECE.fullmatch(text) or " " not in text else _bracketed(text)
    operator, leaf = KINDS[kind]
    window = part.get("window")
    if window is not None and not all(_SIDE.fullmatch(str(side)) for side in window):
        raise EnsembleError(f"window: expected two times such as 14 and 16, or T, got {window}")
    shown = f"[{', '.join(map(str, window))}]" if window else ""
    return f"{operator}{shown} {leaf}({part.get('place')})"


def _bracketed(text: str) -> str:
    """A part whose operators bind more loosely than `and` in brackets."""
    return f"({text})" if len(conjuncts(parse(f"{text} and true"))) != 2 or " or " in text or "=>" in text else text
