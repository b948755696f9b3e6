"""``ensemble-plan import`` and ``export``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .conftest import Command
from .tools import left

TAKEN = "error: small.yaml: this exists already; add --overwrite to replace it\n"
YARD = {
    "type": "Feature",
    "properties": {"name": "shed"},
    "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3], [0, 0]]]},
}


@pytest.fixture
def yard(place: Path) -> Path:
    path = place / "yard.geojson"
    path.write_text(json.dumps(YARD))
    return path


def test_a_map_becomes_a_problem_that_is_sound(command: Command, yard: Path) -> None:
    done = command("import", "yard.geojson", "-o", "yard.yaml")
    assert (done.code, done.err) == (0, "")
    assert done.out == (
        "wrote yard.yaml: 1 obstacle in 2 convex pieces; now run: ensemble-plan check yard.yaml\n"
    )  # fmt: skip
    assert command("check", "yard.yaml").out == "yard.yaml: ok\n"


def test_a_map_is_printed_without_a_file(command: Command, yard: Path) -> None:
    whole, section = command("import", "yard.geojson"), command("import", "yard.geojson", "--section")
    assert whole.err == section.err == "yard.geojson: 1 obstacle in 2 convex pieces\n"
    assert section.out.startswith("obstacles:\n  shed:\n    - {")
    assert whole.out.endswith(section.out)
    grown = command("import", "yard.geojson", "--tolerance", "90 cm").out
    assert "grown by at most 0.9 m" in grown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothere.json"], "nothere.json: error: no such file\n1 error in nothere.json\n"),
        (["yard.geojson", "-o", "small.yaml"], TAKEN),
        (["yard.geojson", "-o", "none/a.yaml"], "error: none/a.yaml: can't be written (No such file or directory)\n"),
        (["yard.geojson", "--tolerance", "1 s"], "error: --tolerance: expected a length in m, cm, mm or km, got '1 s', "
         "which is a time\n"),
        (["yard.geojson", "--unknown", "maybe"], "error: --unknown: expected occupied or free, got 'maybe'\n"),
        (["small.yaml"], "small.yaml: error: resolution: expected a finite number above 0, got nothing\n    hint: for "
         "example  image: office.pgm, resolution: 0.05, origin: [-10, -10, 0]\n1 error in small.yaml\n"),
    ],
)  # fmt: skip
def test_mistakes_with_maps(command: Command, yard: Path, arguments: list[str], message: str) -> None:
    before = left(yard.parent)
    done = command("import", *arguments)
    assert (done.code, done.out, done.err) == (2, "", message)
    assert left(yard.parent) == before


def test_a_plan_is_printed_or_written(command: Command, results: Path) -> None:
    assert command("export", "results", "--to", "csv").out == (results / "controls.csv").read_text()
    data = json.loads(command("export", "results", "--to", "json", "--members", "2").out)
    assert (len(data["members"]), data["certificate"]["proven"]) == (2, "yes")
    done = command("export", "results", "-o", "tube.geojson")
    assert (done.code, done.out) == (0, "wrote tube.geojson\n")
    assert json.loads((results.parent / "tube.geojson").read_text())["features"][0]["properties"]["name"] == "fleet"


def test_a_bag_is_written(command: Command, results: Path) -> None:
    pytest.importorskip("rosbags")
    assert command("export", "results", "--to", "rosbag", "-o", "bag").code == 0
    assert sorted(path.name for path in (results.parent / "bag").iterdir()) == ["bag.db3", "metadata.yaml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["results"], "error: --to: expected one of csv, json, geojson, rosbag, got none\n"),
        (["results", "--to", "mat"], "error: --to: expected one of csv, json, geojson, rosbag, got 'mat'\n"),
        (["results", "--to", "rosbag"], "error: --to rosbag: a bag is a folder; say where with -o FOLDER\n"),
        (["results", "--to", "csv", "-o", "small.yaml"], TAKEN),
        (["results", "--to", "csv", "--members", "5000"], "error: members: expected a number from 0 to 1000, "
         "got 5000\n"),
    ],
)  # fmt: skip
def test_mistakes_with_exports(command: Command, results: Path, arguments: list[str], message: str) -> None:
    before = left(results.parent)
    done = command("export", *arguments)
    assert (done.code, done.out, done.err) == (2, "", message)
    assert left(results.parent) == before
