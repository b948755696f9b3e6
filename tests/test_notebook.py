"""What users copy from runs: the notebook, the pages' examples, and the README's lines."""

from __future__ import annotations

import doctest
import os
import re
import runpy
from pathlib import Path

import pytest

import ensemble_ctrl
from tests.paths import ROOT

PAGES = [page for page in sorted((ROOT / "docs").rglob("*.md")) if ">>>" in page.read_text(encoding="utf-8")]
EXAMPLES = sorted((ROOT / "examples").glob("*.ipynb"))
TUTORIALS = sorted((ROOT / "examples").glob("[0-9]_*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    """From a folder that has nothing of the repository in it."""
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute(env={**os.environ, "PYTHONPATH": str(Path(ensemble_ctrl.__file__).parents[1])})
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in shown)


@pytest.mark.slow
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    cells = re.findall(r"^# %%(.*)\n", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(cells) == {"", " [markdown]"}
    names = runpy.run_path(str(path))
    plans = [value for value in names.values() if isinstance(value, ensemble_ctrl.Plan)]
    assert plans
    assert all(plan.certify().proven == "yes" for plan in plans)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_notebook_is_stored_without_outputs(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells)
    assert path.stat().st_size < 20_000


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_of_a_page(page: Path) -> None:
    failed, tried = doctest.testfile(str(page), module_relative=False, encoding="utf-8")
    assert tried > 0
    assert failed == 0


def test_lines_of_the_readme(monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    exec(code.replace("100_000", "1_000"), names)
    assert getattr(names["plan"], "verified")  # noqa: B009
    assert len([line for line in code.splitlines() if line]) == 4


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)|src=\"([^\"]+)\"", page.read_text(encoding="utf-8"))
    files = [a or b for a, b in links if not (a or b).startswith("http")]
    assert files
    assert [name for name in files if not (page.parent / name).exists()] == []


def test_pictures_are_small() -> None:
    static = ROOT / "docs" / "_static"
    assert (static / "five_obstacles.png").stat().st_size < 300_000
    assert (static / "five_obstacles.gif").stat().st_size < 400 * 1024
    assert [path.name for path in static.glob("*.png") if path.stat().st_size > 300_000] == []
    assert [path.name for path in (static / "gallery").glob("*.png") if path.stat().st_size > 80_000] == []


def test_gallery_shows_every_problem() -> None:
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    problems = [path for path in (ROOT / "configs").rglob("*.yaml") if path.parent.name not in ("online", "channels")]
    missing = [path.stem for path in problems if f"### {path.stem}\n" not in text]
    assert missing == [], "run: python docs/make_gallery.py"
