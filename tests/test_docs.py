"""The pages: links lead somewhere, messages that are explained exist, and nothing is missing from the reference."""

from __future__ import annotations

import contextlib
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

import ensemble_ctrl
from ensemble_ctrl.problem.capabilities import FEATURES, allows
from ensemble_ctrl.systems import SYSTEMS, System
from tests.paths import ROOT

DOCS = ROOT / "docs"
MADE = ("_build", "_generated", "tutorials", "jupyter_execute")
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if not set(page.relative_to(DOCS).parts) & set(MADE)]
PAGES += [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "benchmarks" / "README.md"]
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)|<img src=\"([^\"]+)\"|\{image\} (\S+)")
SCRIPTS = {path.stem for path in (ROOT / "examples").glob("[0-9]_*.py")}


def text_of(page: Path) -> str:
    """A page without its code."""
    text = page.read_text(encoding="utf-8")
    return re.sub(r"^```(?!\{image\}).*?^```$|`[^`\n]+`", "", text, flags=re.MULTILINE | re.DOTALL)


@cache
def anchors(page: Path) -> set[str]:
    """What a link into a page can name, as MyST makes them of its headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#{1,3} (.+)$", text, re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower().replace("'", "-")).strip().replace(" ", "-") for heading in headings
    }


def broken(page: Path) -> list[str]:
    """Links of a page that lead nowhere."""
    found = []
    for link in ("".join(groups) for groups in LINK.findall(text_of(page))):
        name, _, anchor = link.partition("#")
        if name.startswith(("http:", "https:")):
            continue
        target = (page.parent / name) if name else page
        if target.suffix == ".ipynb":
            found += [] if target.stem in SCRIPTS or target.stem == "notebook" else [link]
        elif not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target.resolve())):
            found.append(link)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    assert broken(page) == []


def test_broken_links_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A heading\n[a](#a-heading) [b](#b) [c](c.md) [d](page.md#a-heading) [e](page.md#e) `[f](f.md)`\n"
    )
    assert broken(page) == ["#b", "c.md", "page.md#e"]


def test_every_page_is_in_the_contents() -> None:
    listed: set[Path] = set()
    for page in PAGES:
        for tree in re.findall(
            r"^```\{toctree\}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
        ):
            listed |= {(page.parent / line).with_suffix(".md") for line in tree.split() if not line.startswith(":")}
    pages = {page for page in PAGES if page.is_relative_to(DOCS)} - {DOCS / "index.md"}
    assert pages - listed == set()


def test_messages_that_are_explained_are_messages() -> None:
    """Each heading in code on the page of failures, piece by piece between its ellipses, stands in the source."""
    page = (DOCS / "failures.md").read_text(encoding="utf-8")
    headings = [line for line in page.splitlines() if line.startswith("### ")]
    messages = [message for line in headings for message in re.findall(r"`([^`]+)`", line)]
    assert len(messages) > 20
    source = "".join(path.read_text(encoding="utf-8") for path in Path(ensemble_ctrl.__file__).parent.rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)
    pieces = [piece.strip() for message in messages for piece in message.split("…") if piece.strip(" ;")]
    assert [piece for piece in pieces if piece not in source] == []


def test_every_figure_of_the_method_is_shown_and_made() -> None:
    shown = re.findall(r"_static/method/(\w+)\.svg", (DOCS / "method.md").read_text(encoding="utf-8"))
    made = re.findall(r'"(\w+)": \1\b', (DOCS / "make_figures.py").read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(made) == sorted(path.stem for path in (DOCS / "_static" / "method").glob("*.svg"))
    assert max(path.stat().st_size for path in (DOCS / "_static" / "method").glob("*.svg")) < 60_000


ROOMS = "api|certificate|constraints|core|files|moments|ocp|planning|systems"
NAMED = re.compile(rf"`(?:ensemble_ctrl\.(\w[\w.]*)|((?:{ROOMS})\.\w[\w.]*))(?:\(|`)")


def is_there(name: str) -> bool:
    """Whether a module, or something in one, has this name below the package."""
    found: object = ensemble_ctrl
    path = "ensemble_ctrl"
    for part in name.split("."):
        path = f"{path}.{part}"
        with contextlib.suppress(ImportError):
            importlib.import_module(path)
        if not hasattr(found, part):
            return False
        found = getattr(found, part)
    return True


def test_names_of_the_package_on_pages_are_there() -> None:
    """A module that moves takes the pages with it; names of files are none."""
    named = {
        (page.name, "".join(groups))
        for page in PAGES
        for groups in NAMED.findall(page.read_text(encoding="utf-8"))
        if page.name != "CHANGELOG.md" and not groups[1].endswith((".json", ".py"))
    }
    assert len(named) > 60
    assert sorted(name for name in named if not is_there(name[1])) == []
    assert not is_there("ocp.nothing")
    assert not is_there("nothing.at.all")


def test_nothing_asks_a_system_of_what_type_it_is() -> None:
    """What a system can do is in the table of capabilities."""
    package = Path(ensemble_ctrl.__file__).parent
    asks = re.compile(r"(?:isinstance|issubclass)\([^)]*\b(?:Ode|Arc)[A-Z]\w*")
    assert [path.name for path in package.rglob("*.py") if asks.search(path.read_text(encoding="utf-8"))] == []


def feature_table() -> list[str]:
    """The table of features and systems as the page has it; a system of one's own is as any without a closed form."""
    models = {**SYSTEMS, "your own": System}
    head = ["feature", *(f"`{name}`" if name in SYSTEMS else name for name in models), "elsewhere not, because"]
    rows = [
        [row.words, *("yes" if allows(system, name) else "" for system in models.values()), row.why]
        for name, row in FEATURES.items()
    ]
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cells).replace("|  ", "| ").replace("  |", " |") + " |" for cells in lines]


def test_the_table_of_features_is_that_of_the_capabilities() -> None:
    page = (DOCS / "systems.md").read_text(encoding="utf-8")
    table = re.search(r"<!-- features -->\n(.*?)\n<!-- end -->", page, re.DOTALL)
    assert table is not None
    assert table.group(1).splitlines() == feature_table()
