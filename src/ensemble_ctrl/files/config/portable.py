"""A problem as one text, for another process or another machine.

Nothing in it runs code, but a user's own system, whose Python file goes with its problem.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config.dump import dump
from ensemble_ctrl.files.config.load import load_text
from ensemble_ctrl.files.config.system_section import source_file
from ensemble_ctrl.problem import Problem

PROBLEM = "problem.yaml"
"""The name of a problem's text in messages."""


def problem_text(problem: Problem) -> str:
    """A problem, its maps and samples written out, as one JSON text: the same problem gives the same text.

    Raises
    ------
    ProblemError
        For a system of the user's that is not in a file.
    """
    source = source_file(problem.fleet.system)
    system = None if source is None else [source.name, source.read_text(encoding="utf-8")]
    return json.dumps({"problem": dump(problem), "system": system})


@contextmanager
def problem_of(text: str) -> Iterator[Problem]:
    """The problem of a text, within a block: the file of a user's own system is there as long."""
    data = json.loads(text)
    if data["system"] is None:
        yield load_text(data["problem"], PROBLEM)
        return
    name, source = data["system"]
    with TemporaryDirectory() as folder:
        put_file(Path(folder, name), source)
        yield load_text(data["problem"], str(Path(folder, PROBLEM)), trust=True)
