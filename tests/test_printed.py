"""Figures on the pages are those of the files that commands write, and no command leaves a stale one."""

from __future__ import annotations

import base64
import importlib
import json
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from ensemble_ctrl.core.jobs import Cluster, Content, Outcome, Unit, outcomes
from tests.paths import ROOT

BEGIN = re.compile(r"^<!-- begin (\w+): (.*) -->$", re.MULTILINE)


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, ModuleType]]:
    """The scripts of the pages, which are no package."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    names = ("printed", "printed.table", "printed.terminal", "printed.times", "make_gallery", "make_tables")
    yield {name: importlib.import_module(name) for name in names}
    for name in [name for name in sys.modules if name.partition(".")[0] in names]:
        del sys.modules[name]


def test_the_gallery_is_what_its_file_says(scripts: dict[str, ModuleType]) -> None:
    gallery = scripts["make_gallery"]
    facts = scripts["printed"].read(gallery.FACTS)
    assert sorted(facts) == sorted(path.stem for path in gallery.configs())
    written = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert written == "\n".join(gallery.page(facts)) + "\n"


def test_every_block_is_what_its_file_says(scripts: dict[str, ModuleType]) -> None:
    """Runs and benchmarks keep their figures in files; the pages are made from these."""
    blocks = scripts["make_tables"].blocks()
    assert len(blocks) > 20
    for name, (page, lines) in blocks.items():
        _, there = scripts["printed"].block((ROOT / page).read_text(encoding="utf-8"), name)
        assert there.splitlines() == lines, f"{page}: run python docs/make_tables.py --write"


def test_every_block_of_a_page_has_a_file(scripts: dict[str, ModuleType]) -> None:
    """And names a command that is there."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "howto").glob("*.md")]
    begins = [found for page in pages for found in BEGIN.findall(page.read_text(encoding="utf-8"))]
    assert sorted(name for name, _ in begins) == sorted(scripts["make_tables"].blocks())
    for name, command in begins:
        script, *rest = _script(command.removeprefix("python ").split())
        assert (ROOT / script).exists()
        assert rest == ([name] if script == "docs/make_tables.py" else [])


def _script(words: list[str]) -> list[str]:
    """The file of ``-m package.module``, and what follows it."""
    return [f"{words[1].replace('.', '/')}.py", *words[2:]] if words[0] == "-m" else words


def test_a_page_without_the_block_is_refused(scripts: dict[str, ModuleType]) -> None:
    block = scripts["printed"].block
    page = "a\n<!-- begin one: python x.py -->\n1\n2\n<!-- end one -->\nb\n"
    assert block(page, "one") == (page, "1\n2\n")
    assert block(page, "one", ["3"])[0] == page.replace("1\n2", "3")
    for broken in (page.replace("end one", "end two"), page.replace("begin one", "begin two")):
        with pytest.raises(ValueError, match="no block 'one'"):
            block(broken, "one")


def test_figures_are_rounded_to_two_digits(scripts: dict[str, ModuleType]) -> None:
    table, times = scripts["printed.table"], scripts["printed.times"]
    lengths = [0.00021, 0.0048, 0.0127, 0.0783, 0.197, 0.996, 1.63]
    assert list(map(table.metres, lengths)) == ["0.2 mm", "4.8 mm", "1.3 cm", "7.8 cm", "20 cm", "1.0 m", "1.6 m"]
    assert list(map(table.plain, [4.93, 22.4, 283.0, 8.5e7, 0.5])) == ["4.9", "22", "2.8e2", "8.5e7", "0.50"]
    assert [table.power(2.04e-14), table.power(6.3e-2, 1)] == ["2.0e-14", "6e-2"]
    assert list(map(times.seconds, [0.0594, 0.307, 1.73, 12.3, 138.2])) == ["59 ms", "0.31 s", "1.7 s", "12 s", "138 s"]
    assert list(map(times.milliseconds, [0.0594, 0.1384, 0.0072])) == ["59 ms", "140 ms", "7 ms"]


def test_only_times_of_the_machine_are_left_out(scripts: dict[str, ModuleType]) -> None:
    without = scripts["printed.terminal"]._without_times
    assert without("  proven     clearance >= 0.07 m (0.03 s)") == "  proven     clearance >= 0.07 m (… s)"
    assert without("  work       2 routes, build 0.28 s; solve 0.65 s") == "  work       2 routes, build … s; solve … s"
    for line in (
        "  violated   avoid(o1) by 0.2 m (t = 2.10 s)",
        "  horizon    8 s in 80 steps",
        "duration 3.85 s; below 3.5 s",
    ):
        assert without(line) == line


def test_what_a_command_prints_is_kept(scripts: dict[str, ModuleType]) -> None:
    rows = scripts["printed.terminal"].rows((), "init", ("check problem.yaml", "check bad.yaml"), ("problem", "bad"))
    assert [row["line"].partition(":")[0] for row in rows] == ["problem.yaml", "bad.yaml"]


def test_the_gallery_refuses_to_leave_a_stale_row(
    scripts: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One problem is run again; the rows of others, made by other code, keep the page from being written."""
    gallery, printed = scripts["make_gallery"], scripts["printed"]
    two = [path for path in gallery.configs() if path.stem in ("box", "polyhedron")]
    row: dict[str, Any] = {"exit": 0, "proven": "yes", "clearance": None, "robustness": 0.05, "cost": 0.1}
    rows = {path.stem: row | {"source": printed.source(path)} for path in two}
    ran: list[str] = []

    def outcomes(units: Iterable[Unit], cluster: Cluster) -> Iterator[Outcome]:
        for unit in units:
            ran.append(unit.name)
            yield Outcome(unit, {"row": rows[unit.name], "picture": ""})

    made = {"outcomes": outcomes, "configs": lambda: two, "DOCS": tmp_path, "WORK": tmp_path / "work"}
    for name, value in made.items():
        monkeypatch.setattr(gallery, name, value)
    monkeypatch.setattr(gallery, "FACTS", tmp_path / "facts.json")
    monkeypatch.setattr(gallery, "PICTURES", tmp_path / "pictures")
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


def test_a_row_of_the_gallery_is_made_by_a_worker(scripts: dict[str, ModuleType]) -> None:
    """As the page has it: the same proof from the same code, with a picture."""
    gallery, printed = importlib.import_module("printed.gallery"), scripts["printed"]
    (path,) = [path for path in scripts["make_gallery"].configs() if path.stem == "box"]
    there = printed.read(scripts["make_gallery"].FACTS)["box"]
    unit = gallery.unit_of(path)
    units = [unit, replace(unit, content=Content(json.dumps({"path": str(path.parent / "nothing.yaml")})))]
    done, failed = sorted(outcomes(units, Cluster.parse("local:1")), key=lambda one: bool(one.failure))
    row = done.result["row"]
    assert (row["exit"], row["proven"], row["source"]) == (0, "yes", printed.source(path))
    assert row["clearance"] == there["clearance"]
    assert row["robustness"] == pytest.approx(there["robustness"], abs=0.01)
    assert base64.b64decode(done.result["picture"]).startswith(b"\x89PNG")
    assert "box: RuntimeError: exit code 2" in failed.failure
    assert "nothing.yaml" in failed.failure


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

    def source(left_out: tuple[str, ...] = printed.LEFT_OUT) -> str:
        printed._code.cache_clear()
        found: str = printed.source(problem / "a.yaml", left_out)
        return found

    (problem / "a.yaml").write_text("a: 1")
    cloud.write_text("1, 2")
    (code / "plan.py").write_text('"""Plan."""\n\nA = 1\n"""Metres."""\n\ndef f():\n    """Text."""\n    return A\n')
    seen.add(source())
    (code / "plan.py").write_text('"""Plan on."""\n# why\nA = 1\n\ndef f():\n    return A\n')
    (code / "cli" / "words.py").write_text("B = 2\n")
    assert {source()} == seen
    with_command = source(())
    (code / "cli" / "words.py").write_text("B = 3\n")
    assert {source()} == seen
    assert source(()) != with_command, "what the command prints is decided by all of the code"
    for path, text in ((code / "plan.py", "A = 2\n"), (cloud, "1, 3"), (problem / "a.yaml", "a: 2")):
        path.write_text(text)
        assert source() not in seen
        seen.add(source())


def test_the_exponent_is_that_of_the_larger_sizes(scripts: dict[str, ModuleType]) -> None:
    exponent = scripts["printed.times"].exponent
    assert exponent([1, 2, 4, 8, 16, 32], [7, 7, 7, 8**2, 16**2, 32**2]) == pytest.approx(2)
    assert exponent([10, 100], [1, 1000]) == pytest.approx(3)
    assert exponent([1, 2, 4], [9, 2, 4]) == pytest.approx(1)
