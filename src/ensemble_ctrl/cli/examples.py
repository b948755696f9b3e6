"""``ensemble-plan examples``: the problem files that come with the package."""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import takewhile
from pathlib import Path

from ensemble_ctrl.cli.newfile import without_editor_line, write_new
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.config.wrong import suggestion
from ensemble_ctrl.errors import EnsembleError

Example = tuple[str, dict[str, bytes]]
"""A problem file's text, and what is in the files that it names, or that those name, by their names."""


def example_files() -> dict[str, Example]:
    """Every example by its name; from the package, or from ``configs`` beside the sources."""
    packaged = files("ensemble_ctrl") / "configs"
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "configs"
    return dict(sorted(_all(folder).items()))


def _all(folder: Traversable) -> dict[str, Example]:
    """The examples in a folder and those below it."""
    found: dict[str, Example] = {}
    entries = list(folder.iterdir())
    others = {entry.name: entry for entry in entries if entry.is_file() and not entry.name.endswith(".yaml")}
    for entry in entries:
        if entry.is_dir():
            found |= _all(entry)
        elif entry.name.endswith(".yaml"):
            text = without_editor_line(entry.read_text(encoding="utf-8"))
            found[entry.name.removesuffix(".yaml")] = (text, _named(text.encode(), others))
    return found


def _named(content: bytes, others: dict[str, Traversable]) -> dict[str, bytes]:
    """The files beside a file that it names, and those that they name."""
    found = {name: other.read_bytes() for name, other in others.items() if name.encode() in content}
    rest = {name: other for name, other in others.items() if name not in found}
    for named in list(found.values()):
        found |= _named(named, rest)
    return found


def list_or_print(name: str | None, copy: bool) -> None:
    """List all, print one, or copy one here with the files that it names.

    Raises
    ------
    EnsembleError
        If there is no such example, or a file of its name is here already.
    """
    examples = example_files()
    if name is None:
        if copy:
            raise EnsembleError(f"examples: --copy needs a name, one of {', '.join(examples)}")
        width = max(map(len, examples), default=0) + 2
        for key, (text, _) in examples.items():
            say(f"{key:<{width}}{title(text)}")
    elif name not in examples:
        hint = suggestion(name, examples)
        known = f"expected one of {', '.join(examples)}, got {name!r}"
        raise EnsembleError(f"examples: {known}" + (f"; {hint}" if hint else ""))
    elif copy:
        _copy(name, examples[name])
    else:
        say(examples[name][0].rstrip("\n"))


def _copy(name: str, example: Example) -> None:
    """Write an example and the files that it names to new files; none of them if one is here already."""
    text, others = example
    target = Path(f"{name}.yaml")
    taken = [file for file in others if Path(file).exists()]
    if taken and not target.exists():
        raise EnsembleError(f"{taken[0]}: this file exists already; nothing was written")
    write_new(target, text)
    for file, content in others.items():
        write_new(Path(file), content)
    say(f"wrote {', '.join([str(target), *others])}; now run: ensemble-plan {target}")


def title(text: str) -> str:
    """The first sentence of an example's opening comment."""
    lines = takewhile(lambda line: line.startswith("# "), without_editor_line(text).splitlines())
    return " ".join(line.removeprefix("# ") for line in lines).partition(". ")[0].removesuffix(".")
