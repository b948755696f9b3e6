"""``ensemble-plan init`` and ``schema``: a problem file to start from, and what an editor wants to know of one."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

from ensemble_ctrl.cli.newfile import write_new
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.storage import read_regular
from ensemble_ctrl.files.examples import EDITOR_LINE
from ensemble_ctrl.files.folder import write_text

SCHEMA_FILE = "problem.schema.json"
MOST_SCHEMA = 1_000_000


def start(target: Path, with_schema: bool) -> None:
    """Write the starter problem, and with `with_schema` the JSON Schema beside it, unless that is there already.

    Raises
    ------
    EnsembleError
        If the file is there already, or can't be written; then nothing is.
    """
    if str(target) == "-":
        say(starter_text().rstrip("\n"))
        return
    lead = f"{EDITOR_LINE}{SCHEMA_FILE}\n" if with_schema else ""
    write_new(target, lead + starter_text(target.name))
    say(f"wrote {target}; now run: ensemble-plan {_shown(target)}")
    schema_file = target.with_name(SCHEMA_FILE)
    if with_schema and not schema_file.exists():
        write_new(schema_file, schema_text())
        say(f"wrote {schema_file}, for editors")


def print_schema(output: Path | None) -> None:
    """Print the JSON Schema of a problem file, or write it to a new file, or over an older schema of ours.

    Raises
    ------
    EnsembleError
        If there is another file of that name, or it can't be written.
    """
    if output is None or str(output) == "-":
        say(schema_text().rstrip("\n"))
        return
    if _is_schema(output):
        write_text(output, schema_text(), overwrite=True)
    else:
        write_new(output, schema_text())
    say(f"wrote {output}; name it on a problem file's first line: {EDITOR_LINE}{output}")


def starter_text(name: str = "problem.yaml") -> str:
    """The starter problem, as a file of some name."""
    text = (files("ensemble_ctrl.cli") / "starter.yaml").read_text(encoding="utf-8")
    return text.replace("problem.yaml", name).replace("plans/problem/", f"plans/{Path(name).stem}/")


def schema_text() -> str:
    """The JSON Schema as a file's text."""
    from ensemble_ctrl.files.config import schema

    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def _shown(target: Path) -> str:
    """How a file is named on the command line."""
    return f"'{target}'" if " " in str(target) else str(target)


def _is_schema(path: Path) -> bool:
    """Whether a file is a schema that this command wrote."""
    try:
        found = json.loads(read_regular(path, MOST_SCHEMA))
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and found.get("title") == "A problem file of ensemble_ctrl"
