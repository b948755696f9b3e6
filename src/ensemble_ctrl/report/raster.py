"""Maps drawn with Pillow at twice the size and made smaller, which is fast: what pictures of an animation share."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.map_content import MapContent, map_contents
from ensemble_ctrl.report.pagecharts import ticks
from ensemble_ctrl.report.palette import (
    GRID,
    INSIDE,
    INSIDE_KEEP_OUT,
    INSIDE_SLOW,
    KEEP_OUT,
    OBSTACLE,
    OBSTACLE_EDGE,
    ON_OBSTACLE,
    OUTLINE,
    PATCH,
    PATCH_EDGE,
    REGION,
    SLOW,
    SOFT,
    viridis,
)
from ensemble_ctrl.report.text import short, unit_of
from ensemble_ctrl.report.transform import Canvas

if TYPE_CHECKING:
    from PIL import Image, ImageDraw, ImageFont

Floats = NDArray[np.float64]
Colour = str | tuple[int, ...]

NARROW = 440
"""Width in pixels for which lengths are given; a unit is one of these."""
HEAD, FOOT = 26, 34
"""Units above the map, for name and time, and below it, for the scales."""
FINE = 2
"""Times the size at which is drawn."""
LONGEST = 40
"""Letters of a name, to leave room for the time."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One view of the map in fine pixels.

    Attributes
    ----------
    content : MapContent
    canvas : Canvas
        From metres to fine pixels.
    unit : float
        Fine pixels in a unit of the layout.
    font : font of Pillow
    """

    content: MapContent
    canvas: Canvas
    unit: float
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont

    def points(self, places: Floats) -> list[tuple[float, float]]:
        """Fine pixels of places of shape (n, 2)."""
        return [(x, y) for x, y in self.canvas.at(places).tolist()]

    def robot(self, pen: ImageDraw.ImageDraw, place: Floats, colour: Colour, heading: float | None = None) -> None:
        """A robot as its body, or as a disk of its size, or larger, where else it would not be seen."""
        body = self.content.problem.fleet.footprint
        if body is not None and heading is not None:
            pen.polygon(self.points(body.at(place, np.array(heading))), colour, OUTLINE, 1)
            return
        ((x, y),) = self.points(place[None])
        radius = max(4.0 * self.unit, self.content.radius * self.canvas.scale)
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), colour, OUTLINE, 1)


@dataclass(frozen=True, eq=False)
class Raster:
    """All views of a map below each other, with room for name and time above and for scales below."""

    problem: Problem
    panels: tuple[Panel, ...]
    size: tuple[int, int]
    scaled: bool = True

    @classmethod
    def of(
        cls, problem: Problem, paths: Floats, width: int, scaled: bool = True, more: Sequence[Floats] = ()
    ) -> Raster:
        """The layout for ways of shape (members, times, d), `width` pixels wide.

        Video and GIF need even sizes. Where colours show no parameter, it is not `scaled`. It has room for `more`
        lines of shape (points, 2).
        """
        from PIL import ImageFont

        unit = FINE * width / NARROW
        font = ImageFont.load_default(13 * unit)
        panels, top = [], HEAD * unit
        for content in map_contents(problem, paths):
            # views below each other, each below the height of those above it
            canvas = content.canvas(FINE * width, top=top, more=more)
            panels.append(Panel(content, canvas, unit, font))
            top += canvas.height
        return cls(problem, tuple(panels), (FINE * width, FINE * 2 * ceil((top + FOOT * unit) / FINE / 2)), scaled)

    def ground(self) -> Image.Image:
        """What does not move."""
        from PIL import Image, ImageDraw

        picture = Image.new("RGB", self.size, "white")
        pen = ImageDraw.Draw(picture)
        for panel in self.panels:
            _draw_map(panel, pen)
        _draw_frame(self, pen)
        return picture

    def draw_now(self, pen: ImageDraw.ImageDraw, time: float) -> None:
        """Obstacles that move, where they are, the names of all, and the time."""
        for panel in self.panels:
            _draw_moving(panel, pen, time)
        unit = self.panels[0].unit
        place = (self.size[0] - 8 * unit, 5 * unit)
        pen.text(place, f"t = {time:.1f} s", "black", self.panels[0].font, anchor="ra")


def _draw_map(panel: Panel, pen: ImageDraw.ImageDraw) -> None:
    """Regions, obstacles that stay, targets and the start."""
    content, unit = panel.content, panel.unit
    colours = _region_colours(content)
    for name, corners in sorted(content.regions.items(), key=lambda one: -float(np.ptp(one[1], axis=0).prod())):
        inside, edge = colours[name]
        pen.polygon(panel.points(corners), inside, edge, FINE)
    for patch in content.patches:
        for corners in patch.pieces:
            pen.polygon(panel.points(corners), PATCH, PATCH_EDGE, FINE)
        ((x, y),) = panel.points(patch.largest.mean(axis=0)[None])
        pen.text((x, y), patch.name, PATCH_EDGE, panel.font, "mm", stroke_width=FINE, stroke_fill="white")
    if content.view is None:
        _draw_numbers(panel, pen)
    for shape in content.obstacles:
        for corners, beside in zip(shape.pieces, shape.beside, strict=True):
            if beside:
                pen.polygon(panel.points(corners), None, OBSTACLE, 1)
            elif shape.motion is None:
                pen.polygon(panel.points(corners), OBSTACLE, OBSTACLE_EDGE, FINE)
    top = panel.canvas.top
    for name, tag in content.tags.items():
        ((x, y),) = panel.points(tag[None])
        above = y - 3 * unit > top + 10 * unit and name not in content.zones
        place, anchor = ((x, y - 3 * unit), "mb") if above else ((x, y + 3 * unit), "mt")
        pen.text(place, name, colours[name][1], panel.font, anchor, stroke_width=FINE, stroke_fill="white")
    for line in content.lines:
        pen.line(panel.points(line), "black", FINE)
    _draw_start(panel, pen)
    if content.hidden:
        names = " and ".join(label.split()[0] for label in content.labels)
        pen.text((8 * unit, top + 4 * unit), names, SOFT, panel.font, anchor="la")


def _region_colours(content: MapContent) -> dict[str, tuple[str, str]]:
    """Of the inside, and of the outline and the name of each region; zones have others."""
    kept, slow = (INSIDE_KEEP_OUT, KEEP_OUT), (INSIDE_SLOW, SLOW)
    ruled = {name: kept if zone.speed is None else slow for name, zone in content.zones.items()}
    return dict.fromkeys(content.regions, (INSIDE, REGION)) | ruled


def _draw_numbers(panel: Panel, pen: ImageDraw.ImageDraw) -> None:
    """Lines at round positions of a line over time, with their numbers."""
    canvas = panel.canvas
    width = panel.content.problem.duration * canvas.across
    for value in ticks(float(canvas.low[1]), float(canvas.low[1]) + canvas.height / canvas.scale):
        ((x, y),) = panel.points(np.array([[0.0, value]]))
        pen.line((x, y, x + width, y), GRID, 1)
        pen.text((x + 4 * panel.unit, y), f"{value:g} m", SOFT, panel.font, anchor="lb")


def _draw_start(panel: Panel, pen: ImageDraw.ImageDraw) -> None:
    """An arrow head at each start in the direction of the heading, with the body; a disk where there is none."""
    heading, unit = panel.content.heading, panel.unit
    for corners in panel.content.standing:
        pen.polygon(panel.points(corners), None, OUTLINE, FINE)
    for x, y in panel.points(np.array(list(panel.content.starts.values()))):
        if heading is None:
            pen.ellipse((x - 4 * unit, y - 4 * unit, x + 4 * unit, y + 4 * unit), "black")
            continue
        # R(heading) on an arrow head; y runs down on the canvas
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        head = np.array([[8.0, 0.0], [-6.0, 5.0], [-6.0, -5.0]]) * unit @ turn.T
        pen.polygon([(x + dx, y - dy) for dx, dy in head.tolist()], "black")
    for name, place in panel.content.named_starts.items():
        ((x, y),) = panel.points(place[None])
        pen.text((x, y + 7 * unit), name, "black", panel.font, "mt", stroke_width=FINE, stroke_fill="white")


def _draw_frame(raster: Raster, pen: ImageDraw.ImageDraw) -> None:
    """The name above, and below the colours of the first parameter and a length, or a time."""
    panel, (width, height) = raster.panels[0], raster.size
    unit, font = panel.unit, panel.font
    pen.rectangle((0, 0, width, (HEAD - 1) * unit), "white")
    pen.rectangle((0, height - (FOOT - 1) * unit, width, height), "white")
    pen.text((8 * unit, 5 * unit), short(raster.problem.name, LONGEST), "black", font, anchor="la")
    y = height - 12 * unit
    # a scale bar of at most a quarter of the picture
    length = _round_length(0.25 * width / panel.canvas.across)
    x = width - 10 * unit
    pen.line((x - length * panel.canvas.across, y, x, y), "black", 2 * FINE)
    text = f"{length:g} {'s' if panel.content.view is None else 'm'}"
    pen.text((x - length * panel.canvas.across - 6 * unit, y), text, "black", font, anchor="rm")
    _draw_scale(raster, pen, y)


def _draw_scale(raster: Raster, pen: ImageDraw.ImageDraw, y: float) -> None:
    """Which colour is which value of the first parameter."""
    panel, fleet = raster.panels[0], raster.problem.fleet
    unit, font = panel.unit, panel.font
    if not raster.scaled or not fleet.names or fleet.upper[0] <= fleet.lower[0]:
        return
    name, post = fleet.names[0], unit_of(fleet.names[0])
    pen.text((8 * unit, y), f"{name} {fleet.lower[0]:.3g}", "black", font, anchor="lm")
    begin = 16 * unit + pen.textlength(f"{name} {fleet.lower[0]:.3g}", font)
    steps = 16
    for k, colour in enumerate(viridis(np.linspace(0, 1, steps)).tolist()):
        left = begin + k * 5 * unit
        pen.rectangle((left, y - 5 * unit, left + 5 * unit, y + 5 * unit), tuple(colour))
    right = begin + (5 * steps + 8) * unit
    pen.text((right, y), f"{fleet.upper[0]:.3g}{post}", "black", font, anchor="lm")


def _draw_moving(panel: Panel, pen: ImageDraw.ImageDraw, time: float) -> None:
    """Obstacles that move, where they are, and the names of all."""
    for shape in panel.content.obstacles:
        offset = np.zeros(2) if shape.motion is None else shape.motion.at(time)
        for corners in shape.pieces if shape.motion is not None else ():
            pen.polygon(panel.points(corners + offset), OBSTACLE, OBSTACLE_EDGE, FINE)
        # the name is drawn where the piece has room for it
        across, up = (np.ptp(shape.largest, axis=0) * panel.canvas.scale).tolist()
        fits = across > pen.textlength(shape.name, panel.font) and up > 14 * panel.unit
        if fits and not all(shape.beside):
            ((x, y),) = panel.points((shape.largest.mean(axis=0) + offset)[None])
            pen.text((x, y), shape.name, ON_OBSTACLE, panel.font, anchor="mm")


def _round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a length."""
    # 10^floor(log10 d) times 5, 2 or 1
    size = 10.0 ** floor(log10(metres))
    return next(m * size for m in (5, 2, 1) if m * size <= metres * (1 + 1e-9))
