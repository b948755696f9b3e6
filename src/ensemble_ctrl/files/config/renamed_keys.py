"""Keys of a problem file that have another name today: read under the old one for one release, with a warning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ensemble_ctrl.files.config.overrides import Override
from ensemble_ctrl.files.config.tree import Path, Tree
from ensemble_ctrl.problem.checks import Finding

RENAMED: tuple[tuple[tuple[str, ...], str], ...] = (
    (("report", "twin"), "baseline"),
    (("fleet", "cloud"), "samples"),
    (("fleet", "parameters", "*", "law"), "distribution"),
)
"""The path of each old key and its new name; ``*`` is any keys, also none."""


def renamed_keys(tree: Tree) -> list[Finding]:
    """Give the keys of a file their new names, and warn of each.

    A key that is given under both names keeps them, and is refused as unknown under the old one.
    """
    paths = dict(_renamed(tree.data, ()))
    tree.data = _with_names(tree.data, (), paths)
    for places in (tree.keys, tree.values):
        moved = {_moved(path, paths): node for path, node in places.items()}
        places.clear()
        places.update(moved)
    return [_warning(old, _moved(old, paths)) for old in paths]


def renamed_overrides(changes: list[Override]) -> tuple[list[Override], list[Finding]]:
    """Overrides under the new names, with a warning of each old one."""
    changed, found = [], []
    for change in changes:
        above = {change.path[:n]: change.path[n - 1] for n in range(1, len(change.path) + 1)}
        paths = {old: new for old, key in above.items() if (new := _new_name(old[:-1], key)) is not None}
        below = dict(_renamed(change.value, change.path))
        found += [_warning(old, _moved(old, paths | below)) for old in paths | below]
        value = _with_names(change.value, change.path, below)
        changed.append(replace(change, path=_moved(change.path, paths), value=value))
    return changed, found


def _new_name(above: Path, key: str | int) -> str | None:
    """The new name of a key below a path; None if it has none."""
    for (*start, old), new in RENAMED:
        fixed = start[: start.index("*")] if "*" in start else start
        if key == old and list(above[: len(fixed)]) == fixed and ("*" in start or len(above) == len(fixed)):
            return new
    return None


def _renamed(data: Any, path: Path) -> Iterator[tuple[Path, str]]:
    """The path of every old key, in the order of the data, with its new name."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        new = _new_name(path, key)
        if new is not None and new not in data:
            yield (*path, key), new
        yield from _renamed(value, (*path, key))


def _with_names(data: Any, path: Path, paths: dict[Path, str]) -> Any:
    """A copy of the data with the new names."""
    if isinstance(data, dict):
        return {paths.get((*path, key), key): _with_names(value, (*path, key), paths) for key, value in data.items()}
    if isinstance(data, list):
        return [_with_names(value, (*path, i), paths) for i, value in enumerate(data)]
    return data


def _moved(path: Path, paths: dict[Path, str]) -> Path:
    """A path with the new names along it."""
    return tuple(paths.get(path[: n + 1], key) for n, key in enumerate(path))


def _warning(old: Path, new: Path) -> Finding:
    """The warning about an old key."""
    message = f"the key {old[-1]!r} is deprecated and goes with the next release"
    return Finding(new, message, f"write {new[-1]!r}", "warning", on_key=True)
