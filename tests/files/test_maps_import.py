"""Maps from other tools: what comes in covers what was drawn, and hostile files are refused."""

from __future__ import annotations

import json
import math
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from ensemble_ctrl.constraints import Obstacle, convex_cover, convex_pieces
from ensemble_ctrl.constraints.cells import Cells
from ensemble_ctrl.constraints.polygon import is_convex
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import import_map, load, load_text, read
from ensemble_ctrl.files.config.wkt import shapes_of_wkt
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem.evaluation.sampled import replay
from tests.examples import examples
from tests.paths import CONFIGS

NANOMETRE = 1e-9
FINE = {"resolution": 0.5, "origin": [0.0, 0.0, 0.0]}

masks = st.tuples(st.integers(1, 12), st.integers(1, 12)).flatmap(lambda shape: arrays(bool, shape))


# --- occupied cells


def placed(cells: Cells, row: int, column: int, grown: float) -> Any:
    """One cell on the plane, grown on each side."""
    low, high = -grown / cells.size, 1 + grown / cells.size
    return on_plane(cells, shapely.box(column + low, row + low, column + high, row + high))


def on_plane(cells: Cells, shape: Any) -> Any:
    """A shape in columns and rows, on the plane."""
    c, s, size = math.cos(cells.yaw), math.sin(cells.yaw), cells.size
    return shapely.affinity.affine_transform(shape, [c * size, -s * size, s * size, c * size, *cells.origin])


def test_a_grid_may_be_smaller_than_the_tolerance() -> None:
    pieces = Cells(np.zeros((1, 1), dtype=bool), 1.0).pieces(4.0)
    assert shapely.union_all([shapely.Polygon(piece) for piece in pieces]).covers(shapely.box(-1, -1, 2, 2))


@examples(60)
@given(masks, st.floats(0.01, 3), st.floats(-4, 4), st.floats(-4, 4), st.floats(-50, 50))
def test_every_occupied_cell_is_covered_and_nothing_grows_by_more(
    mask: NDArray[np.bool_], size: float, reach: float, yaw: float, corner: float
) -> None:
    cells, tolerance = Cells(mask, size, (corner, -corner), yaw), max(0.0, reach) * size
    pieces = [shapely.Polygon(piece) for piece in cells.pieces(tolerance)]
    taken = [placed(cells, row, column, -2 * NANOMETRE) for row, column in np.argwhere(mask)]
    assert all(any(piece.covers(cell) for piece in pieces) for cell in taken)
    whole = on_plane(cells, shapely.box(0, 0, *mask.shape[::-1]))
    outside = whole.buffer(100 * size).difference(whole)
    # a circle of 256 corners lies within the true one: its inner radius counts
    around = (tolerance + 1e-6) / math.cos(math.pi / 256)
    near = shapely.union_all([outside, *taken]).buffer(around, quad_segs=64)
    assert all(near.covers(piece) for piece in pieces)


def test_a_frame_closes_a_map_whose_edge_is_free() -> None:
    pieces = [Obstacle.polygon(piece) for piece in Cells(np.zeros((4, 6), dtype=bool), 0.5).pieces(0.0)]
    beside = [[-0.1, 1.0], [3.1, 1.0], [1.0, -0.1], [1.0, 2.1]]
    assert len(pieces) == 4
    assert all(min(float(piece.distance(point)) for piece in pieces) < 0 for point in beside)
    assert min(float(piece.distance([1.5, 1.0])) for piece in pieces) == pytest.approx(1.0)


def test_a_slanted_wall_becomes_one_piece_within_two_cells() -> None:
    row, column = np.mgrid[0:60, 0:60] + 0.5
    wall = np.abs(row - 30 - 0.3 * (column - 30)) < 2
    room = [piece for piece in Cells(wall, 0.05).pieces(0.1) if not (np.abs(piece - 1.5) > 1.49).all()]
    inner = [piece for piece in room if np.ptp(piece[:, 0]) > 1 and np.ptp(piece[:, 1]) < 2]
    assert len(room) <= 6
    assert len(inner) >= 1


def test_too_many_scattered_cells_ask_for_a_tolerance() -> None:
    noise = np.indices((300, 300)).sum(axis=0) % 2 == 0
    with pytest.raises(ProblemError, match="at most 20000 rectangles"):
        Cells(noise, 0.05).pieces(0.05)
    assert len(Cells(noise, 0.05).pieces(0.3)) == 1


# --- polygons


def star(corners: int, seed: int) -> Any:
    rng = np.random.default_rng(seed)
    angle = (np.arange(corners) + rng.uniform(0, 0.8, corners)) * 2 * np.pi / corners
    return shapely.Polygon((rng.uniform(0.6, 2, corners) * np.array([np.cos(angle), np.sin(angle)])).T)


@examples(60)
@given(st.integers(0, 10_000), st.integers(3, 40), st.sampled_from([0.0, 0.01, 0.1, 1.0]), st.booleans())
def test_pieces_cover_a_polygon_with_a_hole(seed: int, corners: int, tolerance: float, hole: bool) -> None:
    outline = star(corners, seed)
    if not outline.is_valid:
        return
    inner = [shapely.affinity.scale(star(5, seed + 1), 0.1, 0.1)] if hole else []
    inner = [ring for ring in inner if ring.is_valid and outline.contains(ring) and not ring.touches(outline)]
    shape = outline.difference(inner[0]) if inner else outline
    rings = [np.array(ring.exterior.coords)[:-1] for ring in inner]
    vertices = np.array(outline.exterior.coords)
    pieces = convex_cover(vertices, rings, tolerance) if tolerance else convex_pieces(vertices, rings)
    assert all(is_convex(piece) for piece in pieces)
    found = shapely.union_all([shapely.Polygon(piece) for piece in pieces])
    assert shape.difference(found).area < 1e-9
    assert found.difference(shape.buffer(tolerance + 1e-9, quad_segs=64)).area < 1e-9
    if not tolerance:
        assert sum(shapely.Polygon(piece).area for piece in pieces) == pytest.approx(shape.area, abs=1e-9)


def test_a_ring_with_hundreds_of_corners_is_cut_quickly_and_into_few() -> None:
    outline, hole = shapely.Point(0, 0).buffer(2, quad_segs=64), shapely.Point(0, 0).buffer(1, quad_segs=64)
    rings = [np.array(ring.exterior.coords)[:-1] for ring in (outline, hole)]
    assert len(convex_cover(rings[0], rings[1:], 0.1)) <= 16
    assert len(convex_pieces(rings[0], rings[1:])) <= 2 * 257


@pytest.mark.parametrize(
    "hole", [[[5, 5], [6, 5], [6, 6]], [[-1, 1], [1, 1], [1, 2]], [[0.5, 0.5], [3.5, 0.5], [0.5, 3.5], [3.5, 3.5]]]
)
def test_holes_elsewhere_are_refused(hole: list[list[float]]) -> None:
    with pytest.raises(ProblemError, match="expected"):
        convex_pieces([[0, 0], [4, 0], [4, 4], [0, 4]], [hole])


# --- files


def square(x: float, y: float, side: float = 1.0) -> list[list[float]]:
    return [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]


def feature(name: str, *rings: list[list[float]], **properties: str) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": list(rings)}
    return {"type": "Feature", "properties": {"name": name, **properties}, "geometry": geometry}


def geojson(folder: Path, *features: dict[str, Any]) -> Path:
    path = folder / "yard.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def grid(folder: Path, pixels: Any, **fields: Any) -> Path:
    """A map file with its image."""
    suffix = fields.pop("suffix", ".pgm")
    Image.fromarray(np.asarray(pixels)).save(folder / f"room{suffix}")
    path = folder / "room.yaml"
    path.write_text(json.dumps({"image": f"room{suffix}", "negate": 0, **FINE, **fields}))
    return path


def taken(problem: str, points: list[list[float]]) -> list[bool]:
    """Whether points are inside an obstacle."""
    pieces = load_text(problem).pieces
    return [min(float(piece.distance(point)) for _, piece in pieces) < 0 for point in points]


def test_features_become_obstacles_and_regions_by_their_names(tmp_path: Path) -> None:
    ringed = feature("the shed", square(0, 0, 4), square(1, 1, 2))
    found = import_map(
        geojson(tmp_path, ringed, feature("in", square(6, 0)), feature("gate", square(9, 9), role="region"))
    )
    problem = load_text(found.problem)
    assert set(problem.obstacles) == {"the_shed", "in_"}
    assert set(problem.regions) == {"gate"}
    assert (found.obstacles, found.regions, found.pieces) == (2, 1, 5)
    assert taken(found.problem, [[0.5, 2], [2, 2], [6.5, 0.5], [9.5, 9.5]]) == [True, False, True, False]
    assert str(problem.task) == "G avoid(obstacles)"


@pytest.mark.parametrize(
    "text", ["POLYGON ((0 0, 2 0, 2 2, 0 0))", "GEOMETRYCOLLECTION (POLYGON ((0 0, 2 0, 2 2, 0 0)))"]
)
def test_wkt(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.wkt").write_text(text)
    assert taken(import_map(tmp_path / "a.wkt").problem, [[1.5, 1], [1, 1.5]]) == [True, False]


GREY = np.array([[254, 205, 0], [254, 254, 100]], dtype=np.uint8)
SEEN_THROUGH = np.array([[255, 255, 255], [0, 255, 255]], dtype=np.uint8)
MIDDLES = [[0.25, 0.75], [0.75, 0.75], [1.25, 0.75], [0.25, 0.25], [0.75, 0.25], [1.25, 0.25]]
USUAL = [False, True, True, False, False, True]


@pytest.mark.parametrize(
    ("pixels", "fields", "expected"),
    [
        (GREY, {}, USUAL),
        (GREY, {"suffix": ".png"}, USUAL),
        (GREY, {"suffix": ".png", "mode": "scale"}, USUAL),
        (255 - GREY, {"negate": 1}, USUAL),
        (GREY, {"free_thresh": 0.7}, [False, True, True, False, False, False]),
        (GREY + (GREY == 205), {"free_thresh": 0.7}, [False, False, True, False, False, False]),
        (np.array([[0, 255, 100], [10, 19, 60]], dtype=np.uint8), {"mode": "raw"}, USUAL),
        (GREY.astype(np.uint16) * 257, {"suffix": ".png"}, USUAL),
        (GREY > 250, {"suffix": ".png"}, USUAL),
        (np.dstack([GREY, GREY, GREY]), {"suffix": ".png"}, USUAL),
        (np.dstack([GREY * 0 + 254, GREY * 0 + 254, GREY]), {"suffix": ".png"}, USUAL),
        (np.dstack([GREY, np.full_like(GREY, 255)]), {"suffix": ".png"}, USUAL),
        (np.dstack([GREY, SEEN_THROUGH]), {"suffix": ".png"}, [False, True, True, True, False, True]),
    ],
)  # fmt: skip
def test_thresholds_colours_and_transparency(
    tmp_path: Path, pixels: Any, fields: dict[str, Any], expected: list[bool]
) -> None:
    assert taken(import_map(grid(tmp_path, pixels, **fields), 0.0).problem, MIDDLES) == expected


def test_the_origin_is_the_lower_left_corner_and_turns(tmp_path: Path) -> None:
    path = grid(tmp_path, GREY, origin=[10.0, 20.0, math.pi / 2])
    turned = [[10 - y, 20 + x] for x, y in MIDDLES]
    assert taken(import_map(path, 0.0).problem, turned) == USUAL


def test_plain_pgm_is_read(tmp_path: Path) -> None:
    path = grid(tmp_path, GREY)
    (tmp_path / "room.pgm").write_text("P2\n# made by hand\n3 2\n255\n254 205 0\n254 254 100\n")
    assert taken(import_map(path, 0.0).problem, MIDDLES) == USUAL


def test_what_is_written_is_a_problem_at_the_roomiest_place(tmp_path: Path) -> None:
    pixels = np.full((40, 40), 254, np.uint8)
    pixels[:, 30:33] = 0
    found = import_map(grid(tmp_path, pixels, resolution=0.1))
    problem = load_text(found.problem)
    room = min(float(piece.distance(problem.fleet.position)) for _, piece in problem.pieces)
    assert room == pytest.approx(1.5, abs=0.1)


# --- in problem files

PROBLEM = """
fleet: {model: unicycle, start: {position: START, heading: 0}}
horizon: {duration: 4 s}
regions: {goal: REGION}
obstacles: {o1: OBSTACLE}
task: G avoid(o1)
"""


def problem_file(folder: Path, obstacle: str, region: str = "{box: [[0, 1], [0, 1]]}", start: str = "[20, 20]") -> Path:
    path = folder / "problem.yaml"
    path.write_text(PROBLEM.replace("START", start).replace("OBSTACLE", obstacle).replace("REGION", region))
    return path


def test_a_problem_names_maps_and_their_features(tmp_path: Path) -> None:
    geojson(
        tmp_path, feature("a", square(0, 0)), feature("b", square(5, 0)), feature("gate", square(9, 9), role="region")
    )
    grid(tmp_path, GREY)
    region = "{file: yard.geojson, feature: gate}"
    assert len(load(problem_file(tmp_path, "{file: yard.geojson}", region)).obstacles["o1"]) == 2
    assert load(problem_file(tmp_path, "{box: [[0, 1], [0, 1]]}", region)).regions["goal"].contains([9.5, 9.5])
    one = load(problem_file(tmp_path, "{file: yard.geojson, feature: b}")).obstacles["o1"]
    np.testing.assert_allclose(one[0].vertices.mean(axis=0), [5.5, 0.5])
    grown = problem_file(tmp_path, "[{file: room.yaml, tolerance: 10 cm}]", start="[0.25, 0.25]")
    assert len(load(grown).obstacles["o1"]) >= 1


UNSEEN = np.full((8, 8), 254, dtype=np.uint8)
UNSEEN[:, 4:] = 205
UNSEEN[0, 0] = 100


@pytest.mark.parametrize(
    ("thresholds", "unknown", "free", "note"),
    [
        ({}, "", False, None),
        ({"free_thresh": 0.25}, "", False, "32 cells of the grey 205 .unknown. count as occupied"),
        ({"free_thresh": 0.25}, ", unknown: occupied", False, None),
        ({"free_thresh": 0.25}, ", unknown: free", True, "33 unknown cells count as free"),
        ({}, ", unknown: free", True, "33 unknown cells count as free"),
    ],
)
def test_cells_that_no_scan_has_seen(
    tmp_path: Path, thresholds: dict[str, float], unknown: str, free: bool, note: str | None
) -> None:
    grid(tmp_path, UNSEEN, **thresholds)
    obstacle = f"{{file: room.yaml, tolerance: 0{unknown}}}"
    loaded = read(problem_file(tmp_path, obstacle, "{box: [[0.2, 1], [0.2, 1]]}", "[1, 1]"))
    near = min(float(piece.distance([3.2, 1.0])) for piece in loaded.problem.obstacles["o1"])
    assert (near > 0) == free
    found = [warning for warning in loaded.warnings if warning.path == "obstacles.o1.file"]
    assert len(found) == (note is not None)
    assert note is None or re.search(note, found[0].message)
    imported = import_map(tmp_path / "room.yaml", 0.0, unknown.rpartition(" ")[2] or None)  # type: ignore[arg-type]
    assert [text for text in imported.notes if note and re.search(note, text)] == list(imported.notes)
    assert taken(imported.problem, [[3.2, 1.0]]) == [not free]


def test_unknown_cells_are_of_grids_only(tmp_path: Path) -> None:
    geojson(tmp_path, feature("a", square(0, 0)))
    with pytest.raises(ConfigError, match="expected an occupancy grid where unknown is given, got shapes"):
        load(problem_file(tmp_path, "{file: yard.geojson, unknown: free}"))
    with pytest.raises(ConfigError, match="expected unknown only with file"):
        load(problem_file(tmp_path, "{box: [[0, 1], [0, 1]], unknown: free}"))


@pytest.mark.parametrize(
    ("start", "region", "message"),
    [
        ("[7, 2]", "{box: [[1, 2], [1, 2]]}", r"the start \(7, 2\) is 3 m beyond the edge of the map"),
        ("[1, 1]", "{box: [[7, 8], [1, 2]]}", r"regions.goal: this region is 3 m beyond the edge of the map"),
    ],
)
@pytest.mark.parametrize("model", ["unicycle", "double_integrator"])
def test_beyond_the_edge_of_a_map_nothing_is_known(
    tmp_path: Path, start: str, region: str, message: str, model: str
) -> None:
    grid(tmp_path, np.full((8, 8), 254, dtype=np.uint8))
    path = problem_file(tmp_path, "{file: room.yaml}", region, start)
    path.write_text(path.read_text().replace("unicycle", model).replace(", heading: 0" * (model != "unicycle"), ""))
    with pytest.raises(ConfigError, match=message):
        load(path)


# --- habits of map files


@pytest.mark.parametrize("text", ["POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))", "POLYGON ((0 0, 9 0, 9 1, 0 1, 0 0))"])
def test_one_block_leaves_room_around_it(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.wkt").write_text(text)
    problem = load_text(import_map(tmp_path / "map.wkt").problem)
    assert float(problem.obstacles["map"][0].distance(problem.fleet.position)) > 0.5


def test_coordinates_of_a_country_are_written_to_a_millimetre(tmp_path: Path) -> None:
    blocks = [[(x, 5334000.0), (x + 8, 5334000.0), (x + 8, 5334006.0), (x, 5334006.0)] for x in (691000.0, 691012.0)]
    rings = ["((" + ", ".join(f"{x} {y}" for x, y in [*block, block[0]]) + "))" for block in blocks]
    (tmp_path / "map.wkt").write_text(f"MULTIPOLYGON ({', '.join(rings)})")
    found = import_map(tmp_path / "map.wkt")
    problem = load_text(found.problem)
    room = min(float(piece.distance(problem.fleet.position)) for piece in problem.obstacles["map"])
    assert room == pytest.approx(1.9, abs=0.15)
    told = re.search(r"roomiest place found, ([\d.]+) m", found.problem)
    assert told is not None
    assert float(told[1]) == pytest.approx(room, abs=0.01)


def test_no_free_cell_is_said_with_its_reason(tmp_path: Path) -> None:
    blue = np.dstack([np.full((6, 6), level, dtype=np.uint8) for level in (205, 225, 250)])
    cases: list[tuple[Any, dict[str, Any], str]] = [
        (blue, {"suffix": ".png"}, "of a coloured cell the darkest channel counts.*0.196"),
        (np.full((6, 6), 100, dtype=np.uint8), {}, "the least occupancy is 0.608, this is 0.196"),
        (np.full((6, 6), 254, dtype=np.uint8), {"free_thresh": 0.0}, "the least occupancy is 0.004, this is 0"),
        (np.full((6, 6), 205, dtype=np.uint8), {"free_thresh": 0.3}, "all that are below it are unknown"),
    ]
    for pixels, fields, message in cases:
        with pytest.raises(ConfigError, match=f"free_thresh: no cell of the image is free: .*{message}"):
            import_map(grid(tmp_path, pixels, **fields))


def test_a_wall_is_a_wall_whatever_is_called_free(tmp_path: Path) -> None:
    path = grid(tmp_path, GREY, free_thresh=1.0, occupied_thresh=0.5)
    assert taken(import_map(path, 0.0).problem, MIDDLES) == taken(
        import_map(grid(tmp_path, GREY, free_thresh=0.5, occupied_thresh=0.5), 0.0).problem, MIDDLES
    )


@pytest.mark.parametrize(("key", "value", "hint"), [("free_thresh", 25, "write 0.25"), ("occupied_thresh", -1, "")])
def test_thresholds_are_shares(tmp_path: Path, key: str, value: float, hint: str) -> None:
    with pytest.raises(ConfigError, match=rf"{key}: expected 0 to 1, got {value}[\s\S]*{hint}"):
        import_map(grid(tmp_path, GREY, **{key: value}))


def test_points_and_lines_beside_polygons_are_counted(tmp_path: Path) -> None:
    features = [feature("block", square(0, 0))]
    for kind, places in (("Point", [5, 1]), ("Point", [6, 1]), ("LineString", [[6, 0], [6, 3]])):
        features.append({"type": "Feature", "geometry": {"type": kind, "coordinates": places}, "properties": {}})
    path = geojson(tmp_path, *features)
    told = "left out 2 Point and 1 LineString, without an area"
    assert import_map(path).notes[0].startswith(told)
    warnings = read(problem_file(tmp_path, "{file: yard.geojson}")).warnings
    assert [w.message.startswith(told) for w in warnings if w.path == "obstacles.o1.file"] == [True]


@pytest.mark.parametrize("key", ["name", "Name", "NAME", "title"])
def test_names_of_features(tmp_path: Path, key: str) -> None:
    named = feature("x", square(0, 0))
    named["properties"] = {key: "shed", "area": 1}
    assert set(load_text(import_map(geojson(tmp_path, named)).problem).obstacles) == {"shed"}


def test_a_polygon_of_many_corners_in_one_cell() -> None:
    corners = ", ".join(f"{x}.123456789 {x % 2}.123456789" for x in range(8_000))
    text = f'WKT,name\n"POLYGON (({corners}, 0.123456789 0.123456789))",fence\n'
    assert len(text) > 200_000
    (fence,), left_out = shapes_of_wkt(text)
    assert (fence.name, len(fence.rings[0]), left_out) == ("fence", 8_000, [])


SQUARES = ["POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))", "POLYGON ((5 0, 6 0, 6 1, 5 1, 5 0))"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("\n".join(SQUARES), {"map"}),
        ("SRID=25832;" + "\nSRID=25832;".join(SQUARES) + "\n", {"map"}),
        (f'WKT,id,name\n"{SQUARES[0]}",1,shed\n"{SQUARES[1]}",2,hedge\n', {"shed", "hedge"}),
        (f"id;wkt_geom\n1;{SQUARES[0]}\n2;{SQUARES[1]}\n", {"a1", "a2"}),
        (f"GEOMETRYCOLLECTION (\n{SQUARES[0]},\n{SQUARES[1]})", {"map"}),
    ],
)
def test_well_known_text_as_databases_and_tables_have_it(tmp_path: Path, text: str, names: set[str]) -> None:
    (tmp_path / "map.csv").write_text(text)
    problem = import_map(tmp_path / "map.csv").problem
    assert set(load_text(problem).obstacles) == names
    assert taken(problem, [[0.5, 0.5], [5.5, 0.5], [3.0, 0.5]]) == [True, True, False]


@pytest.mark.parametrize(
    ("obstacle", "region", "message"),
    [
        ("{file: yard.geojson, feature: aa}", "", r":5:\d+: error: obstacles.o1.feature: .*no feature named 'aa'"),
        ("{file: yard.geojson, feature: gate}", "{file: yard.geojson}", r":4:\d+: error: regions.goal.file: expected"),
        ("{file: ../yard.geojson}", "", "in the same folder or below"),
        ("{file: /etc/passwd}", "", "in the same folder or below"),
        ("{file: link.json}", "", "in the same folder or below"),
        ("{file: pipe}", "", "which is none"),
        ("{file: cut.json}", "", r"cut.json:2:3: not JSON"),
        ("{box: [[0, 1], [0, 1]], tolerance: 1 m}", "", "expected tolerance only with file"),
        ("{file: yard.geojson, tolerance: -1}", "", "0 or more"),
    ],
)  # fmt: skip
def test_mistakes_in_a_problem_have_their_place(tmp_path: Path, obstacle: str, region: str, message: str) -> None:
    import os

    folder = tmp_path / "inner"
    folder.mkdir()
    geojson(
        folder, feature("a", square(0, 0)), feature("b", square(5, 0)), feature("gate", square(9, 9), role="region")
    )
    (tmp_path / "yard.geojson").write_text("{}")
    (folder / "link.json").symlink_to(tmp_path / "yard.geojson")
    os.mkfifo(folder / "pipe")
    (folder / "cut.json").write_text('{"type":\n  }')
    with pytest.raises(ConfigError, match=message):
        load(problem_file(folder, obstacle, region or "{box: [[0, 1], [0, 1]]}"))


# --- hostile files


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, data: bytes) -> bytes:
    """A grey PNG with these pixels, packed."""
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def squares(count: int) -> str:
    return json.dumps({"type": "MultiPolygon", "coordinates": [[square(2 * k, 0)] for k in range(count)]})


def ring_of(text: str) -> str:
    return f'{{"type": "Polygon",\n "coordinates": [[[0, 0], {text}]]}}'


HOSTILE: dict[str, tuple[str, Callable[[], str], str]] = {
    "NaN": (".json", lambda: ring_of("[1, NaN], [1, 1], [0, 0]"), r":2:31: error: expected finite numbers, got NaN"),
    "infinite": (".json", lambda: ring_of("[1, 1e999], [1, 1], [0, 0]"), r"coordinates\[0\]\[1\]: .*got \[1, .inf\]"),
    "huge number": (".json", lambda: ring_of(f"[1, {10**400}], [1, 1], [0, 0]"), "finite numbers"),
    "endless digits": (".json", lambda: ring_of(f"[1, {'1' * 10_000}], [1, 1], [0, 0]"), "numbers of usual length"),
    "text for a number": (".json", lambda: ring_of('[1, "a"], [1, 1], [0, 0]'), "finite numbers"),
    "far away": (".json", lambda: ring_of("[1e200, 0], [1, 1], [0, 0]"), "at most 1e\\+08 m"),
    "not closed": (".json", lambda: ring_of("[1, 0], [1, 1], [0, 1]"), r"closed ring, got one from \[0.0, 0.0\] to"),
    "too short": (".json", lambda: ring_of("[1, 0], [0, 0]"), "at least 4 positions, got 3"),
    "a bow": (".json", lambda: ring_of("[2, 2], [2, 0], [0, 1], [0, 0]"), "does not cross itself"),
    "cut off": (".json", lambda: '{"type": "Polygon", "coordinates": [[[0,', ":1:41: error: not JSON: expecting value"),
    "nested": (".json", lambda: "[" * 200_000, "nested at most"),
    "collections": (".json", lambda: '{"type": "GeometryCollection", "geometries": [' * 30 + "]}" * 30, "nested at"),
    "a line": (".json", lambda: '{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', "got only 1 LineString"),
    "no object": (".json", lambda: "[1, 2]", "GeoJSON object"),
    "unhashable type": (".json", lambda: '{"type": {}}', "GeoJSON object"),
    "no polygons": (".json", lambda: '{"type": "FeatureCollection", "features": []}', "at least one polygon"),
    "thousands": (".json", lambda: squares(2000), "at most 1000 polygons, got 2000"),
    "a million": (".json", lambda: squares(10) + " " * 5_000_000, "at most 5 MB"),
    "many corners": (".json", lambda: ring_of("[1, 0], " * 12_000 + "[0, 0]"), "10000 corners"),
    "deep WKT": (".wkt", lambda: "GEOMETRYCOLLECTION (" * 100_000, "nested at most 20"),
    "NaN in WKT": (".wkt", lambda: "POLYGON ((0 0, nan 1, 1 1, 0 0))", r"at most 1e\+08 m, got \[nan, 1\]"),
    "open WKT": (".wkt", lambda: "POLYGON ((0 0, 2 1, 1 1, 0 1))", "expected WKT"),
    "not YAML": (".yaml", lambda: "image: room.pgm\nresolution: [\n", r":3:1: error: not YAML"),
    "no image": (".yaml", lambda: json.dumps({"image": "none.pgm", **FINE}), "none.pgm: no such file"),
    "image elsewhere": (".yaml", lambda: json.dumps({"image": "../room.pgm", **FINE}), r":1:11: .*same folder"),
    "no resolution": (".yaml", lambda: "image: room.pgm\nresolution: 0\n", r":2:13: .*above 0, got 0"),
    "huge resolution": (".yaml", lambda: f"image: room.pgm\nresolution: 1{'0' * 400}\n", r":2:13: .*a finite number"),
    "NaN origin": (".yaml", lambda: "resolution: 1\norigin: [0, .nan, 0]", r":2:9: .*\[x, y, yaw\]"),
    "another mode": (
        ".yaml",
        lambda: json.dumps({"image": "room.pgm", "mode": "rough", **FINE}),
        "one of trinary, scale, raw",
    ),
    "origin without a yaw": (
        ".yaml",
        lambda: json.dumps({"image": "room.pgm", "resolution": 0.5, "origin": [0, 0, float("nan")]}),
        "write 0 as its yaw, unless the map is turned",
    ),
    "degrees by their system": (
        ".json",
        lambda: ring_of("[1, 1], [9, 1], [9, 9], [1, 1]").replace(
            '{"type"', '{"crs": {"type": "name", "properties": {"name": "EPSG:4326"}}, "type"', 1
        ),
        r"got degrees \('EPSG:4326'\)",
    ),
    "degrees by their size": (
        ".json",
        lambda: '{"type": "Polygon", "coordinates": [[[11.57, 48.1], [11.58, 48.1], [11.58, 48.11], [11.57, 48.1]]]}',
        "which can only be degrees",
    ),
    "degrees of EWKT": (".wkt", lambda: "SRID=4326;POLYGON ((0 0, 8 0, 8 8, 0 0))", "project it to metres first"),
    "a spike": (".wkt", lambda: "POLYGON ((0 0, 4 0, 2 0, 2 -1, 2 4, 0 0))", "shapely.make_valid"),
    "a line among geometries": (
        ".wkt",
        lambda: "POLYGON ((0 0, 1 0, 1 1, 0 0))\nPOLYGON ((5 0, 6 0, 6 1, 5 0)\n",
        "map.wkt:2:1: error: expected WKT",
    ),
    "empty": (".yaml", lambda: "", "resolution: expected a finite number above 0, got nothing"),
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE.values(), ids=HOSTILE)
def test_hostile_files_are_refused(tmp_path: Path, case: tuple[str, Callable[[], str], str]) -> None:
    suffix, text, message = case
    path = tmp_path / f"map{suffix}"
    path.write_text(text())
    with pytest.raises(ConfigError, match=message) as caught:
        import_map(path)
    assert len(str(caught.value)) < 500


IMAGES: dict[str, tuple[str, bytes, str]] = {
    "truncated PGM": ("a.pgm", b"P5\n100 100\n255\n" + bytes(50), "truncated"),
    "truncated plain PGM": ("a.pgm", b"P2\n100 100\n255\n0 0 0\n", "can't be read"),
    "PGM without a size": ("a.pgm", b"P5\n", "expected an image|can't be read"),
    "huge PGM": ("a.pgm", b"P5\n1000000 1000000\n255\n" + bytes(50), "at most 16,000,000 cells"),
    "large PGM": ("a.pgm", b"P5\n9000 9000\n255\n" + bytes(50), "16,000,000 cells, got 9000 x 9000"),
    "large PNG": ("a.png", png(10_000, 10_000, bytes(10_000)), "16,000,000 cells, got 10000 x 10000"),
    "bomb": ("a.png", png(60_000, 60_000, bytes(10_000_000)), "at most 16,000,000 cells"),
    "truncated PNG": ("a.png", png(60, 60, bytes(10_000))[:60], "can't be read|truncated"),
    "no image at all": ("a.png", b"hello", "expected an image in PGM or PNG"),
}


@pytest.mark.parametrize("case", IMAGES.values(), ids=IMAGES)
@pytest.mark.filterwarnings("error")
def test_hostile_images_are_refused(tmp_path: Path, case: tuple[str, bytes, str]) -> None:
    name, content, message = case
    (tmp_path / name).write_bytes(content)
    (tmp_path / "map.yaml").write_text(json.dumps({"image": name, **FINE}))
    with pytest.raises(ConfigError, match=message):
        import_map(tmp_path / "map.yaml")


# --- the problems of configs/maps


def test_the_yard_takes_its_features_from_one_file() -> None:
    loaded = read(CONFIGS / "maps" / "yard.yaml")
    assert loaded.warnings == ()
    pieces = {name: len(found) for name, found in loaded.problem.obstacles.items()}
    assert pieces == {"house": 2, "greenhouse": 4, "hedge": pieces["hedge"], "trees": 2}
    assert pieces["hedge"] < 6
    assert loaded.problem.regions["gate"].contains([8.5, 8.8])


def test_the_office_is_planned_and_proven() -> None:
    problem = load(CONFIGS / "maps" / "office.yaml")
    assert 20 <= len(problem.pieces) <= 40
    found = solve(problem)
    assert found.status == "planned"
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.attempt.value.cost <= 1.1
    run = replay(problem, found.controls, members=1000, substeps=5)
    assert not run.violating.any()
