"""YAML text to plain data, with the place of every key and value."""

from __future__ import annotations

import re
from dataclasses import field
from itertools import accumulate
from typing import Any, ClassVar

import yaml
from yaml.composer import Composer
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from ensemble_ctrl.core.deferred import dataclass

MAX_DEPTH = 50
MAX_NODES = 50_000
Path = tuple[str | int, ...]
_TAG = "tag:yaml.org,2002:"
_NUMBER = r"(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
SCALARS = (
    (f"{_TAG}null", re.compile(r"(?:~|null|Null|NULL|)$")),
    (f"{_TAG}bool", re.compile(r"(?:true|True|TRUE|false|False|FALSE)$")),
    (f"{_TAG}int", re.compile(r"[-+]?[0-9]{1,15}$")),
    (f"{_TAG}float", re.compile(rf"[-+]?{_NUMBER}$|[-+]?\.(?:inf|Inf|INF)$|\.(?:nan|NaN|NAN)$")),
)
"""Tags of unquoted texts that are not texts, by pattern."""


@dataclass(frozen=True)
class Place:
    """A 1-based line and column."""

    line: int
    column: int


class TextError(Exception):
    """A text can't be read as YAML, or is too much of it."""

    def __init__(self, message: str, place: Place | None = None, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.place, self.hint = message, place, hint


@dataclass()
class Tree:
    """What was read.

    Attributes
    ----------
    data
        Mappings, lists, texts, numbers, booleans; keys are texts, and keys without a value are left out.
    keys, values : dict
        The node of every key and of every value, by its path.
    repeated : list of (path, line, line)
        Keys given again, with the line at which they were first, and the place of the repetition.
    """

    text: str
    data: Any = None
    keys: dict[Path, Node] = field(default_factory=dict)
    values: dict[Path, Node] = field(default_factory=dict)
    repeated: list[tuple[Path, int, Place]] = field(default_factory=list)
    nodes: int = 0

    @classmethod
    def read(cls, text: str) -> Tree:
        """Read YAML; empty text gives data None.

        Raises
        ------
        TextError
            For what is not YAML, tags, keys that are not texts, and trees too large or too deep.
        """
        tree = cls(text)
        try:
            root = _compose(text)
        except yaml.MarkedYAMLError as error:
            raise _syntax_error(error) from None
        except yaml.reader.ReaderError as error:
            before = text[: error.position]
            place = Place(before.count("\n") + 1, len(before) - before.rfind("\n"))
            raise TextError(f"expected text, got the control character {chr(error.character)!r}", place) from None
        tree.data = None if root is None else tree._value(root, ())
        return tree

    def _value(self, node: Node, path: Path) -> Any:
        """The data of a node."""
        self.nodes += 1
        if self.nodes > MAX_NODES or len(path) > MAX_DEPTH:
            raise _too_much(node)
        self.values.setdefault(path, node)
        if isinstance(node, MappingNode) and node.tag == f"{_TAG}map":
            return self._mapping(node, path)
        if isinstance(node, SequenceNode) and node.tag == f"{_TAG}seq":
            return [self._value(item, (*path, i)) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return _scalar(node)
        raise TextError(f"expected no tag, got {node.tag.replace(_TAG, '!!')}", start(node))

    def _mapping(self, node: MappingNode, path: Path) -> dict[str, Any]:
        """The data of a mapping, without keys that have no value."""
        data: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, ScalarNode):
                raise TextError("expected a text as a key, got a list or a section", start(key))
            below = (*path, key.value)
            if below in self.keys:
                self.repeated.append((below, start(self.keys[below]).line, start(key)))
                continue
            self.keys[below] = key
            item = self._value(value, below)
            if item is not None:
                data[key.value] = item
        return data


def _compose(text: str) -> Node | None:
    """The text's node, by libyaml where it reads the same; errors always come from PyYAML, in its words."""
    if not any(character in text for character in "\t?\ufeff"):  # libyaml allows these in more places
        try:
            root: Node | None = yaml.compose(text, _QuickLoader)
            return root
        except (yaml.YAMLError, UnicodeError):
            pass
    return yaml.compose(text, _Loader)


class _Limited(Composer):
    """YAML 1.2's scalars (``1e-3`` is a number; ``off``, ``14:30`` and dates are texts), with limits."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}
    nodes = depth = 0

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """Compose one node, counting."""
        self.nodes += 1
        self.depth += 1
        if self.nodes > MAX_NODES or self.depth > MAX_DEPTH:
            mark = self.peek_event().start_mark  # type: ignore[attr-defined]
            raise TextError(_limits(), Place(mark.line + 1, mark.column + 1))
        node: Node | None = super().compose_node(parent, index)
        self.depth -= 1
        return node


class _Loader(_Limited, yaml.SafeLoader):
    """PyYAML's own parser."""


_Quick: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _QuickLoader(_Limited, _Quick):  # type: ignore[misc]
    """The parser of libyaml where PyYAML has it, five times as fast."""

    def __init__(self, stream: str) -> None:
        _Quick.__init__(self, stream)
        Composer.__init__(self)


for _tag, _pattern in SCALARS:
    _Loader.add_implicit_resolver(_tag, _pattern, None)
    _QuickLoader.add_implicit_resolver(_tag, _pattern, None)


def _scalar(node: ScalarNode) -> Any:
    """The data of a scalar."""
    text, kind = node.value, node.tag.removeprefix(_TAG)
    try:
        match kind:
            case "str":
                return text
            case "null":
                return None
            case "bool":
                return {"true": True, "false": False}[text.lower()]
            case "int":
                return int(text)
            case "float":
                return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    except (ValueError, KeyError):
        pass
    raise TextError(f"expected no tag, got {node.tag.replace(_TAG, '!!')}", start(node))


def start(node: Node) -> Place:
    """Where a node starts."""
    return Place(node.start_mark.line + 1, node.start_mark.column + 1)


def indices(text: str, node: Node) -> list[int]:
    """Where each character of a text value stands in the file, and where it ends, whatever its quotes and line breaks.

    The value and the file agree on everything but white space, unless there are escapes; then the list is empty.
    """
    if not isinstance(node, ScalarNode):
        return []
    first, end = node.start_mark.index, node.end_mark.index
    if node.style in ("|", ">"):
        first = text.find("\n", first, end) + 1
    elif node.style in ('"', "'"):
        first, end = first + 1, end - 1
    raw = [i for i in range(first, end) if not text[i].isspace()]
    if [text[i] for i in raw] != [c for c in node.value if not c.isspace()] or not raw:
        return []
    seen = [0, *accumulate(not c.isspace() for c in node.value)]
    return [raw[count] if count < len(raw) else raw[-1] + 1 for count in seen]


def place_at(text: str, index: int) -> Place:
    """The line and column of a character."""
    return Place(text.count("\n", 0, index) + 1, index - text.rfind("\n", 0, index))


def _syntax_error(error: yaml.MarkedYAMLError) -> TextError:
    """PyYAML's complaint in our form."""
    mark = error.problem_mark or error.context_mark
    place = Place(mark.line + 1, mark.column + 1) if mark else None
    context = f" ({error.context})" if error.context else ""
    if error.context_mark and str(error.context).startswith("while"):
        context = f" ({error.context} that began on line {error.context_mark.line + 1})"
    problem = str(error.problem).removeprefix("but ")
    hint = ""
    if "'\\t'" in problem:
        hint = "indent with spaces, not with tabs"
    elif problem.startswith("mapping values"):
        hint = "put a text that has ': ' in it in quotes"
    return TextError(f"not YAML: {problem}{context}", place, hint)


def _limits() -> str:
    """What is too much."""
    return f"expected at most {MAX_NODES} values, nested at most {MAX_DEPTH} deep, got more"


def _too_much(node: Node) -> TextError:
    """A tree that is too large once its aliases are written out."""
    return TextError(_limits(), start(node), "write it without aliases, or put large shapes in a `file`")
