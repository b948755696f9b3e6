"""Problem files: what is read, and what a person sees when one is wrong."""

from __future__ import annotations

import io
import itertools
import json
import math
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files import config
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.problem import Problem, ReportOptions, SolveOptions, VerifyOptions
from ensemble_ctrl.problem.arguments.units import quantity
from ensemble_ctrl.systems import SYSTEMS
from tests.examples import examples
from tests.paths import CONFIGS

FIVE = CONFIGS / "five_obstacles.yaml"
GOOD = """\
name: small
fleet:
  model: unicycle
  start: {position: [1.0, 1.0], heading: 45 deg}
  radius: 0 m
horizon: {duration: 16 s, steps: 160}
moments: {order: 8}
regions:
  goal: {box: [[6.0, 7.0], [5.0, 6.0]]}
obstacles:
  o1: {box: [[2.0, 3.0], [1.5, 3.0]]}
task: "F[14, 16] in(goal) and G[0, 16] avoid(obstacles)"
"""
LEAST = """\
fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}
horizon: {duration: 4 s}
task: F x >= 1
"""
SHAPES = """\
name: '1e-3'
fleet:
  model: unicycle
  start: {position: [0.1, 0.2], heading: 33.3 deg, heading_from: y}
horizon: {duration: 10}
regions:
  tri: {polygon: [[6, 5], [7.1, 5], [6, 6.3]]}
  half: {halfspaces: [0.3*x + 0.7*y >= 1.1, x <= 9, y <= 8]}
obstacles:
  corner: {polygon: [[3, 3], [5.3, 3], [5, 4.1], [4, 4], [4, 5], [3.7, 5]]}
  cut: {halfspaces: [x >= 3, 3*y >= 1, x + y <= 5]}
  two: [{box: [[8, 9], [0.1, 0.3]]}, {wkt: "POLYGON ((8 2, 9 2, 8.5 3, 8 2))"}]
report: {baseline: true}
task: F in(tri) and G[0, T] avoid(obstacles) => (in(half) U[1, 2.5] x - 2*y <= 1e-3) or share(0.95, F x >= 1)
objective: {terminal: {target: [6.1, 5.2]}}
"""


def edited(*changes: tuple[str, str]) -> str:
    """The good file with some text replaced."""
    text = GOOD
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def errors(text: str, *overrides: str) -> list[config.Diagnostic]:
    """What is wrong with a text."""
    with pytest.raises(ConfigError) as refusal:
        config.load_text(text, "bad.yaml", overrides)
    return list(refusal.value.diagnostics)


def only(text: str, *overrides: str) -> config.Diagnostic:
    """The one thing that is wrong with a text."""
    (error,) = errors(text, *overrides)
    return error


def place(error: config.Diagnostic) -> tuple[int | None, int | None, str]:
    """Line, column and path."""
    return error.line, error.column, error.path


# --- what is read


def test_the_example() -> None:
    problem = config.load(FIVE)
    assert (problem.name, problem.duration, problem.steps, problem.order) == ("five_obstacles", 16.0, 160, 8)
    assert problem.fleet.heading == math.pi / 4
    assert problem.fleet.position.tolist() == [1.0, 1.0]
    assert (problem.fleet.lower[0], problem.fleet.upper[0]) == (0.9, 1.1)
    assert problem.fleet.input_lower.tolist() == [-2.0, -2.0]
    assert list(problem.obstacles) == ["o1", "o2", "o3", "o4", "o5"]
    assert problem.obstacles["o2"][0].vertices.min(axis=0).tolist() == [3.6, 0.2]
    assert problem.regions["goal"].upper.tolist() == [7.0, 6.0]
    assert problem.task == parse("F[14, 16] in(goal) and G[0, 16] avoid(obstacles)")
    assert problem.objective.place is not None
    assert (problem.objective.place.tolist(), problem.objective.terminal) == ([6.5, 5.5], 10.0)
    assert config.read(FIVE).warnings == ()


def test_only_four_things_are_required() -> None:
    problem = config.load_text(LEAST)
    assert problem.steps == 40
    assert problem.order is None
    assert problem.solve == SolveOptions()
    assert problem.verify == VerifyOptions()
    assert problem.report == ReportOptions()
    assert (problem.fleet.lower[0], problem.fleet.upper[0]) == (0.9, 1.1)
    assert problem.fleet.input_upper.tolist() == [2.0, 2.0]
    assert problem.objective.target is None


def test_a_heading_from_y_counts_clockwise() -> None:
    problem = config.load_text(LEAST.replace("heading: 0", "heading: 30 deg, heading_from: y"))
    assert problem.fleet.arcs.heading_from == "y"
    assert problem.fleet.heading == pytest.approx(math.pi / 3)
    assert problem.fleet.own_heading == pytest.approx(math.pi / 6)


def test_figures_may_show_the_baseline() -> None:
    assert config.load_text(GOOD, overrides=["report.baseline=true"]).report == ReportOptions(baseline=True)
    assert config.load(FIVE).report.baseline


def test_scientific_notation_is_a_number() -> None:
    assert config.load_text(GOOD, overrides=["fleet.radius=1e-3"]).fleet.radius == 0.001
    assert config.load_text(edited(("radius: 0 m", "radius: 1e-3"))).fleet.radius == 0.001


@pytest.mark.parametrize("word", ["off", "yes", "No", "14:30", "2024-01-01", "0x10", "1_000"])
def test_words_stay_words(word: str) -> None:
    if ":" not in word:
        assert config.load_text(f"name: {word}\n{LEAST}").name == word
    wrong = only(LEAST.replace("heading: 0", f"heading: {word}"))
    assert place(wrong) == (1, LEAST.index("heading: 0") + 10, "fleet.start.heading")
    assert wrong.message == f"expected an angle in rad or deg, got {word!r}"


def test_the_file_may_come_from_stdin_or_an_open_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(LEAST.encode())))
    assert config.load("-").name == "stdin"
    assert config.load(io.StringIO(LEAST)).steps == 40
    assert config.load(io.BytesIO(LEAST.encode())).steps == 40


def test_other_line_ends_and_a_byte_order_mark(tmp_path: Path) -> None:
    file = tmp_path / "win.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + LEAST.replace("\n", "\r\n").encode())
    assert config.load(file).name == "win"


CORNER = "[[3, 3], [5, 3], [5, 4], [4, 4], [4, 5], [3, 5]]"
CORNER_WKT = "POLYGON ((3 3, 5 3, 5 4, 4 4, 4 5, 3 5, 3 3))"


@pytest.mark.parametrize(
    "shape",
    [
        f"{{polygon: {CORNER}}}",
        f"{{wkt: '{CORNER_WKT}'}}",
        "{wkt: 'MULTIPOLYGON (((3 3, 5 3, 5 4, 3 4, 3 3)), ((3 4, 4 4, 4 5, 3 5, 3 4)))'}",
        "[{box: [[3, 5], [3, 4]]}, {halfspaces: [x >= 3, x <= 4, y >= 4, y <= 5]}]",
        "{file: map.geojson}",
        "{file: map.wkt}",
    ],
)
def test_every_form_of_an_obstacle_that_is_not_convex(shape: str, tmp_path: Path) -> None:
    (tmp_path / "map.wkt").write_text(CORNER_WKT)
    ring = [[3, 3], [5, 3], [5, 4], [4, 4], [4, 5], [3, 5], [3, 3]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    (tmp_path / "map.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    file = tmp_path / "problem.yaml"
    file.write_text(edited(("{box: [[2.0, 3.0], [1.5, 3.0]]}", shape)))
    pieces = config.load(file).obstacles["o1"]
    assert len(pieces) == 2
    inside = [min(float(piece.distance(p)) for piece in pieces) < 0 for p in ([3.5, 4.5], [4.5, 3.5], [4.5, 4.5])]
    assert inside == [True, True, False]


def test_regions_by_corners_and_by_inequalities() -> None:
    for shape in ("{polygon: [[6, 5], [7, 5], [6, 6]]}", '{halfspaces: [x >= 6, "y >= 5", x + y <= 12]}'):
        goal = config.load_text(edited(("{box: [[6.0, 7.0], [5.0, 6.0]]}", shape))).regions["goal"]
        assert goal.contains([[6.2, 5.2], [6.8, 5.8], [5.9, 5.2]]).tolist() == [True, False, False]


# --- units


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("length", "35 cm", 0.35),
        ("length", "1e-3km", 1.0),
        ("length", "-2 mm", -0.002),
        ("time", "2 min", 120.0),
        ("time", " 500 ms ", 0.5),
        ("time", "1 h", 3600.0),
        ("angle", "180 deg", math.pi),
        ("angle", "2 rad", 2.0),
        ("speed", "0.5 m/s", 0.5),
        ("speed", "36 km / h", 10.0),
        ("turn rate", "180 deg/s", math.pi),
        ("number", ".5", 0.5),
    ],
)
def test_units(kind: str, text: str, value: float) -> None:
    assert quantity(kind)(text) == value


FACTORS = {"m": ("length", 1.0), "cm": ("length", 0.01), "s": ("time", 1.0), "min": ("time", 60.0)}
FACTORS |= {"deg": ("angle", math.pi / 180), "m/s": ("speed", 1.0), "rad/s": ("turn rate", 1.0)}


@given(st.floats(-1e9, 1e9), st.sampled_from(sorted(FACTORS)), st.sampled_from(["", " ", "  "]))
def test_a_unit_scales_its_number(number: float, unit: str, gap: str) -> None:
    kind, factor = FACTORS[unit]
    assert quantity(kind)(f"{number!r}{gap}{unit}") == pytest.approx(number * factor, rel=1e-15, abs=1e-300)
    assert quantity(kind)(repr(number)) == number


@given(st.sampled_from(sorted(FACTORS)), st.sampled_from(["length", "time", "angle", "speed", "turn rate"]))
def test_a_unit_of_another_kind_is_named(unit: str, kind: str) -> None:
    if FACTORS[unit][0] == kind:
        return
    with pytest.raises(FieldError, match=f"which is an? {FACTORS[unit][0]}$"):
        quantity(kind)(f"1 {unit}")


@given(st.text(max_size=12))
def test_any_text_is_a_finite_number_or_refused(text: str) -> None:
    try:
        value = quantity("length")(text)
    except FieldError:
        return
    assert math.isfinite(value)


# --- one mistake at a time

BOX = "{box: [[6.0, 7.0], [5.0, 6.0]]}"
O1 = "{box: [[2.0, 3.0], [1.5, 3.0]]}"
TASK = '"F[14, 16] in(goal) and G[0, 16] avoid(obstacles)"'
CASES = {
    "unknown model": (
        ("unicycle", "unicicle"),
        (3, 10, "fleet.model"),
        f"'unicicle' is not one of {', '.join(SYSTEMS)}",
        "did you mean 'unicycle'?",
    ),
    "unknown field": (
        ("radius", "radios"),
        (5, 3, "fleet.radios"),
        "unknown field",
        "did you mean 'radius'?",
    ),
    "unknown field far from all": (
        ("moments: {order", "moments: {zzz: 1, order"),
        (7, 11, "moments.zzz"),
        "unknown field",
        "known here: basis, order, coordinates, integrator",
    ),
    "field of a later release": (
        ("  radius:", "  parameters: {traction: {beta: [2, 5]}}\n  radius:"),
        (5, 27, "fleet.parameters.traction.beta"),
        "unknown field",
        "known here: range, distribution, a, b, mean, deviation, numbers, samples, mixture",
    ),
    "a word as a boolean": (
        ("moments:", "verify: {certificate: yes}\nmoments:"),
        (7, 23, "verify.certificate"),
        "expected true or false, got 'yes'",
        "",
    ),
    "a number as a boolean": (
        ("moments:", "report: {baseline: 1}\nmoments:"),
        (7, 20, "report.baseline"),
        "expected true or false, got 1",
        "",
    ),
    "an unknown figure": (
        ("moments:", "report: {baselines: true}\nmoments:"),
        (7, 10, "report.baselines"),
        "unknown field",
        "did you mean 'baseline'?",
    ),
    "an unknown method": (
        ("moments:", "solve: {method: minpl}\nmoments:"),
        (7, 17, "solve.method"),
        "'minpl' is not one of nlp, minlp",
        "did you mean 'minlp'?",
    ),
    "neither a number of routes nor all": (
        ("moments:", "solve: {routes: al}\nmoments:"),
        (7, 17, "solve.routes"),
        "expected a whole number from 1 to 1000 (or all), got 'al'",
        "",
    ),
    "missing field": (
        (", heading: 45 deg", ""),
        (4, 3, "fleet.start.heading"),
        "this is required, but missing",
        "for example  heading: 45 deg",
    ),
    "field without a value": (
        (TASK, ""),
        (12, 6, "task"),
        "this is required, but missing",
        'for example  task: "F[0, T] in(goal) and G avoid(obstacles)"',
    ),
    "key given twice": (
        ("  radius: 0 m\n", "  radius: 0 m\n  model: unicycle\n"),
        (6, 3, "fleet.model"),
        "given twice, first on line 3",
        "remove one of them",
    ),
    "unit of another kind": (
        ("16 s, steps", "16 m, steps"),
        (6, 21, "horizon.duration"),
        "expected a time in s, ms, min or h, got '16 m', which is a length",
        "",
    ),
    "unknown unit": (
        ("45 deg", "45 grad"),
        (4, 42, "fleet.start.heading"),
        "expected an angle in rad or deg, got the unknown unit 'grad'",
        "",
    ),
    "not a number": (("0 m", ".nan"), (5, 11, "fleet.radius"), "expected a finite number, got .nan", ""),
    "infinity": (
        ("16 s, s", ".inf, s"),
        (6, 21, "horizon.duration"),
        "expected a finite number, got .inf",
        "",
    ),
    "too large for a float": (
        ("0 m", "1e999 m"),
        (5, 11, "fleet.radius"),
        "expected a finite number, got '1e999 m'",
        "",
    ),
    "a boolean as a number": (
        ("0 m", "true"),
        (5, 11, "fleet.radius"),
        "expected a length in m, cm, mm or km, got true",
        "",
    ),
    "negative radius": (
        ("0 m", "-1 cm"),
        (5, 11, "fleet.radius"),
        "expected a length in m, cm, mm or km, 0 or more, got '-1 cm'",
        "",
    ),
    "bounds upside down": (
        ("  radius:", "  input_bounds: {v: [2, -2]}\n  radius:"),
        (5, 21, "fleet.input_bounds.v"),
        "expected [low, high], got [2, -2], where low is above high",
        "",
    ),
    "range upside down": (
        ("  radius:", "  parameters: {traction: {range: [1.1, 0.9]}}\n  radius:"),
        (5, 34, "fleet.parameters.traction.range"),
        "expected [low, high], got [1.1, 0.9], where low is above high",
        "",
    ),
    "range with zero": (
        ("  radius:", "  parameters: {traction: {range: [0, 1]}}\n  radius:"),
        (5, 34, "fleet.parameters.traction.range"),
        "expected a range above 0, got [0, 1]",
        "",
    ),
    "box upside down": (
        ("[2.0, 3.0]", "[3.0, 2.0]"),
        (11, 14, "obstacles.o1.box[0]"),
        "expected [low, high] with low below high, got [3, 2]",
        "",
    ),
    "box of another form": (
        (BOX, "{box: [6, 7, 5, 6]}"),
        (9, 15, "regions.goal.box"),
        "expected [[x low, x high], [y low, y high]], got [6, 7, 5, 6]",
        "",
    ),
    "no steps": (
        ("steps: 160", "steps: 0"),
        (6, 34, "horizon.steps"),
        "expected a whole number from 1 to 100000, got 0",
        "",
    ),
    "half a step": (
        ("steps: 160", "steps: 0.5"),
        (6, 34, "horizon.steps"),
        "expected a whole number from 1 to 100000, got 0.5",
        "",
    ),
    "order 0": (
        ("order: 8", "order: 0"),
        (7, 18, "moments.order"),
        "expected a whole number from 1 to 50 (or auto), got 0",
        "",
    ),
    "order 60": (
        ("order: 8", "order: 60"),
        (7, 18, "moments.order"),
        "expected a whole number from 1 to 50 (or auto), got 60",
        "",
    ),
    "start in an obstacle": (
        ("position: [1.0, 1.0]", "position: [2.2, 2.0]"),
        (4, 21, "fleet.start.position"),
        "the start (2.2, 2) is 0.2 m deep inside obstacle 'o1'",
        "move the start or the obstacle",
    ),
    "start too near to an obstacle": (
        ("radius: 0 m", "radius: 1.5"),
        (4, 21, "fleet.start.position"),
        "the start (1, 1) is 0.382 m deep inside obstacle 'o1', grown by the radius 1.5 m",
        "move the start or the obstacle",
    ),
    "covered goal": (
        ("obstacles:\n", "obstacles:\n  big: {box: [[5, 8], [4, 7]]}\n"),
        (9, 3, "regions.goal"),
        "obstacles cover the whole region: big",
        "move the region or the obstacles",
    ),
    "goal out of reach": (
        ("  radius:", "  input_bounds: {v: [-20 cm/s, 30 cm/s]}\n  radius:"),
        (13, 21, "task"),
        "region 'goal' is 6.4 m from the start, "
        "but at top speed the slowest member (traction 0.9) drives 4.32 m by 16 s",
        "it needs 23.7 s at 0.27 m/s: allow more time or raise fleet.input_bounds.v",
    ),
    "start outside": (
        ("F[14, 16]", "G[0, 16]"),
        (12, 20, "task"),
        "members have to be in 'goal' from the start, but (1, 1) is 6.4 m outside",
        "move the start, or let the window begin later",
    ),
    "window beyond the horizon": (
        ("F[14, 16]", "F[14, 20]"),
        (12, 8, "task"),
        "expected a window that ends by 16 s, the plan's duration, got F[14,20] in(goal) reaching 20 s",
        "lengthen horizon.duration or end the window earlier",
    ),
    "window backwards": (
        ("F[14, 16]", "F[16, 14]"),
        (12, 14, "task"),
        "expected a window's end of 16 or later, got 14",
        "",
    ),
    "unknown region": (
        ("in(goal)", "in(gaol)"),
        (12, 21, "task"),
        "expected the name of a region (did you mean 'goal'?), got 'gaol'",
        "",
    ),
    "an obstacle to be in": (
        ("in(goal)", "in(o1)"),
        (12, 21, "task"),
        "expected the name of a region (goal), got 'o1'",
        "o1 is an obstacle: to be outside of it is  avoid(o1)",
    ),
    "not a formula": (
        ("and G", "und G"),
        (12, 27, "task"),
        "expected 'and', 'or', '=>', 'U' or the end, got 'und'",
        "",
    ),
    "self-crossing polygon": (
        (O1, "{polygon: [[2, 2], [3, 3], [3, 2], [2, 4]]}"),
        (11, 17, "obstacles.o1.polygon"),
        "expected a polygon that does not cross itself, got self-intersection at (2.66667, 2.66667)",
        "repair the polygon first, as with shapely.make_valid, or in QGIS by Fix geometries",
    ),
    "a circle": (
        (O1, "{circle: [2, 2, 0.5]}"),
        (11, 8, "obstacles.o1.circle"),
        "unknown field",
        "write  disc: {center: [x, y], radius: 0.5 m}",
    ),
    "polygon whose halves cancel": (
        (O1, "{polygon: [[2, 2], [6, 4], [6, 2], [2, 4]]}"),
        (11, 17, "obstacles.o1.polygon"),
        "expected a polygon that does not cross itself, got self-intersection at (4, 3)",
        "repair the polygon first, as with shapely.make_valid, or in QGIS by Fix geometries",
    ),
    "flat polygon": (
        (O1, "{polygon: [[2, 2], [3, 3]]}"),
        (11, 17, "obstacles.o1.polygon"),
        "expected a polygon with an area, got corners on one line",
        "",
    ),
    "region that is not convex": (
        (BOX, f"{{polygon: {CORNER}}}"),
        (9, 19, "regions.goal.polygon"),
        "expected a convex polygon, got one that is not",
        "it splits into 2 convex ones: name each and write in(a) or in(b)",
    ),
    "empty region": (
        (BOX, "{halfspaces: [x >= 3, x <= 2]}"),
        (9, 3, "regions.goal"),
        "this region is empty: no point satisfies all of its inequalities",
        "",
    ),
    "unbounded obstacle": (
        (O1, "{halfspaces: [x >= 3, y <= 2]}"),
        (11, 20, "obstacles.o1.halfspaces"),
        "expected a bounded polygon, got an unbounded set",
        "",
    ),
    "inequality of something else": (
        (O1, "{halfspaces: [x >= 3, z <= 2]}"),
        (11, 29, "obstacles.o1.halfspaces[1]"),
        "expected an inequality in x and y, got the unknown 'z'",
        "for example 'x + 2*y <= 3'",
    ),
    "two forms": (
        (O1, "{wkt: 'POLYGON EMPTY', box: [[2, 3], [1, 3]]}"),
        (11, 7, "obstacles.o1"),
        "expected exactly one of box, polygon, disc, halfspaces, wkt, file, got box and wkt",
        "",
    ),
    "broken WKT": (
        (O1, "{wkt: 'POLYGON ((0 0, 1 1'}"),
        (11, 13, "obstacles.o1.wkt"),
        "expected WKT, got 'POLYGON ((0 0, 1 1'",
        "for example 'POLYGON ((0 0, 2 0, 1 1, 0 0))'",
    ),
    "WKT with a hole outside": (
        (O1, "{wkt: 'POLYGON ((5 0, 9 0, 9 9, 5 0), (15 1, 16 1, 16 2, 15 1))'}"),
        (11, 13, "obstacles.o1.wkt"),
        "expected holes that are inside of the polygon and apart, got hole lies outside shell at (15, 1)",
        "repair the polygon first, as with shapely.make_valid, or in QGIS by Fix geometries",
    ),
    "map in another folder": (
        (O1, "{file: ../map.json}"),
        (11, 14, "obstacles.o1.file"),
        "expected a file in the same folder or below, got '../map.json'",
        "copy it there",
    ),
    "feature without a map": (
        (O1, "{box: [[2, 3], [1, 3]], feature: shed}"),
        (11, 40, "obstacles.o1.feature"),
        "expected feature only with file",
        "",
    ),
    "WKT of a point": (
        (O1, "{wkt: POINT (1 1)}"),
        (11, 13, "obstacles.o1.wkt"),
        "expected polygons, got 1 Point",
        "what is to be kept clear of needs a polygon with a width",
    ),
    "map that is not there": (
        (O1, "{file: nothere.json}"),
        (11, 14, "obstacles.o1.file"),
        "nothere.json: no such file",
        "",
    ),
    "word of the task language": (
        ("  o1:", "  G:"),
        (11, 3, "obstacles.G"),
        "'G' is a word of the task language",
        "choose another name",
    ),
    "section that is a list": (
        ("{order: 8}", "[8]"),
        (7, 10, "moments"),
        "expected a section of fields, got [8]",
        "",
    ),
    "name that is no folder": (
        ("name: small", "name: ../up"),
        (1, 7, "name"),
        "expected a name that a folder can have, got '../up'",
        'leave out / \\ : * ? " < > |',
    ),
    "number as a name": (("name: small", "name: 3"), (1, 7, "name"), "expected a text, got 3", ""),
    "other version": (
        ("name: small", "version: 2"),
        (1, 10, "version"),
        "expected 1, got 2",
        "this release reads version 1",
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_one_mistake(case: tuple[tuple[str, str], tuple[int, int, str], str, str]) -> None:
    change, where, message, hint = case
    error = only(edited(change))
    assert place(error) == where
    assert (error.severity, error.message, error.hint) == ("error", message, hint)


NOT_YAML = {
    "open bracket": ("a: [1\nb: 2", (2, 2), "not YAML: expected ',' or ']', but got ':'"),
    "tab": (
        "fleet:\n\tmodel: unicycle",
        (2, 1),
        r"not YAML: found character '\t' that cannot start any token",
    ),
    "two colons": ("a: b: c", (1, 5), "not YAML: mapping values are not allowed here"),
    "unknown alias": ("a: *b", (1, 4), "not YAML: found undefined alias 'b'"),
    "two documents": ("a: 1\n---\nb: 2", (2, 1), "not YAML: found another document"),
    "tag": ("a: !!python/object:os.system x", (1, 4), "expected no tag, got !!python/object:os.system"),
    "list as a key": ("? [a]\n: 1", (1, 3), "expected a text as a key, got a list or a section"),
    "control character": ("a: \x07", (1, 4), r"expected text, got the control character '\x07'"),
    "a list": ("- fleet", (1, 1), "expected a problem with fleet, horizon and task, got ['fleet']"),
    "a word": ("fleet", (1, 1), "expected a problem with fleet, horizon and task, got 'fleet'"),
    "nothing": ("", (None, None), "this file is empty"),
    "only remarks": ("# fleet\n", (None, None), "this file is empty"),
    "deep": ("[" * 100_000, (1, 51), "expected at most 50000 values, nested at most 50 deep, got more"),
    "an alias of itself": (
        "a: &a [*a]",
        (1, 4),
        "expected at most 50000 values, nested at most 50 deep, got more",
    ),
}


@pytest.mark.parametrize("case", NOT_YAML.values(), ids=NOT_YAML)
def test_not_a_problem_at_all(case: tuple[str, tuple[int | None, int | None], str]) -> None:
    text, where, message = case
    error = only(text)
    assert (error.line, error.column) == where
    assert error.message.startswith(message)


def test_aliases_that_grow_are_stopped() -> None:
    letters = "abcdefghij"
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
        f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]\n" for old, new in itertools.pairwise(letters)
    )
    began = time.process_time()
    assert "expected at most 50000 values" in only(bomb).message
    assert time.process_time() - began < 5


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "good.yaml").write_text(GOOD)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0")
    (tmp_path / "latin.yaml").write_bytes("name: a\nfleet: {é}".encode("latin-1"))
    (tmp_path / "huge.yaml").write_text("#" * 6_000_000)
    expected = {
        "god.yaml": "god.yaml: error: no such file\n    hint: did you mean 'good.yaml'?\n1 error in ",
        "": ": error: this is a folder\n    hint: name a file in it\n",
        "picture.png": "picture.png: error: expected a text file, got a binary one\n",
        "latin.yaml": "latin.yaml:2:9: error: expected UTF-8\n    hint: save the file with that encoding\n",
        "huge.yaml": "huge.yaml: error: expected at most 1 MB, got more\n",
    }
    for name, text in expected.items():
        with pytest.raises(ConfigError) as refusal:
            config.load(tmp_path / name)
        assert str(refusal.value).startswith(str(tmp_path / name) + text.removeprefix(name))


SNIPPETS = [
    "",
    " ",
    "\n",
    "\t",
    ":",
    ": ",
    "- ",
    "{",
    "}",
    "[",
    "]",
    ",",
    '"',
    "'",
    "#",
    "&a ",
    "*a",
    "!x ",
    "|",
    ">-\n",
    "%",
]
SNIPPETS += [
    "\x85",
    "\u2028",
    "\r",
    "\x00",
    "\ufeff",
    "é",
    "1e999",
    "-1",
    ".nan",
    "null",
    "true",
    "? ",
    "<<: ",
    "---\n",
    "99 km",
]


@examples(300)
@given(
    st.sampled_from([GOOD, SHAPES]),
    st.lists(
        st.tuples(st.integers(0, 700), st.integers(0, 12), st.sampled_from(SNIPPETS) | st.text(max_size=3)),
        min_size=1,
        max_size=3,
    ),
)
def test_a_broken_file_is_loaded_or_refused_with_places(text: str, edits: list[tuple[int, int, str]]) -> None:
    for at, length, new in edits:
        text = text[:at] + new + text[at + length :]
    found: tuple[config.Diagnostic, ...] = ()
    try:
        found = config.read_text(text, "fuzz.yaml").warnings
    except ConfigError as refusal:
        found = refusal.diagnostics or pytest.fail("refused without a reason")
    for error in found:
        assert error.line is None or 1 <= error.line <= len(re.split("[\n\r\x85\u2028\u2029]", text))
        assert str(error).count("\n") <= 3


# --- how it looks


def test_all_mistakes_at_once_in_file_order() -> None:
    text = edited(
        ("unicycle", "unicicle"), ("45 deg", "45 m"), ("steps: 160", "stebs: 0"), ("{order: 8}", "{order: 0}")
    )
    text = text.replace("and G", "und G").replace("name: small", "name: small\nmoments: {order: 3}")
    with pytest.raises(ConfigError) as refusal:
        config.load_text(text, "bad.yaml")
    assert [place(error) for error in refusal.value.diagnostics] == [
        (4, 10, "fleet.model"),
        (5, 42, "fleet.start.heading"),
        (7, 27, "horizon.stebs"),
        (8, 1, "moments"),
        (13, 27, "task"),
    ]
    assert str(refusal.value).endswith("\n5 errors in bad.yaml")


def test_the_layout() -> None:
    with pytest.raises(ConfigError) as refusal:
        config.load_text(edited(("unicycle", "unicicle")), "bad.yaml")
    assert str(refusal.value) == (
        f"bad.yaml:3:10: error: fleet.model: 'unicicle' is not one of {', '.join(SYSTEMS)}\n"
        "       3 |   model: unicicle\n"
        "         |          ^\n"
        "    hint: did you mean 'unicycle'?\n"
        "1 error in bad.yaml"
    )


@pytest.mark.parametrize(
    ("task", "line", "column"),
    [
        ("F[14, 16] in(gaol)", 12, 20),
        ("'F[14, 16] in(gaol)'", 12, 21),
        ('"F[14, 16]\n   in(gaol)"', 13, 7),
        (">-\n  F[14, 16] in(goal)\n\n  and F in(gaol)", 15, 12),
        ("|\n  F[14, 16]\n  in(gaol)", 14, 6),
        ('"F[14, 16]\\x20in(gaol)"', 12, 7),
    ],
)
def test_the_column_points_into_the_formula(task: str, line: int, column: int) -> None:
    error = only(edited((TASK, task)))
    assert (error.line, error.column) == (line, column)
    assert "'gaol'" in error.message


def test_a_long_line_is_shortened_around_the_mistake() -> None:
    error = only(edited((TASK, '"' + "G x >= -99 and " * 20 + 'F in(gaol)"')))
    _, code, caret, *_ = str(error).splitlines()
    assert len(code) < 120
    assert code[caret.index("^") :].startswith("gaol")


def test_nothing_in_a_file_steers_the_terminal() -> None:
    with pytest.raises(ConfigError) as refusal:
        config.load_text('name: x\n"\\e[31mred": 1\n"a\\nb": 1\n' + LEAST, "bad\x1b.yaml")
    assert "\x1b" not in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 9


def test_warnings_have_a_place_too() -> None:
    text = edited(("  goal:", "  spare: {halfspaces: [x >= 9]}\n  goal:"), (" and G[0, 16] avoid(obstacles)", ""))
    warnings = config.read_text(text, "odd.yaml").warnings
    assert [(w.severity, *place(w)) for w in warnings] == [
        ("warning", 9, 3, "regions.spare"),
        ("warning", 9, 3, "regions.spare"),
        ("warning", 11, 1, "obstacles"),
    ]
    assert {w.message for w in warnings} == {
        "this region is unbounded",
        "the task never mentions this region",
        "the task never mentions the obstacles, so robots may drive through them",
    }


def test_warnings_are_in_file_order_and_not_errors() -> None:
    first = "obstacles: {o1: {box: [[2, 3], [1.5, 3]]}}\nregions: {spare: {box: [[5, 6], [5, 6]]}}\n"
    warnings = config.read_text(first + LEAST).warnings
    assert [place(w) for w in warnings] == [(1, 1, "obstacles"), (2, 11, "regions.spare")]


@pytest.mark.parametrize("end", ["\r", "\r\n", "\x85", "\u2028", "\n"])
def test_every_line_end_counts_once(end: str) -> None:
    error = only(f"# one{end}# two{end}" + LEAST.replace("F x >= 1", "F x >= 1 m"))
    assert (error.line, error.column, error.excerpt) == (5, 16, "task: F x >= 1 m")


# --- overrides


def test_overrides_come_before_validation() -> None:
    changes = ["fleet.radius=30 cm", "horizon={duration: 20}", "fleet.start.position[1]=0.5", "solve.seed=7"]
    problem = config.load_text(edited(("radius: 0 m", "radius: nonsense")), overrides=changes)
    assert (problem.fleet.radius, problem.duration, problem.steps, problem.solve.seed) == (0.3, 20.0, 200, 7)
    assert problem.fleet.position.tolist() == [1.0, 0.5]
    assert config.load_text(GOOD, overrides=["obstacles.o1=null"]).obstacles == {}


@pytest.mark.parametrize(
    ("override", "path", "message"),
    [
        ("fleet.radius=abc", "fleet.radius", "expected a length in m, cm, mm or km, got 'abc'"),
        ("fleet.radios=1", "fleet.radios", "unknown field"),
        ("fleet.start.position.0=2.5", "fleet.start.position", "the start (2.5, 1) is"),
        ("task=F[0, 20] in(goal)", "task", "expected a window that ends by 16 s"),
        ("name.x=3", "name.x", "expected a section above 'x', got 'small'"),
        (
            "fleet.start.position[2]=3",
            "fleet.start.position[2]",
            "expected a place from 0 to 1 in a list, got 2",
        ),
        ("fleet.radius=[1", "", "not YAML: expected ',' or ']'"),
        ("fleet={radius: 1, radius: 2}", "", "radius is given twice"),
        ("fleet.radius", "", "expected KEY=VALUE"),
        ("=3", "", "expected KEY=VALUE"),
        ("fleet..radius=3", "", "expected KEY=VALUE"),
    ],
)
def test_a_wrong_override_is_named(override: str, path: str, message: str) -> None:
    text = edited(("[2.0, 3.0], [1.5", "[2.0, 3.0], [0.5")) if "position.0" in override else GOOD
    error = only(text, override)
    assert (error.source, error.line, error.path) == (f"--set {override}", None, path)
    assert error.message.startswith(message)


def test_overrides_are_listed_after_the_file() -> None:
    found = errors(edited(("order: 8", "order: 0")), "solve.seed=x")
    assert [error.source for error in found] == ["bad.yaml", "--set solve.seed=x"]


# --- and back


def assert_same(one: Problem, two: Problem) -> None:
    """Every number of two problems is the same."""
    for name in ("name", "duration", "steps", "order", "task", "solve", "verify", "report"):
        assert getattr(one, name) == getattr(two, name), name
    for name in ("system", "parameters", "heading", "radius"):
        assert getattr(one.fleet, name) == getattr(two.fleet, name), name
    for name in ("position", "input_lower", "input_upper"):
        np.testing.assert_array_equal(getattr(one.fleet, name), getattr(two.fleet, name))
    assert list(one.regions) == list(two.regions)
    for name, region in one.regions.items():
        np.testing.assert_array_equal(region.A, two.regions[name].A)
        np.testing.assert_array_equal([region.lower, region.upper], [two.regions[name].lower, two.regions[name].upper])
    assert [name for name, _ in one.pieces] == [name for name, _ in two.pieces]
    for (_, piece), (_, other) in zip(one.pieces, two.pieces, strict=True):
        np.testing.assert_array_equal(piece.A, other.A)
        np.testing.assert_array_equal(piece.b, other.b)
    for name in ("robustness", "terminal", "effort"):
        assert getattr(one.objective, name) == getattr(two.objective, name) or one.objective.target is None
    np.testing.assert_array_equal(one.objective.target, two.objective.target)


@pytest.mark.parametrize("text", [FIVE.read_text(), GOOD, LEAST, SHAPES], ids=["five", "good", "least", "shapes"])
def test_dump_and_load_give_the_same_problem(text: str) -> None:
    problem = config.load_text(text)
    written = config.dump(problem)
    assert_same(problem, config.load_text(written, "again.yaml"))
    assert config.dump(config.load_text(written, "again.yaml")) == written


def test_dump_keeps_corners_where_they_are_exact() -> None:
    data = config.to_data(config.load_text(SHAPES))
    assert data["regions"]["tri"] == {"polygon": [[6.0, 5.0], [7.1, 5.0], [6.0, 6.3]]}
    assert data["obstacles"]["two"][0] == {"box": [[8.0, 9.0], [0.1, 0.3]]}
    assert all(set(piece) == {"polygon"} for piece in data["obstacles"]["corner"])


@examples(50)
@given(
    st.floats(-10, 10),
    st.sampled_from("xy"),
    st.lists(st.floats(0.1, 1.0), min_size=3, max_size=3),
    st.integers(1, 50) | st.none(),
)
def test_any_numbers_survive_dump(heading: float, axis: str, numbers: list[float], order: int | None) -> None:
    start, radius, low = numbers
    changes = [
        f"fleet.start={{position: [{start!r}, 0.3], heading: {heading!r}, heading_from: {axis}}}",
        f"fleet.radius={radius!r}",
        f"fleet.parameters.traction.range=[{low!r}, 1.7]",
        f"moments.order={'auto' if order is None else order}",
    ]
    problem = config.load_text(LEAST, overrides=changes)
    assert_same(problem, config.load_text(config.dump(problem)))


def test_the_schema_knows_every_field() -> None:
    described = json.loads(json.dumps(config.schema()))
    assert set(described["properties"]) - {"online", "sweep"} == set(config.to_data(config.load(FIVE)))
    assert described["required"] == ["fleet", "horizon", "task"]
    assert described["additionalProperties"] is False


@pytest.mark.parametrize(("text", "routes"), [("all", "all"), ("1", 1), ("12", 12)])
def test_routes_are_a_number_or_all(text: str, routes: int | str) -> None:
    problem = config.load(FIVE, [f"solve.routes={text}"])
    assert problem.solve.routes == routes
    assert config.load_text(config.dump(problem)).solve.routes == routes


def test_importing_config_loads_no_solver() -> None:
    script = "import sys, ensemble_ctrl.files.config as c; c.load(sys.argv[1]); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", script, str(FIVE)], capture_output=True, text=True, check=True)
    assert not {"casadi", "scipy", "matplotlib", "shapely"} & set(re.findall(r"[\w.]+", run.stdout))


def _with_polygon(corners: list[list[float]]) -> str:
    """The small problem with one obstacle more."""
    return GOOD.replace("obstacles:\n", f"obstacles:\n  o: {{polygon: {json.dumps(corners)}}}\n")


def _circle(count: int) -> list[list[float]]:
    angles = 2 * math.pi * np.arange(count) / count
    return np.column_stack([12 + np.cos(angles), np.sin(angles)]).tolist()  # type: ignore[no-any-return]


def test_a_polygon_of_ten_thousand_corners_is_read_as_it_is() -> None:
    """All pairs of its sides would be 50 million, and their table 30 GB."""
    problem = config.load_text(_with_polygon(_circle(10_000)))
    (piece,) = problem.obstacles["o"]
    assert len(piece.vertices) == len(piece.b) == 10_000


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (_circle(10_001), "at most 10000 corners, got 10001"),
        ([[0, 0], [1e300, 0], [1, 1]], r"at most 1e\+08 m, got \[1e\+300, 0\]"),
    ],
    ids=["corners", "far"],
)
def test_a_polygon_in_the_file_keeps_to_the_limits_of_a_map(corners: list[list[float]], message: str) -> None:
    with pytest.raises(ConfigError, match=f"obstacles.o.polygon: expected .*{message}"):
        config.load_text(_with_polygon(corners))


OLD_KEYS = [
    ("report: {twin: true}", "report.baseline", "twin"),
    ("fleet: {START, cloud: {traction: [1, 1.1]}}", "fleet.samples", "cloud"),
    (
        "fleet: {START, parameters: {traction: {law: uniform}}}",
        "fleet.parameters.traction.distribution",
        "law",
    ),
    (
        "fleet: {START, parameters: {traction: {mixture: [{law: uniform, range: [1, 2], weight: 1}]}}}",
        "fleet.parameters.traction.mixture[0].distribution",
        "law",
    ),
]


@pytest.mark.parametrize(("old", "path", "key"), OLD_KEYS)
def test_old_keys_are_read_with_a_warning_that_names_the_new_one(old: str, path: str, key: str) -> None:
    new = path.rpartition(".")[2]
    fleet, _, rest = LEAST.partition("\n")
    given, bare = old.replace("START", fleet.partition("{")[2][:-1]), rest if old.startswith("fleet") else LEAST
    written = config.read_text(bare + given)
    (warning,) = (one for one in written.warnings if "deprecated" in one.message)
    assert (warning.path, warning.message, warning.hint) == (
        path,
        f"the key {key!r} is deprecated and goes with the next release",
        f"write {new!r}",
    )
    assert warning.excerpt[(warning.column or 0) - 1 :].startswith(key)
    today = config.read_text(bare + given.replace(f"{key}:", f"{new}:"))
    assert written.data == today.data
    assert not [one for one in today.warnings if "deprecated" in one.message]


def test_old_keys_are_read_in_overrides() -> None:
    for change in ("report.twin=true", "report={twin: true}"):
        loaded = config.read_text(LEAST, overrides=[change])
        assert loaded.problem.report.baseline
        (warning,) = (one for one in loaded.warnings if "deprecated" in one.message)
        assert (warning.source, warning.path) == (f"--set {change}", "report.baseline")


def test_a_key_under_both_names_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"report\.twin: unknown field"):
        config.load_text(LEAST + "report: {baseline: true, twin: false}")


def test_old_fields_work_with_a_warning() -> None:
    with pytest.warns(DeprecationWarning, match=r"ReportOptions\.twin is deprecated .* use baseline"):
        options = ReportOptions(**{"twin": True})
    assert options == ReportOptions(baseline=True)
    with pytest.warns(DeprecationWarning, match="use baseline"):
        assert options.twin is True  # type: ignore[attr-defined]
