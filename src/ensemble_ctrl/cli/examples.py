"""``ensemble-plan examples``: the problem files that come with the package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.config.wrong import suggestion
from ensemble_ctrl.errors import EnsembleError


def example_texts() -> dict[str, str]:
    """Every example's text by its name; from the package, or from ``configs`` beside the sources."""
    packaged = files("ensemble_ctrl") / "configs"
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "configs"
    found = [entry for entry in folder.iterdir() if entry.name.endswith(".yaml")]
    return {entry.name.removesuffix(".yaml"): entry.read_text(encoding="utf-8") for entry in found}


def list_or_print(name: str | None, copy: bool) -> None:
    """List all, print one, or copy one here.

    Raises
    ------
    EnsembleError
        If there is no such example, or a file of its name is here already.
    """
    texts = example_texts()
    if name is None:
        if copy:
            raise EnsembleError(f"examples: --copy needs a name, one of {', '.join(sorted(texts))}")
        width = max(map(len, texts), default=0) + 2
        for key in sorted(texts):
            say(f"{key:<{width}}{_title(texts[key])}")
    elif name not in texts:
        hint = suggestion(name, texts)
        known = f"expected one of {', '.join(sorted(texts))}, got {name!r}"
        raise EnsembleError(f"examples: {known}" + (f"; {hint}" if hint else ""))
    elif copy:
        _copy(texts[name], Path(f"{name}.yaml"))
    else:
        say(texts[name].rstrip("\n"))


def _copy(text: str, target: Path) -> None:
    """Write an example to a new file."""
    try:
        with target.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise EnsembleError(f"{target}: this file exists already; nothing was written") from None
    say(f"wrote {target}; now run: ensemble-plan {target}")


def _title(text: str) -> str:
    """The first comment of an example."""
    comments = (line for line in text.splitlines() if line.startswith("# ") and "$schema" not in line)
    return next(comments, "# ").removeprefix("# ")
