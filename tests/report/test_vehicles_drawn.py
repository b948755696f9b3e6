"""Zones, bodies and several starts on the page's map and in the film, compared with the problem's own geometry."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image, ImageColor

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.problem.evaluation.sampled import all_paths, headings
from ensemble_ctrl.report.animation import WIDTH
from ensemble_ctrl.report.html import report_html
from ensemble_ctrl.report.map_content import NAMED, MapContent, map_contents, moved_bodies
from ensemble_ctrl.report.palette import INSIDE, INSIDE_KEEP_OUT, INSIDE_SLOW
from ensemble_ctrl.report.raster import HEAD

from .test_page import Reader

ZONES = """
fleet: {model: unicycle, parameters: {}, start: {position: [0, 0], heading: 0 deg}, radius: 20 cm}
horizon: {duration: 4 s, steps: 8}
regions: {goal: {box: [[4, 6], [-1, 1]]}}
zones:
  slow: {box: [[1, 3], [-3, -1]], v: 0.3 m/s}
  store: {areas: [{box: [[1, 2], [1, 3]]}, {box: [[2, 3], [2, 3]]}], keep_out: true}
task: F[3, 4] in(goal)
"""
CARS = """
fleet:
  model: unicycle
  parameters: {}
  start: {position: [0, 0], heading: 90 deg}
  starts: {ann: [0, 0], "b<b": [4, 1]}
  footprint: {length: 4 m, width: 1 m, rear_overhang: 1 m}
horizon: {duration: 4 s, steps: 8}
task: G x >= -100
"""


def plan(text: str) -> Plan:
    """A plan of robots that turn left on their way."""
    return Plan(load_text(text), np.tile([0.8, 0.2], (8, 1)), "planned")


def view(plan: Plan) -> MapContent:
    """What the map shows."""
    paths, _ = all_paths(plan.problem, plan.controls, plan.problem.fleet.spread(1), 2)
    (content,) = map_contents(plan.problem, paths)
    return content


def corners(text: str) -> list[list[float]]:
    """Points of SVG."""
    return [[float(value) for value in point.split(",")] for point in text.split()]


def test_zones_are_distinct_from_regions_on_the_page() -> None:
    text = report_html(plan(ZONES), "")
    reader = Reader(text)
    assert len(reader.all("region")) == len(plan(ZONES).problem.regions)
    # drawn areas are those of the file: 4, 4, and 2 and 1 square metres
    shapes: dict[str | None, list[float]] = {a["class"]: [] for a in (*reader.all("region"), *reader.all("zone"))}
    for one in (*reader.all("region"), *reader.all("zone")):
        shapes[one["class"]].append(shapely.Polygon(corners(one["points"] or "")).area)
    (whole,) = shapes["region"]
    assert shapes["zone slow"] == pytest.approx([whole], rel=0.01)
    assert shapes["zone keep-out"] == pytest.approx([whole / 2, whole / 4], rel=0.01)
    assert {"slow: |v| <= 0.3 m/s", "store (1): keep out", "goal"} <= set(reader.text["text"])
    assert "Red: zones to keep out of. Amber: zones with a speed limit." in text
    limited = report_html(plan(re.sub("  store: .*", "", ZONES)), "")
    assert "Amber:" in limited
    assert "Red: zones" not in limited


def test_zones_are_distinct_from_regions_in_a_film(tmp_path: Path) -> None:
    whole = plan(ZONES)
    canvas = view(whole).canvas(WIDTH["gif"], top=HEAD)
    with Image.open(whole.animate(tmp_path / "a.gif", seconds=0.2)) as picture:
        pixels = picture.convert("RGB")
    for place, colour in (([5, 0.5], INSIDE), ([2, -2.5], INSIDE_SLOW), ([1.5, 1.3], INSIDE_KEEP_OUT)):
        x, y = canvas.at(np.array(place)).round().astype(int).tolist()
        assert pixels.getpixel((x, y)) == pytest.approx(ImageColor.getrgb(colour), abs=4)  # that of a palette


def test_starts_have_their_names_and_bodies() -> None:
    text = report_html(plan(CARS), "")
    reader = Reader(text)
    assert {"ann", "b<b"} <= set(reader.text["text"])
    assert "b<b" not in text
    # a body along +y: one metre behind the place, three before
    standing = [np.array(corners(one["points"] or "")) for one in reader.all("standing")]
    assert len(standing) == 2
    for shape in standing:
        width, height = np.ptp(shape, axis=0)
        assert height == pytest.approx(4 * width, rel=0.02)
    assert "bodies: where they are" in text
    # 1 m downwards on the page from ann to the other one's place
    assert (standing[0] - standing[1])[:, 1] == pytest.approx(width, abs=0.2)


def test_names_of_very_many_starts_are_left_out() -> None:
    places = ", ".join(f"[{k}, 0]" for k in range(NAMED + 1))
    many = plan(re.sub("starts: .*", f"starts: [{places}]", CARS))
    assert view(many).named_starts == {}
    assert len(view(many).starts) == NAMED + 1
    assert view(plan(ZONES)).named_starts == {}


def test_bodies_and_discs_are_on_the_map_all_the_way() -> None:
    whole = plan(CARS)
    paths, members = all_paths(whole.problem, whole.controls, whole.problem.fleet.spread(1), 2)
    turned = headings(whole.problem, whole.controls, members, 2)
    assert turned is not None
    bodies = np.concatenate(moved_bodies(whole.problem, paths, turned))
    svg = re.search(r'<svg class="map" viewBox="0 0 (\d+) (\d+)"', report_html(whole, ""))
    assert svg is not None
    canvas = view(whole).canvas(514, 46, more=[bodies])
    drawn = canvas.at(bodies)
    assert float(svg[2]) == pytest.approx(canvas.height + 40, abs=1)
    assert (drawn.min(axis=0) > [46, 0]).all()
    assert (drawn.max(axis=0) < [560, canvas.height]).all()
    discs = view(plan(re.sub("footprint: .*", "radius: 3 m", CARS)))
    ends = discs.canvas(400.0).at(np.concatenate([discs.paths[0] - 3, discs.paths[0] + 3]))
    assert (ends > 0).all()
    assert (ends[:, 0] < 400).all()
