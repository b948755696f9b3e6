"""What is wrong in words: pydantic's errors as findings, findings with line and column, and their layout."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from ensemble_ctrl.constraints.stl import FormulaError
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import MOST_LISTED, first_of, with_short_words
from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.fleets import SECTIONS
from ensemble_ctrl.files.config.schema import ProblemFile
from ensemble_ctrl.problem.checks import Finding, Path, Severity

EXAMPLES: dict[Path, str] = {
    ("fleet",): "fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}",
    ("fleet", "model"): "model: unicycle",
    ("fleet", "start"): "start: {position: [0, 0], heading: 0}",
    ("fleet", "start", "position"): "position: [0, 0]",
    ("fleet", "start", "heading"): "heading: 45 deg",
    ("horizon",): "horizon: {duration: 16 s}",
    ("horizon", "duration"): "duration: 16 s",
    ("task",): 'task: "F[0, T] in(goal) and G avoid(obstacles)"',
    ("objective", "terminal", "target"): "target: [6.5, 5.5]",
}
"""An example of a required field."""

_KINDS = {"model": "a section of fields", "dict": "a section of names", "list": "a list", "string": "a text"}


@dataclass(frozen=True)
class Diagnostic:
    """One error or warning, with its place in a file.

    Parameters
    ----------
    source : str
        The file's name, ``<stdin>``, or the ``--set`` that it comes from.
    line, column : int or None
        1-based; None where no place can be given.
    severity : {"error", "warning"}
    path : str
        Keys that lead to it, such as ``fleet.start.heading``.
    message, hint : str
        What was wanted and what came; what to do.
    excerpt : str
        The line of the file.
    """

    source: str
    line: int | None
    column: int | None
    severity: Severity
    path: str
    message: str
    hint: str = ""
    excerpt: str = ""

    def __post_init__(self) -> None:
        for name in ("message", "hint"):
            object.__setattr__(self, name, with_short_words(getattr(self, name)))

    def __str__(self) -> str:
        place = "" if self.line is None else f":{self.line}:{self.column}"
        path = f"{self.path}: " if self.path else ""
        lines = [_printable(f"{self.source}{place}: {self.severity}: {path}{self.message}")]
        if self.line is not None and self.column is not None and self.excerpt:
            code, at = _shortened(self.excerpt, self.column)
            lines += [f"    {self.line:>4} | {code}", f"         | {' ' * (at - 1)}^"]
        if self.hint:
            lines.append(_printable(f"    hint: {self.hint}"))
        return "\n".join(lines)


def _shortened(code: str, column: int, width: int = 100) -> tuple[str, int]:
    """A line's part round a column, one column for each character."""
    code = _printable(code.replace("\t", " ").rstrip())
    first = max(0, column - 1 - width // 2) if len(code) > width else 0
    return code[first : first + width], column - first


def _printable(text: str) -> str:
    """Text that can't steer a terminal."""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)


def layout(diagnostics: Iterable[Diagnostic], name: str) -> str:
    """The first of them as one text, ending with how many errors there are."""
    listed = list(diagnostics)
    count = sum(item.severity == "error" for item in listed)
    return "\n".join([*first_of(listed), f"{count} error{'s' * (count != 1)} in {_printable(name)}"])


def findings_of(error: ValidationError) -> list[Finding]:
    """Pydantic's errors in our words."""
    found = enumerate(error.errors(include_url=False))
    return [_finding(detail, guess=place < MOST_LISTED) for place, detail in found]


ROUND = dict.fromkeys(["circle", "disk", "round"], "write  disc: {center: [x, y], radius: 0.5 m}")
"""What to write in place of other words for a disc."""


def _finding(detail: Any, guess: bool) -> Finding:
    """One of pydantic's errors in our words, with a guess at what was meant."""
    place: Path = tuple(key for key in detail["loc"] if key != "[key]")
    path: Path = tuple(key for key in place if key not in SECTIONS)
    on_key = place != detail["loc"]
    kind, value = detail["type"], detail["input"]
    match kind:
        case "value_error":
            found = _raised(path, detail["ctx"]["error"])
            return replace(found, on_key=on_key or found.on_key)
        case "missing":
            hint = f"for example  {EXAMPLES[path]}" if path in EXAMPLES else ""
            return Finding(path, "this is required, but missing", hint)
        case "extra_forbidden":
            known = fields_at(place[:-1])
            hint = (
                ROUND.get(str(path[-1]), "")
                or (guess and suggestion(path[-1], known))
                or f"known here: {', '.join(known)}"
            )
            return Finding(path, "unknown field", hint, on_key=True)
        case "literal_error":
            known = re.findall(r"'([^']*)'", detail["ctx"]["expected"])
            return Finding(
                path, f"{show(value)} is not one of {', '.join(known)}", suggestion(value, known) if guess else ""
            )
    wanted = _KINDS.get(kind.split("_")[0])
    return Finding(path, f"expected {wanted}, got {show(value)}" if wanted else detail["msg"])


def _raised(path: Path, error: Exception) -> Finding:
    """What a validator of ours raised."""
    if isinstance(error, FieldError):
        return Finding((*path, *error.path), error.message, error.hint, offset=error.offset, on_key=error.on_key)
    if isinstance(error, FormulaError):
        offset = error.column - 1 if error.column else None
        return Finding(path, f"expected {error.expected}, got {error.came}", error.hint, offset=offset)
    return Finding(path, str(error))


def fields_at(path: Path) -> list[str]:
    """Fields of the section at a path, in which the form of a fleet section follows its key."""
    kind: Any = ProblemFile
    for key in path:
        if key in SECTIONS:
            kind = SECTIONS[str(key)]
        elif isinstance(kind, type) and issubclass(kind, BaseModel):
            kind = kind.model_fields[str(key)].annotation
        else:
            kind = get_args(kind)[-1]
        kind = plain_type(kind)
    return list(kind.model_fields)


def plain_type(kind: Any) -> Any:
    """A type without ``Annotated`` and without ``| None``."""
    while hasattr(kind, "__metadata__"):
        kind = get_args(kind)[0]
    options = [option for option in get_args(kind) if option is not type(None)]
    return options[0] if type(None) in get_args(kind) else kind
