"""The text that is edited: its revisions, what is wrong with it, undo and redo, and its file.

The file's text is the only truth: every change from the map, the panel or the text pane is a change of that text, and
what the page shows is read from it again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Any

from ensemble_ctrl.api.edit.changes import changed
from ensemble_ctrl.api.edit.disk import Disk, DiskChangedError
from ensemble_ctrl.api.edit.shapes import shapes, start, starts, target
from ensemble_ctrl.api.edit.tasks import pieces
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ConfigError, EnsembleError
from ensemble_ctrl.files.config import Diagnostic
from ensemble_ctrl.files.config.load import parsed
from ensemble_ctrl.files.config.source import MAX_BYTES, Text
from ensemble_ctrl.files.config.tree import TextError, Tree
from ensemble_ctrl.problem import Problem

KEPT = 20_000_000
"""Characters of earlier texts that are kept for undo."""


class StaleError(EnsembleError):
    """A change of the whole text was made to an older one."""


@dataclass(frozen=True, eq=False)
class Checked:
    """A text, and what it says.

    Attributes
    ----------
    text : str
    problem : Problem or None
        None where there are errors.
    found : tuple of Diagnostic
        Errors and warnings, in the text's order.
    data : plain data or None
        None where the text is not YAML.
    """

    text: str
    problem: Problem | None
    found: tuple[Diagnostic, ...]
    data: Any


@dataclass(eq=False)
class Session:
    """One file that is edited, by one page or several.

    Parameters
    ----------
    disk : Disk
        Its file.
    trust : bool
        Whether to run the Python file that ``fleet.model`` may name.
    fresh : str, optional
        The text of a file that is not there yet.
    """

    disk: Disk
    trust: bool = False
    fresh: str | None = None
    revision: int = field(default=1, init=False)
    checked: Checked = field(init=False)
    listeners: list[Callable[[], None]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._lock = threading.RLock()
        self._before: list[str] = []
        self._after: list[str] = []
        self._group: str | None = None
        self._drawn: dict[str, Any] = {}
        self.saved = self.disk.read() if self.fresh is None else None
        self.checked = self._check(self.fresh or self.saved or "")

    @property
    def text(self) -> str:
        """The text as it is now."""
        return self.checked.text

    @property
    def dirty(self) -> bool:
        """Whether it differs from what was read or saved last."""
        return self.text != self.saved

    def edit(self, edits: Sequence[dict[str, Any]], group: str | None = None) -> None:
        """Change values in the text; see `ensemble_ctrl.api.edit.changes.changed`.

        Parameters
        ----------
        edits : sequence of dict
        group : str, optional
            Changes that follow each other under one name, as those of a drag, are one step for undo.

        Raises
        ------
        EnsembleError
            If one can't be made; then none is.
        """
        with self._lock:
            self._become(changed(self.text, edits), group)

    def replace(self, text: str, revision: int) -> None:
        """Another text as a whole.

        Raises
        ------
        StaleError
            If the text was changed since `revision`.
        """
        with self._lock:
            if revision != self.revision and text != self.text:
                raise StaleError("the text was changed elsewhere meanwhile; the newer one is shown")
            self._become(text, "text")

    def undo(self) -> None:
        """Back to the text before the last change, if there is one."""
        self._step(self._before, self._after)

    def redo(self) -> None:
        """Again what was undone last."""
        self._step(self._after, self._before)

    def save(self, force: bool = False) -> None:
        """Write the file as a whole or not at all.

        Raises
        ------
        DiskChangedError
            If it was changed on disk by someone else; with `force` it is overwritten.
        OSError
            If it can't be written.
        """
        with self._lock:
            self.disk.write(self.text, force)
            self.saved, self._group = self.text, None
        self._tell()

    def reload(self) -> None:
        """The text as it is on disk, as a change that can be undone."""
        with self._lock:
            self.saved = self.disk.read()
            self._become(self.saved, None)
        self._tell()

    def look(self) -> None:
        """Notice a file that was changed on disk: it is loaded if nothing is unsaved, and reported otherwise."""
        with self._lock:
            was = self.disk.changed
            if not self.disk.look() or was:
                return
            clean = not self.dirty and not self.disk.missing
        if clean:
            self.reload()
        else:
            self._tell()

    def state(self) -> dict[str, Any]:
        """What a page shows, as plain data."""
        with self._lock:
            now = self.checked
            if now.data is not None or not self._drawn:
                self._drawn = _drawn(now)
            return {
                "revision": self.revision,
                "text": now.text,
                "file": self.disk.path.name,
                "dirty": self.dirty,
                "disk": "missing" if self.disk.missing else "changed" if self.disk.changed else "same",
                "undo": bool(self._before),
                "redo": bool(self._after),
                "valid": now.problem is not None,
                "found": [_place(one) for one in now.found],
                "map": self._drawn,
            }

    def _step(self, source: list[str], other: list[str]) -> None:
        """Take a text from one stack, and keep this one on the other."""
        with self._lock:
            if not source:
                return
            other.append(self.text)
            self._group = None
            self._now(source.pop())
        self._tell()

    def _become(self, text: str, group: str | None) -> None:
        """A new text, kept for undo."""
        if len(text.encode("utf-8", "surrogatepass")) > MAX_BYTES:
            raise EnsembleError(f"expected a text of at most {MAX_BYTES // 1_000_000} MB, got more")
        if text == self.text:
            return
        if group is None or group != self._group:
            self._before.append(self.text)
            while sum(map(len, self._before)) > KEPT and len(self._before) > 1:
                del self._before[0]
        self._after.clear()
        self._group = group
        self._now(text)
        self._tell()

    def _now(self, text: str) -> None:
        """A text becomes the current one."""
        self.checked = self._check(text)
        self.revision += 1

    def _tell(self) -> None:
        """Let everyone know."""
        for listener in list(self.listeners):
            listener()

    def _check(self, text: str) -> Checked:
        """Read a text by all steps."""
        try:
            data = Tree.read(text).data
        except TextError:
            data = None
        try:
            loaded = parsed(Text(self.disk.path.name, text, self.disk.path.parent), (), self.trust)
        except ConfigError as error:
            return Checked(text, None, tuple(error.diagnostics), data)
        except EnsembleError as error:
            return Checked(text, None, (Diagnostic("", None, None, "error", "", str(error), ""),), data)
        return Checked(text, loaded.problem, loaded.warnings, data)


def _drawn(now: Checked) -> dict[str, Any]:
    """What of a text is drawn."""
    data = now.data if isinstance(now.data, dict) else {}
    problem = now.problem
    return {
        "name": str(data.get("name") or ""),
        "shapes": shapes(data, problem),
        "start": start(data),
        "starts": starts(data),
        "target": target(data),
        "pieces": pieces(data.get("task")),
        "data": data,
        "radius": 0.0 if problem is None else problem.fleet.radius,
        "duration": None if problem is None else problem.duration,
        "plane": problem is None or len(problem.fleet.places) != 1,
    }


def _place(one: Diagnostic) -> dict[str, Any]:
    """A diagnostic as plain data."""
    return {
        "line": one.line,
        "column": one.column,
        "severity": one.severity,
        "path": one.path,
        "message": one.message,
        "hint": one.hint,
    }


__all__ = ["Checked", "Disk", "DiskChangedError", "Session", "StaleError"]
