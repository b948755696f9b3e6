"""Systems in space on the page: from above and from the side, where heights are dragged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.files.config.tree import Tree
from tests.report.browser import Page, chromium

from .editor import editor
from .test_page import BROWSER, FRESH, TEXT, asks_nobody, wait
from .test_view import SMALL, needs_browser, visit

HOVER = """\
fleet:
  model: quadrotor
  parameters: {payload: {range: [0, 0.01]}}
  start: {position: [0, 0, 250 cm]}   # above the ground
  radius: 0.2 m
horizon: {duration: 0.4 s, steps: 4}
regions: {hall: {box: [[-2, 2], [-2, 2], [1, 5]]}}
obstacles:
  ground: {box: [[-4, 4], [-4, 4], [-1, 0]]}
  lamp: {box: [[2.4, 2.9], [0, 1], [4, 6]]}   # hangs
task: "G in(hall) and G avoid(obstacles)"
objective: {terminal: {target: [0, 0, 2.5], weight: 1}}
"""
SEEN = (
    "(() => { const s = editor.map.sides[0], r = s.svg.getBoundingClientRect(), p = s.at([%s, %s]);"
    " return [r.x + p[0], r.y + p[1]]; })()"
)


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as page:
        page.screen(1280, 1500)
        yield page


def seen(tab: Page, x: float, z: float) -> tuple[float, float]:
    """Pixels of a place in the side view."""
    found = tab.run(SEEN % (x, z))
    return float(found[0]), float(found[1])


def drag(tab: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """From a place of the side view to another, and until the text has it."""
    tab.drag(seen(tab, *begin), seen(tab, *end))
    wait(tab, "editor.map.dragged === null && !editor.changes.busy")


@needs_browser
def test_heights_are_dragged_in_the_side_view(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "hover.yaml"
    file.write_text(HOVER, encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        wait(tab, f"!document.getElementById('side').hidden && {FRESH}")
        assert tab.run("document.querySelector('#side figcaption').textContent") == "z [m] over x [m], seen along y"
        assert tab.run("document.querySelectorAll('#side .path').length") == 15
        drag(tab, (2.65, 5.0), (3.15, 4.0))  # along x, and down
        wait(tab, f"({TEXT}).includes('lamp: {{box: [[2.9, 3.4], [0, 1], [3, 5]]}}   # hangs')")
        drag(tab, (3.15, 3.0), (3.15, 2.0))  # its lower edge
        wait(tab, f"({TEXT}).includes('[[2.9, 3.4], [0, 1], [2, 5]]')")
        drag(tab, (0.0, 2.5), (0.5, 3.0))  # the start lies on the target
        wait(tab, "JSON.stringify(editor.state.map.start.at) === '[0.5,0,3]'")
        assert "]}   # above the ground" in tab.run(TEXT)
        tab.key("ArrowUp", code=38)
        wait(tab, "Math.abs(editor.state.map.start.at[2] - 3.05) < 1e-9")
        drag(tab, (0.0, 2.5), (0.0, 3.0))
        wait(tab, "editor.state.map.target.at[2] === 3")
        drag(tab, (-1.5, 4.0), (-1.5, 4.5))  # the region
        wait(tab, f"({TEXT}).includes('hall: {{box: [[-2, 2], [-2, 2], [1.5, 5.5]]}}')")
        # what is dragged from above keeps its height
        tab.run("editor.select(null)")
        wait(tab, f"editor.state.valid && {FRESH}")
        assert tab.run("document.getElementById('verdict').textContent").startswith("Plan found, proven")
        tab.run("document.getElementById('save').click()")
        wait(tab, "document.getElementById('dirty').hidden")
        asks_nobody(tab, one)
    problem = ec.load(file)
    assert problem.obstacles["lamp"][0].vertices[:, 2].tolist().count(2.0) == 4
    assert problem.fleet.start_place.tolist() == [0.5, 0.0, 3.05]
    assert Tree.read(file.read_text(encoding="utf-8")).data["regions"]["hall"]["box"][2] == [1.5, 5.5]


@needs_browser
def test_a_problem_without_a_plan_is_seen_from_the_side_too(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "hover.yaml"
    file.write_text(HOVER.replace("in(hall)", "in(nowhere)"), encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        wait(tab, "!document.getElementById('side').hidden")
        assert tab.run("document.querySelectorAll('#side .shape').length") == 5
        tab.screen(390, 800, dark=True)
        assert tab.run("document.documentElement.scrollWidth") <= 390
        tab.screen(1280, 1500)
        asks_nobody(tab, one)


@needs_browser
def test_a_problem_in_the_plane_becomes_one_in_space(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    file.write_text(SMALL, encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        wait(tab, FRESH)
        assert tab.run("document.getElementById('side').hidden")
        tab.run("(() => { const t = document.getElementById('text'); t.focus(); t.select(); })()")
        tab.type(HOVER)
        wait(tab, f"!document.getElementById('side').hidden && editor.state.valid && {FRESH}")
        assert tab.run("document.querySelectorAll('#side .path').length") == 15
        asks_nobody(tab, one)
