"""Maps in degrees of longitude and latitude, which a planner in metres can't take."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ensemble_ctrl.files.config.errors import show
from ensemble_ctrl.files.config.tree import TextError

GEOGRAPHIC = frozenset((
    4148, 4171, 4202, 4203, 4230, 4258, 4267, 4269, 4277, 4283, 4289, 4291, 4312, 4313, 4314, 4322, 4326, 4490, 4612,
    4617, 4668, 4674, 4979, 6318, 6668, 7844,
))  # fmt: skip
"""EPSG codes of systems whose coordinates are degrees, those that maps of our time are in."""
SMALL = 0.02
"""Degrees, about 2 km; a map in metres is not as small as that."""
HINT = "project it to metres first: ogr2ogr -t_srs EPSG:32632 (the zone that it lies in), or Reproject in QGIS"


def check_system(name: str) -> None:
    """Refuse a coordinate system whose coordinates are degrees.

    Raises
    ------
    TextError
        With the way out.
    """
    codes = {int(code) for code in re.findall(r"\d{4,6}", name)}
    if codes & GEOGRAPHIC or re.search(r"crs:?84|crs:?83|crs:?27|wgs ?84$", name, re.IGNORECASE):
        raise TextError(f"expected coordinates in metres, got degrees ({show(name)})", hint=HINT)


def check_places(places: Sequence[tuple[float, float]]) -> None:
    """Refuse coordinates that can only be degrees: a map of some millimetres, many times as far from the origin.

    Raises
    ------
    TextError
        With the way out.
    """
    if not places:
        return
    x, y = [place[0] for place in places], [place[1] for place in places]
    size = max(max(x) - min(x), max(y) - min(y))
    far = max(map(abs, [*x, *y]))
    if size < SMALL and far > 1.0 and max(map(abs, x)) <= 180 and max(map(abs, y)) <= 90:
        got = f"a map {1000 * size:.3g} mm wide at [{x[0]:g}, {y[0]:g}], which can only be degrees"
        raise TextError(f"expected coordinates in metres, got {got}", hint=HINT)
