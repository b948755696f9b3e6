"""From a finding's path to the line and column in the file, or to the ``--set``, that it is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from yaml.nodes import SequenceNode

from ensemble_ctrl.files.config.messages import Diagnostic
from ensemble_ctrl.files.config.overrides import Override
from ensemble_ctrl.files.config.source import Text
from ensemble_ctrl.files.config.tree import Place, Tree, indices, place_at, start
from ensemble_ctrl.problem.checks import Finding, Path, path_text


class Locator:
    """Gives findings their place.

    Parameters
    ----------
    text : Text
        The file.
    tree : Tree
        The places of its keys and values.
    data
        The file's data with the overrides in it.
    overrides : sequence of Override
        What was changed.
    """

    def __init__(self, text: Text, tree: Tree, data: Any, overrides: Sequence[Override]) -> None:
        self._text, self._tree, self._data, self._overrides = text, tree, data, overrides
        self._lines = text.content.split("\n")
        self._indices: dict[Path, list[int]] = {}

    def __call__(self, finding: Finding) -> Diagnostic:
        """The finding with its place."""
        path = self._in_file(finding.path)
        for override in reversed(self._overrides):
            if self._is_cause(override.path, path):
                return _diagnostic(finding, path, override.name, None, "")
        return self._placed(finding, path, self._place(finding, path))

    def _is_cause(self, changed: Path, path: Path) -> bool:
        """Whether the value at a path, or an item of the list there, was changed."""
        if path[: len(changed)] == changed:
            return True
        values = self._tree.values.get(path)
        return isinstance(values, SequenceNode) and changed[: len(path)] == path

    def repeated(self) -> list[Diagnostic]:
        """Every key that is given twice."""
        return [
            self._placed(Finding(path, f"given twice, first on line {line}", "remove one of them"), path, place)
            for path, line, place in self._tree.repeated
        ]

    def order(self, diagnostic: Diagnostic) -> tuple[bool, int, int]:
        """Sort key of the file's order; what came by ``--set`` is last."""
        return diagnostic.line is None, diagnostic.line or 0, diagnostic.column or 0

    def _placed(self, finding: Finding, path: Path, place: Place) -> Diagnostic:
        """A diagnostic at a place of the file."""
        return _diagnostic(finding, path, self._text.name, place, self._lines[place.line - 1])

    def _place(self, finding: Finding, path: Path) -> Place:
        """The value's place; the key's for a key, or for a field that is missing in a section."""
        values, keys = self._tree.values, self._tree.keys
        if path in keys and (path not in values or finding.on_key):
            return start(keys[path])
        if path in values:
            node = values[path]
            return start(node) if finding.offset is None else self._within(path, finding.offset)
        while path and path not in values:
            path = path[:-1]
        return start(keys[path] if path in keys else values[()])

    def _within(self, path: Path, offset: int) -> Place:
        """The place of a character of the value at a path; the value's start if that is not known."""
        content, node = self._text.content, self._tree.values[path]
        if path not in self._indices:
            self._indices[path] = indices(content, node)
        found = self._indices[path]
        return place_at(content, found[min(offset, len(found) - 1)]) if found else start(node)

    def _in_file(self, path: Path) -> Path:
        """The path without the places of lists that the file doesn't have (one shape is a list of one)."""
        kept: list[str | int] = []
        data = self._data
        for key in path:
            if isinstance(key, int) and not isinstance(data, list):
                continue
            kept.append(key)
            try:
                data = data[key]
            except (KeyError, IndexError, TypeError):
                data = None
        return tuple(kept)


def _diagnostic(finding: Finding, path: Path, source: str, place: Place | None, excerpt: str) -> Diagnostic:
    """A finding in its final form."""
    line, column = (place.line, place.column) if place else (None, None)
    return Diagnostic(source, line, column, finding.severity, path_text(path), finding.message, finding.hint, excerpt)
