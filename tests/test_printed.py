"""Figures on the pages are those of the files that commands write, and no command leaves a stale one."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.paths import ROOT


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, ModuleType]]:
    """The scripts of the pages, which are no package."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    names = ("printed", "make_gallery", "make_tables")
    yield {name: importlib.import_module(name) for name in names}
    for name in names:
        sys.modules.pop(name, None)


def test_the_gallery_is_what_its_file_says(scripts: dict[str, ModuleType]) -> None:
    gallery = scripts["make_gallery"]
    facts = scripts["printed"].read(gallery.FACTS)
    assert sorted(facts) == sorted(path.stem for path in gallery.configs())
    written = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert written == "\n".join(gallery.page(facts)) + "\n"


def test_every_table_is_what_its_file_says(scripts: dict[str, ModuleType]) -> None:
    tables = scripts["make_tables"]
    assert len(tables.TABLES_OF) > 4
    for name, table in tables.TABLES_OF.items():
        page = (ROOT / table.page).read_text(encoding="utf-8")
        _, there = scripts["printed"].block(page, name)
        assert there.splitlines() == tables.lines_of(name), f"{table.page}: run python docs/make_tables.py {name}"


def test_the_gallery_refuses_to_leave_a_stale_row(
    scripts: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One problem is run again; the rows of others, made by other code, keep the page from being written."""
    gallery, printed = scripts["make_gallery"], scripts["printed"]
    two = [path for path in gallery.configs() if path.stem in ("box", "polyhedron")]
    row: dict[str, Any] = {"exit": 0, "proven": "yes", "clearance": None, "robustness": 0.05, "cost": 0.1}
    rows = {path.stem: row | {"source": printed.source(path)} for path in two}
    ran: list[str] = []

    def run(path: Path) -> dict[str, Any]:
        ran.append(path.stem)
        return rows[path.stem]

    for name, value in (("run", run), ("configs", lambda: two), ("DOCS", tmp_path), ("WORK", tmp_path / "work")):
        monkeypatch.setattr(gallery, name, value)
    monkeypatch.setattr(gallery, "FACTS", tmp_path / "facts.json")
    printed.write(tmp_path / "facts.json", {path.stem: row | {"source": "old"} for path in two})
    with pytest.raises(SystemExit, match=r"stale: polyhedron; run python docs/make_gallery.py"):
        gallery.main(["box"])
    assert not (tmp_path / "gallery.md").exists()
    gallery.main([])
    assert ran == ["box", "polyhedron"], "what has been run is not run again"
    assert "| 0.0500 |" in (tmp_path / "gallery.md").read_text(encoding="utf-8")
    assert printed.read(tmp_path / "facts.json") == rows
    gallery.main([])
    assert len(ran) == 2


def test_a_row_is_of_its_problem_its_maps_and_the_code(
    scripts: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Comments and docstrings decide nothing; everything else does."""
    printed = scripts["printed"]
    code, problem, cloud = tmp_path / "code", tmp_path / "problem", tmp_path / "problem" / "cloud.csv"
    (code / "cli").mkdir(parents=True)
    problem.mkdir()
    monkeypatch.setattr(printed, "PACKAGE", code)
    seen = set()

    def source() -> str:
        printed._code.cache_clear()
        found: str = printed.source(problem / "a.yaml")
        return found

    (problem / "a.yaml").write_text("a: 1")
    cloud.write_text("1, 2")
    (code / "plan.py").write_text('"""Plan."""\n\nA = 1\n"""Metres."""\n\ndef f():\n    """Text."""\n    return A\n')
    seen.add(source())
    (code / "plan.py").write_text('"""Plan on."""\n# why\nA = 1\n\ndef f():\n    return A\n')
    (code / "cli" / "words.py").write_text("B = 2\n")
    assert {source()} == seen
    for path, text in ((code / "plan.py", "A = 2\n"), (cloud, "1, 3"), (problem / "a.yaml", "a: 2")):
        path.write_text(text)
        assert source() not in seen
        seen.add(source())
