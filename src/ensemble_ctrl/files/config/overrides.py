"""``--set KEY=VALUE``: change a problem's data before it is validated."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import shortened
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.files.config.errors import show
from ensemble_ctrl.files.config.tree import Path, TextError, Tree

_KEY = re.compile(r"[^\s.\[\]]+(?:\.[^\s.\[\]]+|\[\d+\])*")

Given = str | tuple[str, str]
"""``KEY=VALUE``, or an option of the command such as ``--method`` and its ``KEY=VALUE``."""


@dataclass(frozen=True)
class Override:
    """One value that replaces what the file has at a path."""

    name: str
    path: Path
    value: Any


def name_of_override(given: Given) -> str:
    """What messages call an override: the option as it was typed."""
    return (
        f"--set {shortened(given)}" if isinstance(given, str) else f"{given[0]} {shortened(given[1].partition('=')[2])}"
    )


def parse_override(given: Given) -> Override:
    """Read ``KEY=VALUE``: a dotted path and a YAML value; or the name of an option, and what it sets.

    Raises
    ------
    TextError
        If there is no key, or the value is not YAML.

    Examples
    --------
    >>> parse_override("fleet.start.position[0]=2.5").path
    ('fleet', 'start', 'position', 0)
    """
    text = given[1] if isinstance(given, tuple) else given
    key, equals, value = expect("override", text, str, "KEY=VALUE").partition("=")
    if not equals or not _KEY.fullmatch(key.strip()):
        raise TextError("expected KEY=VALUE with dots in the key", hint="for example  fleet.radius=0.3")
    parts = re.findall(r"[^\s.\[\]]+", key)
    tree = Tree.read(value)
    if tree.repeated:
        raise TextError(f"{tree.repeated[0][0][-1]} is given twice")
    return Override(name_of_override(given), tuple(int(part) if part.isdigit() else part for part in parts), tree.data)


def apply(data: Any, overrides: Iterable[Override]) -> Any:
    """The data with the values put in; sections that don't exist are made, a value of nothing removes.

    Raises
    ------
    TextError
        If a path leads through something that is not a section or a list.
    """
    for override in overrides:
        data = _put(data, override.path, override.value)
    return data


def _put(data: Any, path: Path, value: Any) -> Any:
    """A copy of the data with one value put in."""
    if not path:
        return value
    key, *rest = path
    if isinstance(data, list):
        if not isinstance(key, int) or key >= len(data):
            raise TextError(f"expected a place from 0 to {len(data) - 1} in a list, got {key!r}")
        return [_put(item, tuple(rest), value) if i == key else item for i, item in enumerate(data)]
    if data is not None and not isinstance(data, dict):
        raise TextError(f"expected a section above {key!r}, got {show(data)}")
    changed = dict(data or {})
    changed[str(key)] = _put(changed.get(str(key)), tuple(rest), value)
    return {name: item for name, item in changed.items() if item is not None}
