"""A map from another tool as a problem file that can be planned at once and completed by its user."""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config.maps import Area, MapContent, box_of, is_box, read_map
from ensemble_ctrl.files.config.messages import Diagnostic, layout
from ensemble_ctrl.files.config.occupancy import Unknown
from ensemble_ctrl.files.config.tree import TextError
from ensemble_ctrl.problem.checks import ALL_OBSTACLES

Floats = NDArray[np.float64]

LITTLE = 1e-3
"""Metres: a start closer to an obstacle than that is in it once it is rounded."""
PLACES = 60
"""Places along each side of the map that are tried as a start."""
HEAD = """\
# {title}, imported from {source}: {content}{grown}.
# Change start, horizon and task to yours, and add regions to go to; `ensemble-plan check` says what does not fit.
version: 1
name: {name}
fleet:
  model: unicycle
  start: {{position: [{x}, {y}], heading: 0 deg}} # the roomiest place found, {room:.3g} m from everything
horizon: {{duration: 20 s}}
task: "{task}"
"""


@dataclass(frozen=True, eq=False)
class Imported:
    """A map as a problem file.

    Attributes
    ----------
    problem : str
        A whole problem: a fleet that starts at the roomiest place of the map, and keeps clear of everything.
    section : str
        Its obstacles and regions alone.
    pieces : int
        How many convex pieces the obstacles have together.
    obstacles, regions : int
        How many there are.
    notes : tuple of str
        What its reader should know of how the map was read.
    """

    problem: str
    section: str
    pieces: int
    obstacles: int
    regions: int
    notes: tuple[str, ...] = ()


def import_map(path: str | Path, tolerance: float | None = None, unknown: Unknown | None = None) -> Imported:
    """Read a map: GeoJSON, WKT, or the ``.yaml`` of an occupancy grid.

    Parameters
    ----------
    path : path
        The map; coordinates in metres.
    tolerance : float, optional
        Metres by which obstacles may grow, so that they need fewer convex pieces; if not given, two cells of an
        occupancy grid, and nothing for shapes.
    unknown : {"occupied", "free"}, optional
        What the cells of an occupancy grid are that no scan has seen; occupied if not given.

    Returns
    -------
    Imported

    Raises
    ------
    ConfigError
        If the map can't be read, is too large, or holds something else than areas; with the place where that is known.

    Notes
    -----
    *Guarantee*: the convex pieces cover every obstacle of the map, and nothing further than `tolerance`
    from one. Unknown cells of a grid, and everything outside of it, count as obstacles.
    """
    path = Path(path)
    try:
        return _written(path, read_map(path, tolerance, unknown), tolerance)
    except TextError as error:
        raise _refusal(path, error) from None


def _written(path: Path, content: MapContent, tolerance: float | None) -> Imported:
    """The texts of a map's areas."""
    areas = content.areas
    names = _names([area.name or "map" for area in areas])
    obstacles = {name: area for name, area in zip(names, areas, strict=True) if not area.region}
    regions = {name: area for name, area in zip(names, areas, strict=True) if area.region}
    section = "obstacles:\n" + "".join(f"  {name}:{_shapes(area.corners)}" for name, area in obstacles.items())
    section = section if obstacles else ""
    if regions:
        section += "regions:\n" + "".join(f"  {name}:{_region(name, area)}" for name, area in regions.items())
    pieces = sum(len(area.corners) for area in obstacles.values())
    place, room = _roomiest(content)
    title = re.sub(r"[^\w .+-]", "", path.stem)[:60].strip(" .") or "map"
    head = HEAD.format(
        title=title,
        source=_printable(path.name),
        content=counted_pieces(len(obstacles), pieces),
        grown="" if not tolerance else f", grown by at most {tolerance:g} m",
        name=json.dumps(title, ensure_ascii=False),
        x=place[0],
        y=place[1],
        room=room,
        task=f"G avoid({ALL_OBSTACLES})" if obstacles else f"F in({next(iter(regions))})",
    )
    return Imported(head + section, section, pieces, len(obstacles), len(regions), content.notes)


def _names(given: Sequence[str]) -> list[str]:
    """Names that a task can use, all different."""
    names: list[str] = []
    for name in given:
        word = re.sub(r"[^\w.-]", "_", name)
        word = word if re.match(r"[^\W\d_]", word) else f"a{word}"
        word = f"{word}_" if word in (*RESERVED, ALL_OBSTACLES) else word
        numbered = (f"{word}_{k}" for k in count(2))
        names.append(word if word not in names else next(other for other in numbered if other not in names))
    return names


def _shapes(corners: Sequence[Floats]) -> str:
    """Convex pieces as they stand behind their name."""
    texts = [_shape(piece) for piece in corners]
    return f" {texts[0]}\n" if len(texts) == 1 else "\n" + "".join(f"    - {text}\n" for text in texts)


def _shape(corners: Floats) -> str:
    """One convex piece, in lines of usual length."""
    text = f"{{box: {box_of(corners).tolist()}}}" if is_box(corners) else f"{{polygon: {corners.tolist()}}}"
    return textwrap.fill(text, 110, subsequent_indent=" " * 10, break_long_words=False, break_on_hyphens=False)


def _region(name: str, area: Area) -> str:
    """A region as it stands behind its name."""
    if len(area.corners) > 1:
        raise TextError(f"expected a convex region, got {name!r} in {len(area.corners)} convex pieces")
    return _shapes(area.corners)


def counted_pieces(obstacles: int, pieces: int) -> str:
    """How many obstacles in how many pieces."""
    return f"{obstacles} obstacle{'s' * (obstacles != 1)} in {pieces} convex piece{'s' * (pieces != 1)}"


def _roomiest(content: MapContent) -> tuple[tuple[float, float], float]:
    """The place of a grid over the map that is furthest from its obstacles, and how far that is, metres.

    Where shapes leave no room between them, places around the map are tried, too; beyond an image nothing is known.
    """
    bounds = box_of(np.concatenate([corners for area in content.areas for corners in area.corners]))
    place, room = _roomiest_in(bounds, content.areas)
    if room < LITTLE and content.edge is None:
        around = 0.5 * float(np.ptp(bounds, axis=1).max())
        place, room = _roomiest_in(bounds + np.array([-around, around]), content.areas)
    if room < LITTLE:
        raise TextError("found no room between the obstacles, as far as they grew", hint="give a smaller tolerance")
    return place, room


def _roomiest_in(bounds: Floats, areas: Sequence[Area]) -> tuple[tuple[float, float], float]:
    """The same of a grid in a box."""
    (left, right), (low, high) = bounds.tolist()
    across, up = np.linspace(left, right, PLACES + 2)[1:-1], np.linspace(low, high, PLACES + 2)[1:-1]
    places = np.stack(np.meshgrid(across, up, indexing="ij"), axis=-1).reshape(-1, 2).round(3)
    room = np.full(len(places), max(right - left, high - low))
    for area in areas:
        for piece in () if area.region else area.pieces:
            np.minimum(room, piece.distance(places), out=room)
    best = int(room.argmax())
    x, y = places[best].tolist()
    return (x, y), float(room[best])


def _printable(text: str) -> str:
    """A name that stays on one line of a comment."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _refusal(path: Path, error: TextError) -> ConfigError:
    """What is wrong with a map, in the form of a problem file's errors."""
    line, column = (error.place.line, error.place.column) if error.place else (None, None)
    name = os.fspath(path)
    found = Diagnostic(name, line, column, "error", "", error.message, error.hint)
    return ConfigError(layout([found], name), (found,))
