"""Several starts on the map: dragged, and named by a counter-example."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.edit.changes import changed
from ensemble_ctrl.api.edit.drawing import drawing
from ensemble_ctrl.api.edit.shapes import starts
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.files.config.tree import Tree
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.report.browser import Page, chromium

from .editor import editor
from .test_page import BROWSER, TEXT, asks_nobody, at, choose, fill, wait
from .test_view import needs_browser, visit

BESIDE = """\
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [1, 0], heading: 0 deg}
  starts: {ann: [0, 0], bob: [0 m, -2 m], b from start ann: [0, 2]}   # beside it
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[0, 7], [-3, 3]]}}
obstacles: {block: {box: [[2.5, 3], [%s, %s]]}}
task: G in(goal) and G avoid(block)
verify: {members: 50}
"""


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as page:
        page.screen(1280, 900)
        yield page


@pytest.mark.parametrize(("name", "y"), [("ann", 0.0), ("bob", -2.0), ("b from start ann", 2.0)])
def test_a_counter_example_goes_from_its_own_start(name: str, y: float) -> None:
    problem = ec.load_text(BESIDE % (y - 0.2, y + 0.3))
    controls = np.tile([1.0, 0.0], (20, 1))
    plan = Plan(problem, controls, "planned", {}, replay(problem, controls), certify(problem, controls))
    (view,) = drawing(plan)["views"]
    counter = view["counter"]
    assert counter["text"].startswith(f"avoid(block) from start {name}: traction")
    assert counter["way"][0] == [1.0, y]
    assert np.ptp(np.array(counter["way"])[:, 1]) == 0  # straight ahead
    assert 2.5 <= counter["at"][0] <= 3
    assert counter["at"][1] == y


def test_starts_are_places_where_all_is_in_numbers() -> None:
    text = BESIDE % (1, 1.5)
    found = starts(Tree.read(text).data)
    assert [(one["name"], one["at"]) for one in found] == [
        ("ann", [1.0, 0.0]), ("bob", [1.0, -2.0]), ("b from start ann", [1.0, 2.0]),
    ]  # fmt: skip
    listed = text.replace("{ann: [0, 0], bob: [0 m, -2 m], b from start ann: [0, 2]}", "[[0, 0], [1, 1]]")
    found = starts(Tree.read(listed).data)
    assert [one["name"] for one in found] == ["s1", "s2"]
    assert [one["path"] for one in found] == [["fleet", "starts", 0], ["fleet", "starts", 1]]
    assert list(ec.load_text(listed).fleet.starts) == ["s1", "s2"]
    assert "[[0, 0], [2, 1]]" in changed(listed, [{"do": "put", "path": found[1]["path"], "value": [2, 1]}])
    for other in ("{grid: [2, 2], spacing: 1 m}", "[[0, 0], [x, 1]]", "[[0, 0, 0]]", "none", "{}"):
        assert starts(Tree.read(listed.replace("[[0, 0], [1, 1]]", other)).data) == []


@needs_browser
def test_starts_are_dragged_and_terrain_is_drawn(tab: Page, tmp_path: Path) -> None:
    file = tmp_path / "beside.yaml"
    file.write_text(BESIDE % (1, 1.5), encoding="utf-8")
    with editor(file) as one:
        visit(tab, one)
        tab.run("editor.map.fit(); editor.map.moved = true")  # and the view stays
        assert tab.run("document.querySelectorAll('#map .member-spot').length") == 3
        tab.drag(at(tab, 1, -2), at(tab, 1.5, -2.5))
        wait(tab, f"({TEXT}).includes('bob: [0.5 m, -2.5 m]') || ({TEXT}).includes('bob: [0.5, -2.5]')")
        assert "}   # beside it" in tab.run(TEXT)
        tab.key("ArrowUp", code=38)
        wait(tab, "Math.abs(editor.state.map.starts[1].at[1] + 2.45) < 1e-9")
        fill(tab, "document.getElementById('selected').elements.x", "60 cm")
        wait(tab, f"({TEXT}).includes('bob: [60 cm, ')")
        # the fleet's own start lies above ann's, and takes all along; ann is taken by her name
        tab.drag(at(tab, 1, 0), at(tab, 1.5, 0))
        wait(tab, "editor.state.map.start.at[0] === 1.5 && Math.abs(editor.state.map.starts[1].at[0] - 2.1) < 1e-9")
        wait(tab, "editor.map.dragged === null && !editor.changes.busy")
        x, y = at(tab, 1.5, 0)
        tab.drag((x + 20, y - 13), (at(tab, 1.5, 0.5)[0] + 20, at(tab, 1.5, 0.5)[1] - 13))
        wait(tab, "editor.state.map.starts[0].at[1] === 0.5 && editor.state.map.start.at[1] === 0")
        # out with one
        tab.key("Delete", code=46)
        wait(tab, "editor.state.map.starts.length === 2")
        # terrain has the fleet's range until it is given another
        fill(tab, "document.getElementById('kind')", "patch")
        choose(tab, "box")
        tab.drag(at(tab, 4, -2), at(tab, 5, -1))
        wait(tab, f"({TEXT}).includes('t1')")
        wait(tab, "document.querySelectorAll('#map .patch polygon').length === 1")
        wait(tab, "document.getElementById('selected').elements['value traction'] !== undefined")
        fill(tab, "document.getElementById('selected').elements['value traction']", "[0.7, 0.9]")
        wait(tab, "editor.state.valid && JSON.stringify(editor.state.map.data.terrain.t1.traction) === '[0.7,0.9]'")
        tab.drag(at(tab, 4.5, -1.5), at(tab, 4.5, -0.5))
        wait(tab, "JSON.stringify(editor.state.map.data.terrain.t1.box) === '[[4,5],[-1,0]]'")
        tab.run("document.getElementById('save').click()")
        wait(tab, "document.getElementById('dirty').hidden")
        asks_nobody(tab, one)
    problem = ec.load(file)
    assert list(problem.fleet.starts) == ["bob", "b from start ann"]
    assert list(problem.terrain) == ["t1"]
