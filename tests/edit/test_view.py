"""Saved plans over each other on one page."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.edit.overlay import NONE, differences, overlay
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.cli.show import judged
from ensemble_ctrl.cli.view import names_of
from ensemble_ctrl.core.errors import EnsembleError
from tests.report.browser import Page, chromium

from .editor import Editor, served
from .test_page import BROWSER, asks_nobody, wait

needs_browser = pytest.mark.skipif(BROWSER is None and "CI" not in os.environ, reason="no headless Chromium here")
SMALL = """
name: small
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
  radius: 5 cm
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1.5, 3], [-0.5, 0.5]]}}
obstacles: {post: {box: [[1, 1.4], [-2, -0.6]]}, wall: {box: [[3.5, 4], [-2, 2]]}}
task: F[3, 4] in(goal) and G avoid(obstacles)
"""
MOVED = SMALL.replace("[[1, 1.4], [-2, -0.6]]", "[[1, 1.4], [-2.5, -1]]").replace("radius: 5 cm", "radius: 10 cm")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("plans")
    for name, text in (("first", SMALL), ("second", MOVED)):
        (folder / name).mkdir()
        ec.plan(ec.load_text(text)).save(folder / name / "plan.npz")
    return folder / "first", folder / "second"


@pytest.fixture(scope="module")
def plans(folders: tuple[Path, Path]) -> dict[str, Plan]:
    return {folder.name: judged(folder) for folder in folders}


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as page:
        page.screen(1280, 900)
        yield page


def visit(tab: Page, one: Editor) -> None:
    """Open a page, and wait until it shows something."""
    tab.visit("about:blank")
    tab.complaints.clear()
    tab.requests.clear()
    tab.visit(one.address)
    wait(tab, "window.editor && editor.state !== null")


def test_rows_say_what_differs_and_nothing_else(plans: dict[str, Plan]) -> None:
    rows = {row["label"]: row for row in differences(plans)}
    assert rows["fleet.radius"]["cells"] == ["0.05", "0.1"]
    assert rows["fleet.radius"]["differ"]
    assert not rows["task"]["differ"]
    assert "horizon.duration" not in rows  # the same in both files
    assert rows["obstacles.post.box"]["cells"] == ["[[1.0, 1.4], [-2.0, -0.6]]", "[[1.0, 1.4], [-2.5, -1.0]]"]
    same = differences({"a": plans["first"], "b": plans["first"]})
    assert not any(row["differ"] for row in same)


def test_a_row_that_one_plan_lacks_says_so(plans: dict[str, Plan]) -> None:
    bare = {"a": plans["first"], "b": replace(plans["first"], certificate=None)}
    rows = {row["label"]: row for row in differences(bare)}
    assert rows["proven"]["differ"]
    assert NONE in rows["proven"]["cells"] or "no" in rows["proven"]["cells"][1]


def test_what_all_maps_have_is_drawn_once(plans: dict[str, Plan]) -> None:
    shown = overlay(plans)
    json.dumps(shown, allow_nan=False)
    assert {shape["name"] for shape in shown["map"]["shapes"]} == {"goal", "wall"}
    own = [[area["name"] for area in one["drawing"]["views"][0]["own"]] for one in shown["plans"]]
    assert own == [["post"], ["post"]]


def test_plans_that_do_not_go_together_are_refused(plans: dict[str, Plan]) -> None:
    many: dict[str, Any] = {str(k): plans["first"] for k in range(7)}
    with pytest.raises(EnsembleError, match="expected at most 6 plans, got 7"):
        overlay(many)
    space = ec.load_text(
        "fleet: {model: quadrotor, start: {x: 0, y: 0, z: 1}}\nhorizon: {duration: 1 s, steps: 4}\n"
        "regions: {up: {box: [[-1, 1], [-1, 1], [0, 2]]}}\ntask: G in(up)\n"
    )
    flying = Plan(space, [[0.0] * len(space.fleet.system.controls)] * 4, "limit")  # type: ignore[arg-type]
    with pytest.raises(EnsembleError, match="flying: expected a plan in x, y like first, got one in x, y, z"):
        overlay({"first": plans["first"], "flying": flying})


def test_plans_are_called_by_their_folders() -> None:
    paths = [Path("a/run"), Path("b/run"), Path("c/plan.npz"), Path("d/other.npz")]
    assert names_of(paths) == ["a/run", "b/run", "c", "other"]
    assert names_of([Path("x"), Path("x")]) == ["x (1)", "x (2)"]


def test_what_can_not_be_shown_is_an_error_at_once(folders: tuple[Path, Path], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ensemble_ctrl.cli", "view", str(folders[0]), str(tmp_path / "gone")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert "gone" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_nothing_can_be_changed_and_only_with_the_token(folders: tuple[Path, Path]) -> None:
    with served("view", str(folders[0])) as one:
        assert one.request("GET", "/api/state", token="no")[0] == 401
        assert one.request("GET", "/api/state", Host="example.org")[0] == 421
        assert one.request("GET", "/api/state", Origin="http://example.org")[0] == 403
        for path in ("/api/edit", "/api/save", "/api/text", "/api/import"):
            assert one.request("POST", path, {})[0] == 404, path
        assert one.state()["mode"] == "view"


@needs_browser
def test_plans_are_told_apart_and_can_be_hidden(tab: Page, folders: tuple[Path, Path]) -> None:
    with served("view", *map(str, folders)) as one:
        visit(tab, one)
        wait(tab, "document.querySelectorAll('#map .path').length === 30")
        assert tab.run("document.getElementById('verdict').textContent") == "2 of 2 plans proven for every member"
        colours = "new Set([...document.querySelectorAll('#map .path')].map((one) => one.getAttribute('stroke'))).size"
        assert tab.run(colours) == 2
        assert tab.run("document.querySelectorAll('#map .own').length") == 2
        tab.run("document.querySelector('.plans input').click()")
        wait(tab, "document.querySelectorAll('#map .path').length === 15")
        assert tab.run(colours) == 1
        radius = "[...document.querySelectorAll('tr.differ')].map((row) => row.textContent).join(' ')"
        assert "fleet.radius0.050.1" in tab.run(radius)
        # nothing is edited: a drag on a shape moves the map
        assert tab.run("document.querySelectorAll('.editing').length") > 0
        assert tab.run("[...document.querySelectorAll('.editing')].every((one) => one.offsetParent === null)")
        before = tab.run("JSON.stringify(editor.map.view)")
        place = tab.run(
            "(() => { const r = document.querySelector('[data-name=wall] polygon').getBoundingClientRect();"
            " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        tab.drag(tuple(place), (place[0] - 40, place[1] + 20))
        assert tab.run("JSON.stringify(editor.map.view)") != before
        tab.screen(390, 800, dark=True)
        assert tab.run("document.documentElement.scrollWidth") <= 390
        tab.screen(1280, 900)
        asks_nobody(tab, one)
