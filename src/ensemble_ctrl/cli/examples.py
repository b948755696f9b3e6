"""``ensemble-plan examples``: the problem files that come with the package."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from pathlib import Path

from ensemble_ctrl.cli.newfile import write_new
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.examples import examples, file_of, siblings, text_of


def list_or_print(name: str | None, copy: bool) -> None:
    """List all, print one, or copy one here with the files that it names.

    Raises
    ------
    EnsembleError
        If there is no such example, or a file of its name is here already.
    """
    if name is not None:
        _copy(name, file_of(name)) if copy else say(text_of(file_of(name)).rstrip("\n"))
        return
    known = examples()
    if copy:
        raise EnsembleError(f"examples: --copy needs a name, one of {', '.join(known)}")
    width = max(map(len, known), default=0) + 2
    for key, title in known.items():
        say(f"{key:<{width}}{title}")


def _copy(name: str, example: Traversable) -> None:
    """Write an example and the files that it names to new files; none of them if one is here already."""
    text, target = text_of(example), Path(f"{name}.yaml")
    others = named_files(text.encode(), siblings(name))
    taken = [file for file in others if Path(file).exists()]
    if taken and not target.exists():
        raise EnsembleError(f"{taken[0]}: this file exists already; nothing was written")
    write_new(target, text)
    for file, content in others.items():
        write_new(Path(file), content)
    say(f"wrote {', '.join([str(target), *others])}; now run: ensemble-plan {target}")


def named_files(content: bytes, others: dict[str, Traversable]) -> dict[str, bytes]:
    """The files beside a file that it names, and those that they name."""
    found = {name: other.read_bytes() for name, other in others.items() if name.encode() in content}
    rest = {name: other for name, other in others.items() if name not in found}
    for named in list(found.values()):
        found |= named_files(named, rest)
    return found
