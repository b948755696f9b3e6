"""``ensemble-plan paper``: its files, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

from .conftest import Command


def test_it_writes_the_table_and_a_figure(command: Command, place: Path) -> None:
    done = command("paper", "box", "--robot", "unicycle", "--members", "200", "--json")
    assert done.code == 0
    rows = done.data["rows"]
    assert [(row["robot"], row["form"]) for row in rows] == [("unicycle", "published"), ("unicycle", "ours")]
    folder = place / "plans" / "paper"
    assert json.loads((folder / "paper.json").read_text(encoding="utf-8"))["rows"] == rows
    assert (folder / "box.png").stat().st_size > 10_000


def test_it_refuses_what_it_does_not_know(command: Command, place: Path) -> None:
    done = command("paper", "boxes")
    assert (done.code, done.out) == (2, "")
    assert "error: EXPERIMENT: expected one of box, polyhedron" in done.err
    done = command("paper", "box", "--robot", "car")
    assert done.code == 2
    assert "error: --robot: expected one of unicycle, bicycle, got 'car'" in done.err
    done = command("paper", "box", "--form", "yours")
    assert "error: --form: expected one of published, ours, linear, got 'yours'" in done.err
    assert not (place / "plans").exists()
