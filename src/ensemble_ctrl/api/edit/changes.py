"""Changes that a page asks for, made to the text of a problem file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ensemble_ctrl.api.edit.tasks import task_of, with_renamed, without_place
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config.splice import put, removed, renamed
from ensemble_ctrl.files.config.tree import Path, TextError, Tree

MOST = 1000
"""Changes in one request."""
DEEP = 20
"""Keys of a path at most."""
PLACES = ("obstacles", "regions", "zones", "terrain")
"""Sections of places with names, which a task may use."""


class ChangeError(EnsembleError):
    """A change is not one, or can't be made."""


def changed(text: str, edits: Sequence[dict[str, Any]]) -> str:
    """The text after some changes, in their order.

    Parameters
    ----------
    text : str
    edits : sequence of dict
        Each with ``do``: ``put`` a ``value`` at a ``path``; ``text``: the same with the value as YAML; ``remove`` what
        is at a ``path``; ``rename`` the place at a ``path`` to a ``name``, also in the task; ``task`` of ``pieces``.

    Raises
    ------
    EnsembleError
        If one can't be made.
    """
    if not isinstance(edits, list) or len(edits) > MOST:
        raise ChangeError(f"edits: expected a list of at most {MOST} changes")
    for edit in edits:
        text = _one(text, edit)
    return text


def _one(text: str, edit: Any) -> str:
    """One change."""
    if not isinstance(edit, dict):
        raise ChangeError(f"edits: expected sections, got {type(edit).__name__}")
    match edit.get("do"):
        case "put":
            return put(text, _path(edit), _value(edit.get("value")))
        case "text":
            return put(text, _path(edit), _yaml(edit.get("value")))
        case "remove":
            return _removed(text, _path(edit))
        case "rename":
            return _renamed(text, _path(edit), edit.get("name"))
        case "task":
            return put(text, ("task",), task_of(_pieces(edit.get("pieces"))))
    raise ChangeError(f"edits.do: expected put, text, remove, rename or task, got {edit.get('do')!r}")


def _removed(text: str, path: Path) -> str:
    """Take out an entry; a place is taken out of the task's own pieces too."""
    text = removed(text, path)
    if len(path) == 2 and path[0] in PLACES:
        shorter = without_place(_data(text).get("task"), str(path[1]))
        text = text if shorter is None else put(text, ("task",), shorter)
        if path[1] in (_data(text).get("motions") or {}):
            text = removed(text, ("motions", path[1]))
    return text


def _renamed(text: str, path: Path, name: Any) -> str:
    """Another name for a place, wherever the file names it."""
    if not isinstance(name, str) or len(path) != 2 or path[0] not in PLACES:
        raise ChangeError("rename: expected the path of a region or an obstacle, and a name")
    text = renamed(text, path, name)
    data, old = _data(text), str(path[1])
    task = with_renamed(data.get("task"), old, name)
    if task != data.get("task"):
        text = put(text, ("task",), task)
    if old in (data.get("motions") or {}):
        text = renamed(text, ("motions", old), name)
    for i, ignored in enumerate(data.get("ignore") or []):
        text = put(text, ("ignore", i), name) if ignored == old else text
    return text


def _path(edit: dict[str, Any]) -> Path:
    """The path of a change."""
    path = edit.get("path")
    good = isinstance(path, list) and 0 < len(path) <= DEEP
    if not good or not all(isinstance(key, str | int) and not isinstance(key, bool) for key in path or ()):
        raise ChangeError(f"edits.path: expected keys and places in lists, got {path!r}")
    return tuple(path or ())


def _value(value: Any) -> Any:
    """Plain data with finite numbers; whole ones as such, and others to a nanometre."""
    if isinstance(value, dict):
        return {str(key): _value(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_value(item) for item in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ChangeError(f"edits.value: expected finite numbers, got {value}")
        return round(value, 9) + 0.0
    if value is None:
        raise ChangeError("edits.value: expected a value, got nothing")
    return value


def _yaml(value: Any) -> Any:
    """A value typed into a field."""
    try:
        data = Tree.read(str(value)).data
    except TextError as error:
        raise ChangeError(f"{value}: {error.message}") from None
    if data is None:
        raise ChangeError("expected a value, got nothing")
    return data


def _pieces(pieces: Any) -> list[dict[str, Any]]:
    """The pieces of a task."""
    if not isinstance(pieces, list) or not pieces or not all(isinstance(piece, dict) for piece in pieces):
        raise ChangeError("task: expected at least one piece")
    return pieces


def _data(text: str) -> dict[str, Any]:
    """What a text holds."""
    found = Tree.read(text).data
    return found if isinstance(found, dict) else {}
