"""The editor's page in a real browser: draw, drag, prove, save."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.files.config.tree import Tree
from tests.paths import ROOT
from tests.report.browser import Page, chromium, executable

from .editor import Editor, editor

BROWSER = executable()
pytestmark = pytest.mark.skipif(BROWSER is None and "CI" not in os.environ, reason="no headless Chromium here")
FIVE = (ROOT / "configs" / "five_obstacles.yaml").read_text(encoding="utf-8")
FRESH = "document.documentElement.dataset.fresh === 'yes'"
IDLE = "document.documentElement.dataset.phase === 'idle'"
VERDICT = "document.getElementById('verdict').textContent"
TEXT = "document.getElementById('text').value"
PLACE = (
    "(() => { const r = document.querySelector('[data-name=\"%s\"] :is(polygon, .grip)').getBoundingClientRect();"
    " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
)
ON_MAP = "(() => { const r = document.getElementById('map').getBoundingClientRect(); const p = editor.map.at(%s);"
ON_MAP += " return [r.x + p[0], r.y + p[1]]; })()"


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as page:
        page.screen(1280, 900)
        yield page


def wait(tab: Page, condition: str, seconds: float = 45.0) -> None:
    """Until something holds on the page."""
    end = time.monotonic() + seconds
    while not tab.run(condition):
        assert time.monotonic() < end, (condition, tab.run(VERDICT), tab.complaints)
        time.sleep(0.03)


def visit(tab: Page, one: Editor) -> None:
    """Open the editor's page, and wait until it shows the file."""
    tab.visit("about:blank")
    tab.complaints.clear()
    tab.requests.clear()
    tab.visit(one.address)
    wait(tab, "window.editor && editor.state !== null")


def at(tab: Page, x: float, y: float) -> tuple[float, float]:
    """Pixels of a place of the map in metres."""
    found = tab.run(ON_MAP % json.dumps([x, y]))
    return float(found[0]), float(found[1])


def middle(tab: Page, name: str) -> tuple[float, float]:
    """Pixels of a shape's middle."""
    found = tab.run(PLACE % name)
    return float(found[0]), float(found[1])


def choose(tab: Page, tool: str) -> None:
    tab.run(f"document.querySelector('[data-tool={tool}]').click()")


def fill(tab: Page, field: str, value: Any) -> None:
    """Type a value into a field, as a person leaves it."""
    script = (
        f"(() => {{ const e = {field}; e.value = {json.dumps(str(value))}; e.dispatchEvent(new Event('change')); }})()"
    )
    tab.run(script)


def asks_nobody(tab: Page, one: Editor) -> None:
    """No request left the machine, and the console is empty."""
    assert [url for url in tab.requests if not url.startswith((one.origin, "about:", "data:"))] == []
    assert tab.complaints == []


def boxes(text: str) -> Any:
    return {name: shape["box"] for name, shape in Tree.read(text).data["obstacles"].items()}


def drags(tab: Page, folder: Path, count: int) -> None:
    """Drag an obstacle to and fro, see each proof, save, reload and compare."""
    file = folder / "five.yaml"
    file.write_text(FIVE, encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        wait(tab, f"{FRESH} && {IDLE}")
        for k in range(count):
            before = boxes(tab.run(TEXT))["o3"]
            start = middle(tab, "o3")
            tab.drag(start, (start[0] + (24, -30, 6)[k % 3], start[1] + (-14, 20, -6)[k % 3]), 4)
            wait(tab, f"({TEXT}).includes('o3') && editor.map.dragged === null && {FRESH}")
            assert boxes(tab.run(TEXT))["o3"] != before
            assert tab.run(VERDICT).startswith("Plan found, proven for every member"), tab.run(VERDICT)
            assert tab.run("document.querySelectorAll('#map .plan:not(.old) .path').length") == 15
        shown = tab.run(TEXT)
        assert shown.count("#") == FIVE.count("#")  # every comment is there
        tab.key("s", modifiers=2, code=83)
        wait(tab, "document.getElementById('dirty').hidden")
        assert file.read_text(encoding="utf-8") == shown
        tab.reload()
        wait(tab, f"window.editor && editor.state !== null && {FRESH}")
        assert tab.run(TEXT) == shown
        box = tab.run("editor.state.map.shapes.find((s) => s.name === 'o3').points")
        low, high = (
            ec.load(file).obstacles["o3"][0].vertices.min(axis=0),
            ec.load(file).obstacles["o3"][0].vertices.max(axis=0),
        )
        assert box == [[low[0], high[0]], [low[1], high[1]]]
        asks_nobody(tab, one)


def test_drag_an_obstacle_and_see_each_proof(tab: Page, tmp_path: Path) -> None:
    drags(tab, tmp_path, 4)


@pytest.mark.slow
def test_drag_an_obstacle_fifty_times(tab: Page, tmp_path: Path) -> None:
    drags(tab, tmp_path, 50)


def test_draw_a_problem_from_nothing(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "new.yaml"
    with editor(file) as one:
        visit(tab, one)
        tab.run("editor.map.fit(); editor.map.moved = true")  # and the view stays
        choose(tab, "waypoint")
        tab.click(*at(tab, 4.0, 2.0))
        wait(tab, "editor.state.valid")
        choose(tab, "box")
        tab.drag(at(tab, 1.5, 0.3), at(tab, 2.2, 1.2))
        wait(tab, "editor.state.map.shapes.length === 2")
        choose(tab, "polygon")
        for x, y in ((2.6, 3.4), (3.4, 3.4), (3.0, 2.6)):
            tab.click(*at(tab, x, y))
        tab.key("Enter", code=13)
        wait(tab, "editor.state.map.shapes.length === 3")
        choose(tab, "disc")
        tab.drag(at(tab, 5.0, 4.0), at(tab, 5.4, 4.0))
        wait(tab, "editor.state.map.shapes.length === 4")
        choose(tab, "start")
        tab.click(*at(tab, 0.5, -0.5))
        wait(tab, "editor.state.map.start.at[0] === 0.5")
        turned = at(tab, 0.5, -0.5)
        tab.drag((turned[0] + 46, turned[1]), (turned[0], turned[1] - 60))
        wait(tab, "Math.abs(editor.state.map.start.heading - Math.PI / 2) < 1e-6")
        choose(tab, "target")
        tab.click(*at(tab, 4.0, 2.0))
        wait(tab, f"editor.state.map.target !== null && {FRESH}")
        assert tab.run(VERDICT).startswith("Plan found, proven for every member"), tab.run(VERDICT)
        tab.run("document.getElementById('save').click()")
        wait(tab, "document.getElementById('dirty').hidden")
        asks_nobody(tab, one)
    problem = ec.load(file)
    assert set(problem.obstacles) == {"o1", "o2", "o3"}
    assert "avoid(obstacles)" in str(problem.task)
    assert "in(w1)" in str(problem.task)
    assert Tree.read(file.read_text(encoding="utf-8")).data["obstacles"]["o3"] == {
        "disc": {"center": [5, 4], "radius": 0.4}
    }


def test_typed_numbers_keys_undo_and_errors_in_the_text(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "five.yaml"
    file.write_text(FIVE, encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        tab.click(*middle(tab, "o5"))
        wait(tab, "!document.getElementById('selected').hidden")
        fill(tab, "document.getElementById('selected').elements.x1", "680 cm")
        wait(tab, f"({TEXT}).includes('o5: {{box: [[5.6, 680 cm], [2.2, 3.4]]}}')")
        tab.click(*middle(tab, "o1"))
        tab.key("ArrowLeft", code=37)
        wait(tab, f"({TEXT}).includes('o1: {{box: [[1.95, 2.95], [1.5, 3.0]]}}')")
        tab.key("z", modifiers=2, code=90)
        wait(tab, f"({TEXT}).includes('o1: {{box: [[2.0, 3.0], [1.5, 3.0]]}}')")
        tab.click(*middle(tab, "o4"))
        tab.key("Delete", code=46)
        wait(tab, f"!({TEXT}).includes('o4')")
        assert tab.run("editor.state.valid")
        tab.run("document.getElementById('undo').click()")
        wait(tab, f"({TEXT}).includes('o4')")
        # a wave under what is wrong, and its place in words
        tab.run("(() => { const t = document.getElementById('text'); t.focus(); const k = t.value.indexOf('unicycle');"
                " t.setSelectionRange(k, k + 8); })()")  # fmt: skip
        tab.type("unicicle")
        wait(tab, "!editor.state.valid")
        assert tab.run("document.querySelector('#under u').textContent") == "unicicle"
        assert tab.run("document.querySelector('#found button').textContent") == "8:10"
        assert "unicicle" in tab.run(VERDICT)
        assert tab.run("document.querySelectorAll('#map .plan.old, #map .shape').length") > 6
        tab.run("document.getElementById('undo').click()")
        wait(tab, f"editor.state.valid && ({TEXT}).includes('unicycle')")
        # the panel and the task's pieces
        tab.run("document.querySelector('[data-tab=settings]').click()")
        fill(tab, "document.querySelector('[data-path=\"horizon.duration\"]')", "17 s")
        wait(tab, f"({TEXT}).includes('duration: 17 s')")
        tab.run("document.querySelector('[data-tab=task]').click()")
        fill(tab, "document.querySelector('.pieces .visit [aria-label=\"end of the window\"]')", "T")
        wait(tab, f"({TEXT}).includes('F[14, T] in(goal)')")
        assert tab.run("editor.state.valid")
        asks_nobody(tab, one)


def test_what_would_help_is_a_button_and_time_moves_the_fleet(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "five.yaml"
    file.write_text(FIVE, encoding="utf-8")
    helps = [{"change": "2 cm less radius", "set": ["fleet.radius=0.02", "fleet.input_bounds.v[1]=2.5"]}]
    with editor(file) as one:
        visit(tab, one)
        wait(tab, FRESH)
        revision = tab.run("editor.state.revision")
        found = {
            "revision": revision,
            "phase": "suggested",
            "helps": helps,
            "failed": ["0.5 of the range"],
            "limited": False,
        }
        tab.run(f"editor.planned({json.dumps(found)})")
        assert tab.run("document.querySelector('#hint .help').textContent") == "2 cm less radius"
        tab.run("document.querySelector('#hint .help').click()")
        wait(tab, f"({TEXT}).includes('radius: 0.02 ') && ({TEXT}).includes('v: [-2, 2.5]')")
        wait(tab, FRESH)
        places = "[...document.querySelectorAll('#map .member')].map((dot) => +dot.getAttribute('cx'))"
        tab.run("document.getElementById('time').value = 0; document.getElementById('time').oninput()")
        first = tab.run(places)
        assert max(first) - min(first) < 0.2  # all start at one place
        tab.run("document.getElementById('play').click()")
        wait(tab, f"Math.max(...{places}) > {max(first) + 5}")
        tab.run("document.getElementById('play').click()")
        assert tab.run("document.getElementById('play').textContent") == "Play"
        yard = (ROOT / "configs" / "maps" / "yard.geojson").read_text(encoding="utf-8")
        tab.run(f"editor.map.tools.bring(new File([{json.dumps(yard)}], 'yard.geojson'))")
        wait(tab, f"({TEXT}).includes('greenhouse') && editor.state.valid")
        asks_nobody(tab, one)


def test_names_that_would_be_scripts_do_nothing(tab: Page, tmp_path: Path) -> None:
    bad = "<img src=x onerror=alert(1)>"
    file = tmp_path / "bad.yaml"
    text = FIVE.replace("name: five_obstacles", f"name: '{bad}'").replace("  o1:", f'  "{bad}":')
    file.write_text(text.replace("in(goal)", f"in({bad})"), encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        for name in ("task", "settings", "proof", "text"):
            tab.run(f"document.querySelector('[data-tab={name}]').click()")
        assert tab.run("document.querySelectorAll('img').length") == 0
        assert bad in tab.run("document.getElementById('map').textContent")
        # names that a file may have, shown in the proof's words and charts
        tab.run("(() => { const t = document.getElementById('text'); t.focus(); t.select(); })()")
        tab.type(FIVE.replace("name: five_obstacles", "name: 'a&b;'").replace("traction: {range", "traction: {range"))
        wait(tab, f"editor.state.valid && {FRESH}")
        asks_nobody(tab, one)


def test_two_pages_edit_one_file_and_the_planner_is_killed_under_way(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "five.yaml"
    file.write_text(FIVE, encoding="utf-8")
    assert BROWSER is not None
    with editor(file) as one, chromium(BROWSER) as other:
        other.screen(390, 800, dark=True)
        visit(tab, one)
        visit(other, one)
        start = middle(tab, "o2")
        tab.drag(start, (start[0] + 20, start[1]), 3)
        for pid in one.children():
            os.kill(pid, signal.SIGKILL)
        wait(tab, f"editor.map.dragged === null && ({TEXT}).indexOf('o2: {{box: [[3.6') < 0")
        shown = tab.run(TEXT)
        wait(other, f"({TEXT}) === {json.dumps(shown)}")
        wait(tab, FRESH)
        wait(other, FRESH)
        assert other.run(VERDICT) == tab.run(VERDICT)
        # nothing is wider than a phone
        assert other.run("document.documentElement.scrollWidth") <= 390
        # a change on disk while there is something unsaved is asked about on both
        file.write_text(FIVE + "# theirs\n", encoding="utf-8")
        wait(other, "!document.getElementById('notice').hidden")
        wait(tab, "document.getElementById('notice').textContent.includes('changed on disk')")
        assert file.read_text(encoding="utf-8").endswith("# theirs\n")
        tab.run("document.querySelector('#notice button').click()")
        wait(other, f"({TEXT}).endsWith('# theirs\\n')")
        asks_nobody(tab, one)
        asks_nobody(other, one)
