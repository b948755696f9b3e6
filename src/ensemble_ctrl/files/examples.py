"""The example problems that come with the package: their names, their texts, and the problems themselves."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.resources import as_file, files
from importlib.resources.abc import Traversable
from itertools import takewhile
from pathlib import Path

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.files.config import load
from ensemble_ctrl.files.config.errors import suggestion
from ensemble_ctrl.problem import Problem

EDITOR_LINE = "# yaml-language-server: $schema="
"""How a problem file names its schema for an editor, on its first line."""


def examples() -> dict[str, str]:
    """The example problems: the name of each, and what it shows.

    Examples
    --------
    >>> examples()["box"]
    'A box to stay in: from (0, 0) to (3, 2) in 2 s, the whole fleet at every instant inside'
    """
    return {name: title(text_of(file)) for name, (_, file) in _found().items()}


def example(name: str) -> Problem:
    """One of the example problems.

    Parameters
    ----------
    name : str
        One of `examples`.

    Raises
    ------
    ProblemError
        If there is no such example.

    Examples
    --------
    >>> example("five_obstacles").steps
    160
    """
    with as_file(file_of(expect("example", name, str, "the name of an example"))) as path:
        return load(path)


def file_of(name: str) -> Traversable:
    """The problem file of an example.

    Raises
    ------
    ProblemError
        If there is no such example.
    """
    known = _found()
    if name not in known:
        wanted = suggestion(name, known) or f"there are {', '.join(known)}"
        raise ProblemError(f"example: expected the name of an example, got {name!r}; {wanted}")
    return known[name][1]


def siblings(name: str) -> dict[str, Traversable]:
    """The other files in an example's folder, by their names, without the problem files."""
    folder = _found()[name][0]
    return {entry.name: entry for entry in folder.iterdir() if entry.is_file() and not entry.name.endswith(".yaml")}


@cache
def _found() -> dict[str, tuple[Traversable, Traversable]]:
    """The folder and file of every example by its name; from the package, or from ``configs`` beside the sources."""
    packaged = files("ensemble_ctrl") / "configs"
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "configs"
    return dict(sorted(_below(folder)))


def _below(folder: Traversable) -> Iterator[tuple[str, tuple[Traversable, Traversable]]]:
    """The examples in a folder and those below it."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _below(entry)
        elif entry.name.endswith(".yaml"):
            yield entry.name.removesuffix(".yaml"), (folder, entry)


def text_of(file: Traversable) -> str:
    """An example's text."""
    return without_editor_line(file.read_text(encoding="utf-8"))


def without_editor_line(text: str) -> str:
    """A problem file's text without the name of its schema, which lies elsewhere once the file is copied."""
    first, newline, rest = text.partition("\n")
    return rest if newline and first.startswith(EDITOR_LINE) else text


def title(text: str) -> str:
    """The first sentence of an example's opening comment."""
    lines = takewhile(lambda line: line.startswith("# "), without_editor_line(text).splitlines())
    return " ".join(line.removeprefix("# ") for line in lines).partition(". ")[0].removesuffix(".")
