"""Change values of a problem file in place: every other character of the text stays, comments and layout included.

The places of the values come from the composed nodes (`tree`). Each change is read back and compared with what was
wanted, so that a text in which a place can't be changed by itself (aliases, tags) is refused and never damaged.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Any

from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config.tree import SCALARS, Path, TextError, Tree
from ensemble_ctrl.problem.checks import path_text

_PLAIN = re.compile(r"[\w.][\w .+*/°-]*")
_STEP = 2
"""Spaces of a new section's indentation."""
Key = str | int


class SpliceError(EnsembleError):
    """A value can't be changed by itself; the text stays as it was."""


def put(text: str, path: Path, value: Any) -> str:
    r"""The text with a value at a path: in the place of the one there, or as a new entry with the sections above it.

    Parameters
    ----------
    text : str
        YAML.
    path : tuple of str or int
        Keys and places in lists; a list's length is the place behind its end.
    value : plain data
        Mappings, lists, texts, finite numbers, booleans.

    Raises
    ------
    SpliceError
        If the text is not YAML, or only this value can't be changed.

    Examples
    --------
    >>> put("a: {b: [1, 2]}  # two numbers\n", ("a", "b", 1), 2.5)
    'a: {b: [1, 2.5]}  # two numbers\n'
    >>> put("a:\n  b: 1\n", ("a", "c"), {"d": "45 deg"})
    'a:\n  b: 1\n  c: {d: 45 deg}\n'
    """
    tree = _read(text)
    changed = _put(text, tree, path, value)
    return _checked(changed, _with(tree.data, path, value), path)


def removed(text: str, path: Path) -> str:
    r"""The text without the entry at a path, and without sections that held nothing else.

    Raises
    ------
    SpliceError
        If there is no such entry, or it can't be taken out by itself.

    Examples
    --------
    >>> removed("a: {b: 1, c: 2}\n", ("a", "b"))
    'a: {c: 2}\n'
    """
    tree = _read(text)
    if not path or path not in tree.values:
        raise SpliceError(f"{path_text(path)}: expected an entry of the file, got none of that name")
    while len(path) > 1 and len(tree.values[path[:-1]].value) == 1:
        path = path[:-1]
    return _checked(_removed(text, tree, path), _without(tree.data, path), path)


def renamed(text: str, path: Path, name: str) -> str:
    """The text with another key for the entry at a path.

    Raises
    ------
    SpliceError
        If there is no such entry, its section has the other key already, or the key can't be changed by itself.
    """
    tree = _read(text)
    if path not in tree.keys or (*path[:-1], name) in tree.keys:
        raise SpliceError(f"{path_text(path)}: expected the name of one entry, and a new one, got {name!r}")
    node = tree.keys[path]
    changed = text[: node.start_mark.index] + _scalar(name) + text[node.end_mark.index :]
    section = _at(tree.data, path[:-1])
    wanted = {name if key == path[-1] else key: item for key, item in section.items()}
    return _checked(changed, _with(tree.data, path[:-1], wanted) if path[:-1] else wanted, path)


def _read(text: str) -> Tree:
    """The text as data with places."""
    try:
        tree = Tree.read(text)
    except TextError as error:
        where = f" (line {error.place.line})" if error.place else ""
        raise SpliceError(f"the text is {error.message}{where}; it has to be mended first") from None
    if tree.repeated or not isinstance(tree.data, dict | None):
        raise SpliceError("expected a problem file with each key once")
    return tree


def _checked(after: str, wanted: Any, path: Path) -> str:
    """The new text, if it holds what was wanted and nothing else."""
    try:
        found = Tree.read(after)
    except TextError:
        found = None
    if found is None or found.repeated or (found.data or {}) != wanted:
        raise SpliceError(f"{path_text(path)}: this place can't be changed by itself; change the text instead")
    return after


def _put(text: str, tree: Tree, path: Path, value: Any) -> str:
    """Replace or insert; where both are sections or lists of one length, only what differs."""
    if path not in tree.values:
        return _inserted(text, tree, path, value)
    here = _at(tree.data, path)
    if isinstance(here, dict) and isinstance(value, dict) and here and value:
        return _each(text, path, here, value)
    if isinstance(here, list) and isinstance(value, list) and len(here) == len(value) and here:
        for i, item in enumerate(value):
            if not _same(here[i], item):
                text = put(text, (*path, i), item)
        return text
    node = tree.values[path]
    first, end = node.start_mark.index, _end(node)
    space = "" if end > first or not first or text[first - 1].isspace() else " "
    return text[:first] + space + flow(value) + text[end:]


def _each(text: str, path: Path, here: dict[str, Any], value: dict[str, Any]) -> str:
    """One section's entries, those that differ; what is new is there before what is gone is taken out."""
    for key, item in value.items():
        if key not in here or not _same(here[key], item):
            text = put(text, (*path, key), item)
    for key in here:
        if key not in value:
            text = removed(text, (*path, key))
    return text


def _same(one: Any, other: Any) -> bool:
    """Whether two data are equal, true and 1 apart."""
    return bool(one == other) and isinstance(one, bool) == isinstance(other, bool)


def _inserted(text: str, tree: Tree, path: Path, value: Any) -> str:
    """A new entry behind the last one of the deepest section that is there, with the sections between."""
    depth = next(n for n in range(len(path) - 1, -1, -1) if path[:n] in tree.values or not n)
    above, key = path[:depth], path[depth]
    for missing in reversed(path[depth + 1 :]):
        value = {str(missing): value} if isinstance(missing, str) else [value]
    node = tree.values.get(above)
    if not above and (node is None or not node.value):
        return text + ("" if not text or text.endswith("\n") else "\n") + _entry(str(key), value, 0) + "\n"
    if isinstance(node, ScalarNode) and _at(tree.data, above) is None:
        return _put(text, tree, above, {str(key): value})
    if isinstance(node, MappingNode) and isinstance(key, str):
        return _into_section(text, node, key, value)
    if isinstance(node, SequenceNode) and key == len(node.value):
        return _into_list(text, node, value)
    raise SpliceError(f"{path_text(path)}: expected a place in a section or a list, got none there")


def _into_section(text: str, node: MappingNode, key: str, value: Any) -> str:
    """A new key behind the last one of a section."""
    if node.flow_style:
        return _before_bracket(text, node, f"{_scalar(key)}: {flow(value)}")
    first, last = node.value[0][0], node.value[-1][1]
    indent = first.start_mark.column
    return _new_line(text, _end(last), " " * indent + _entry(key, value, indent))


def _into_list(text: str, node: SequenceNode, value: Any) -> str:
    """A new item behind the last one of a list."""
    if node.flow_style or not node.value:
        return _before_bracket(text, node, flow(value))
    line = text.rfind("\n", 0, node.value[-1].start_mark.index) + 1
    dash = text.index("-", line)
    return _new_line(text, _end(node.value[-1]), f"{' ' * (dash - line)}- {flow(value)}")


def _before_bracket(text: str, node: MappingNode | SequenceNode, entry: str) -> str:
    """An entry at the end of a list or section in brackets."""
    if not node.value:
        first = node.start_mark.index + 1
        return text[:first] + entry + text[node.end_mark.index - 1 :]
    last = node.value[-1][1] if isinstance(node, MappingNode) else node.value[-1]
    return text[: _end(last)] + ", " + entry + text[_end(last) :]


def _new_line(text: str, after: int, line: str) -> str:
    """A line behind the one that ends, or goes on with a comment, after a place."""
    end = text.find("\n", after)
    return f"{text}\n{line}\n" if end < 0 else f"{text[: end + 1]}{line}\n{text[end + 1 :]}"


def _removed(text: str, tree: Tree, path: Path) -> str:
    """Take out one entry of a section or a list."""
    above = tree.values[path[:-1]]
    assert isinstance(above, MappingNode | SequenceNode)
    first = (tree.keys if path in tree.keys else tree.values)[path].start_mark.index
    end = _end(tree.values[path])
    pairs = [pair if isinstance(pair, tuple) else (pair, pair) for pair in above.value]
    place = next(i for i, (key, _) in enumerate(pairs) if key.start_mark.index == first)
    if above.flow_style:
        if place + 1 < len(pairs):  # up to the next entry
            return text[:first] + text[pairs[place + 1][0].start_mark.index :]
        before = _end(pairs[place - 1][1]) if place else first
        return text[:before] + text[end:]
    line = text.rfind("\n", 0, first) + 1
    if text[line:first].strip(" -") or (isinstance(above, MappingNode) and "-" in text[line:first]):
        raise SpliceError(f"{path_text(path)}: this entry shares its line with another; change the text instead")
    stop = text.find("\n", end)
    return text[:line] + ("" if stop < 0 else text[stop + 1 :])


def _end(node: Node) -> int:
    """Where the text of a node ends, without the comments and empty lines that the parser counts to it."""
    if isinstance(node, ScalarNode):
        # a text in lines of its own ends where what follows starts
        return int(node.end_mark.index) - (node.style in ("|", ">"))
    assert isinstance(node, MappingNode | SequenceNode)
    if node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def flow(value: Any) -> str:
    """Plain data as YAML on one line.

    Examples
    --------
    >>> flow({"box": [[0, 1.5], [2, 3]], "name": "a: b"})
    '{box: [[0, 1.5], [2, 3]], name: "a: b"}'
    """
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_scalar(str(key))}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    """One value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        if not math.isfinite(value):
            raise SpliceError(f"expected a finite number, got {value}")
        return repr(value)
    if not isinstance(value, str):
        raise SpliceError(f"expected a text, a number, a list or a section, got {value!r}")
    known = any(pattern.match(value) for _, pattern in SCALARS)
    plain = _PLAIN.fullmatch(value) and not known and value == value.strip()
    return value if plain else json.dumps(value, ensure_ascii=False)


def _entry(key: str, value: Any, indent: int) -> str:
    """A new entry of a section in lines; a section of sections has a line for each."""
    if isinstance(value, dict) and value and all(isinstance(item, dict) for item in value.values()):
        below = "\n".join(f"{' ' * (indent + _STEP)}{_scalar(str(k))}: {flow(item)}" for k, item in value.items())
        return f"{_scalar(key)}:\n{below}"
    return f"{_scalar(key)}: {flow(value)}"


def _at(data: Any, path: Sequence[Key]) -> Any:
    """What is at a path; None without anything."""
    for key in path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _with(data: Any, path: Path, value: Any) -> Any:
    """A copy of the data with a value put in."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(key, int):
        items = list(data or [])
        items[key : key + 1] = [_with(items[key] if key < len(items) else None, rest, value)]
        return items
    section = dict(data or {})
    section[key] = _with(section.get(key), rest, value)
    return section


def _without(data: Any, path: Path) -> Any:
    """A copy of the data without an entry."""
    key, rest = path[0], path[1:]
    if rest:
        return _with(data, path[:1], _without(data[key], rest))
    if isinstance(data, list):
        return [item for i, item in enumerate(data) if i != key]
    return {name: item for name, item in data.items() if name != key}
