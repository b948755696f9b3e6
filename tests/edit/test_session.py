"""The text that is edited: changes, checks, undo, and its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ensemble_ctrl.api.edit.changes import changed
from ensemble_ctrl.api.edit.disk import Disk, DiskChangedError
from ensemble_ctrl.api.edit.importing import imported
from ensemble_ctrl.api.edit.session import Session, StaleError
from ensemble_ctrl.api.edit.shapes import shapes, start
from ensemble_ctrl.api.edit.tasks import pieces, task_of
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError, EnsembleError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.files.config.tree import Tree
from tests.paths import ROOT

FIVE = ROOT / "configs" / "five_obstacles.yaml"
O3 = ["obstacles", "o3", "box"]


def session(folder: Path, text: str | None = None) -> Session:
    file = folder / "mine.yaml"
    file.write_text(text or FIVE.read_text(encoding="utf-8"), encoding="utf-8", newline="")
    return Session(Disk(file))


def put(path: list[Any], value: Any) -> list[dict[str, Any]]:
    return [{"do": "put", "path": path, "value": value}]


def test_a_dragged_box_changes_its_numbers_and_nothing_else(tmp_path: Path) -> None:
    edited = session(tmp_path)
    before = edited.text.splitlines()
    edited.edit(put(O3, [[4.5, 5.5], [3.2, 4.4]]))
    differing = [pair for pair in zip(before, edited.text.splitlines(), strict=True) if pair[0] != pair[1]]
    assert differing == [("  o3: {box: [[4.0, 5.0], [3.2, 4.4]]}", "  o3: {box: [[4.5, 5.5], [3.2, 4.4]]}")]
    assert edited.checked.problem is not None
    assert edited.dirty
    edited.save()
    assert not edited.dirty
    assert (tmp_path / "mine.yaml").read_text(encoding="utf-8") == edited.text


def test_a_drag_is_one_step_for_undo(tmp_path: Path) -> None:
    edited = session(tmp_path)
    for k in range(5):
        edited.edit(put([*O3, 0, 0], 4.0 + k / 100), "drag 1")
    edited.edit(put([*O3, 0, 0], 3.0), "drag 2")
    edited.undo()
    assert "[[4.04, 5.0]" in edited.text
    edited.undo()
    assert not edited.dirty
    assert not edited.state()["undo"]
    edited.redo()
    edited.redo()
    assert "[[3.0, 5.0]" in edited.text
    assert not edited.state()["redo"]


def test_errors_have_line_and_column_and_the_map_stays(tmp_path: Path) -> None:
    edited = session(tmp_path)
    edited.replace(edited.text.replace("unicycle", "unicicle"), 1)
    state = edited.state()
    assert not state["valid"]
    assert (state["found"][0]["line"], state["found"][0]["column"]) == (8, 10)
    assert len(state["map"]["shapes"]) == 6
    edited.replace("a: [", edited.revision)
    assert len(edited.state()["map"]["shapes"]) == 6  # what was drawn last
    edited.replace("", edited.revision)
    assert not edited.state()["valid"]


def test_a_text_from_an_older_one_is_refused(tmp_path: Path) -> None:
    edited = session(tmp_path)
    edited.edit(put(O3, [[4.5, 5.5], [3.2, 4.4]]))
    with pytest.raises(StaleError, match="changed elsewhere"):
        edited.replace("version: 1\n", 1)
    assert "4.5" in edited.text


def test_a_file_changed_on_disk_is_noticed_and_never_overwritten_silently(tmp_path: Path) -> None:
    edited, file = session(tmp_path), tmp_path / "mine.yaml"
    other = edited.text.replace("16 s, steps", "17 s, steps")
    file.write_text(other, encoding="utf-8")
    edited.look()  # nothing was unsaved
    assert edited.text == other
    edited.edit(put(["name"], "mine"))
    file.write_text(other + "# theirs\n", encoding="utf-8")
    edited.look()
    assert edited.state()["disk"] == "changed"
    with pytest.raises(DiskChangedError, match="changed on disk"):
        edited.save()
    assert file.read_text(encoding="utf-8") == other + "# theirs\n"
    edited.reload()
    assert edited.text.endswith("# theirs\n")
    edited.undo()
    assert "name: mine" in edited.text  # loading it can be undone
    edited.save()
    file.unlink()
    edited.look()
    assert edited.state()["disk"] == "missing"
    edited.save()
    assert file.exists()


def test_a_file_that_can_not_be_read_any_more_leaves_the_text(tmp_path: Path) -> None:
    edited = session(tmp_path)
    before = edited.text
    (tmp_path / "mine.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        edited.look()
    assert edited.text == before
    assert edited.state()["disk"] == "changed"
    with pytest.raises(DiskChangedError):
        edited.save()


def test_line_ends_and_a_byte_order_mark_are_kept(tmp_path: Path) -> None:
    text = "\ufeff" + FIVE.read_text(encoding="utf-8").replace("\n", "\r\n")
    edited = session(tmp_path, text)
    edited.edit(put([*O3, 0, 0], 4.25))
    edited.save()
    assert (tmp_path / "mine.yaml").read_bytes() == text.replace("o3: {box: [[4.0", "o3: {box: [[4.25").encode()


def test_a_link_is_followed_once_and_stays_one(tmp_path: Path) -> None:
    session(tmp_path)
    (tmp_path / "link.yaml").symlink_to("mine.yaml")
    edited = Session(Disk(tmp_path / "link.yaml"))
    edited.edit(put(["name"], "linked"))
    edited.save()
    assert (tmp_path / "link.yaml").is_symlink()
    assert "name: linked" in (tmp_path / "mine.yaml").read_text(encoding="utf-8")


def test_names_change_wherever_they_are(tmp_path: Path) -> None:
    edited = session(tmp_path)
    edited.edit([{"do": "rename", "path": ["regions", "goal"], "name": "dock"}])
    assert 'task: "F[14, 16] in(dock)' in edited.text
    assert edited.checked.problem is not None
    edited.edit([{"do": "remove", "path": ["obstacles", "o1"]}])
    assert edited.checked.problem is not None
    edited.edit([{"do": "remove", "path": ["regions", "dock"]}])
    assert pieces(edited.checked.data["task"])[0]["kind"] == "avoid"  # type: ignore[index]


@pytest.mark.parametrize(
    "task",
    [
        "F[14, 16] in(goal) and G[0, 16] avoid(obstacles)",
        "F in(goal) and (x >= 1 or y <= 2) and G[0, T-2] in(goal)",
        "share(0.9, F in(goal)) and mean(x >= 1) and not in(goal)",
        "(in(goal) => F[0, 2] x >= 3) and G avoid(goal) and (x >= 1 U[0, 3] y >= 2)",
    ],
)
def test_pieces_of_a_task_are_the_task(task: str) -> None:
    found = pieces(task)
    assert found is not None
    assert parse(task_of(found)) == parse(task)
    assert all(piece["kind"] in ("visit", "stay", "avoid", "other") for piece in found)


@pytest.mark.parametrize(
    "edits",
    [
        [{"do": "run"}], [{"do": "put", "path": []}], [{"do": "put", "path": ["a"], "value": None}], ["x"],
        {"do": "put"},
        [{"do": "put", "path": [True], "value": 1}], [{"do": "text", "path": ["name"], "value": "a: ["}],
        [{"do": "put", "path": ["name"], "value": float("inf")}], [{"do": "task", "pieces": []}],
        [{"do": "rename", "path": ["fleet", "model"], "name": "x"}], [{"do": "put", "path": ["a"] * 21, "value": 1}],
        [{"do": "task", "pieces": [{"kind": "visit", "place": "goal", "window": ["1) or in(x", "2"]}]}],
    ],
)  # fmt: skip
def test_requests_that_are_none_change_nothing(tmp_path: Path, edits: Any) -> None:
    edited = session(tmp_path)
    with pytest.raises(EnsembleError):
        edited.edit(edits)
    assert not edited.dirty


def test_the_text_has_a_limit(tmp_path: Path) -> None:
    edited = session(tmp_path)
    with pytest.raises(EnsembleError, match="1 MB"):
        edited.replace("#" * 1_000_001, 1)
    with pytest.raises(ConfigError, match="folder"):
        Session(Disk(tmp_path))


def test_numbers_with_units_are_read_for_the_map() -> None:
    data = Tree.read(
        "regions: {a: {box: [[50 cm, 1], [0, 2 m]]}, b: {halfspaces: ['x >= 1', 'x <= 2', 'y >= 0', 'y <= 1']}}\n"
        "obstacles: {c: [{box: [[0, 1], [0, 1]]}, {polygon: [[0, 0], [1, 0], [0, 1]]}], d: {wkt: 'x'}, e: 3}\n"
        "fleet: {start: {position: [100 cm, 2], heading: 90 deg, heading_from: y}}\n"
    ).data
    found = {(shape["name"], shape["form"]): shape for shape in shapes(data, None)}
    assert found["a", "box"]["points"] == [[0.5, 1.0], [0.0, 2.0]]
    assert found["c", "polygon"]["path"] == ["obstacles", "c", 1, "polygon"]
    assert {name for name, form in found if form == "fixed"} == {"b", "d", "e"}
    found_start = start(data)
    assert found_start is not None
    assert (found_start["at"], found_start["heading"], found_start["clockwise"]) == ([1.0, 2.0], 0.0, True)
    apart = start({"fleet": {"start": {"x": 1, "y": "50 cm", "vx": 0}}})
    assert apart is not None
    assert (apart["at"], apart["paths"]) == ([1.0, 0.5], [["fleet", "start", "x"], ["fleet", "start", "y"]])


def test_discs_zones_and_terrain_are_dragged_too() -> None:
    data = Tree.read(
        "obstacles: {oak: {disc: {center: [1, 2 m], radius: 40 cm}}, mixed: [{box: [[0, 1], [0, 1]]}, {wkt: x}]}\n"
        "zones: {slow: {areas: [{box: [[0, 1], [0, 1]]}, {box: [[2, 3], [0, 1]]}], v: 1}}\n"
        "terrain: {mud: {polygon: [[0, 0], [1, 0], [0, 1]], traction: [0.5, 1]}}\n"
    ).data
    found = {(shape["kind"], shape["name"], *map(str, shape["path"])): shape for shape in shapes(data, None)}
    oak = found["obstacle", "oak", "obstacles", "oak", "disc"]
    assert (oak["points"], oak["radius"]) == ([[1.0, 2.0]], 0.4)
    assert found["obstacle", "mixed", "obstacles", "mixed"]["form"] == "fixed"
    assert found["zone", "slow", "zones", "slow", "areas", "1", "box"]["points"] == [[2.0, 3.0], [0.0, 1.0]]
    assert found["patch", "mud", "terrain", "mud", "polygon"]["form"] == "polygon"


def test_a_map_becomes_areas_under_free_names(tmp_path: Path) -> None:
    edited = session(tmp_path)
    content = (ROOT / "configs" / "maps" / "yard.geojson").read_text(encoding="utf-8")
    edited.edit(imported("../../yard.geojson", content, edited))
    problem = load_text(edited.text)
    assert len(problem.obstacles) > 5
    with pytest.raises(EnsembleError, match=r"\.geojson"):
        imported("map.yaml", "image: x.pgm", edited)
    with pytest.raises(EnsembleError):
        imported("map.wkt", "POLYGON ((", edited)


def test_changes_are_made_one_after_the_other() -> None:
    text = changed("", [*put(["regions", "r1"], {"box": [[0, 1], [0, 1]]}), {"do": "task", "pieces": [
        {"kind": "visit", "place": "r1", "window": ["1 s", "T"]}]}])  # fmt: skip
    assert text == 'regions:\n  r1: {box: [[0, 1], [0, 1]]}\ntask: "F[1 s, T] in(r1)"\n'
