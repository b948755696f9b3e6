"""What a drawing of a map shows, and the map as SVG text, so that a notebook shows it without a plotting library."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem.starts import places
from ensemble_ctrl.problem.target import Formation, SpreadTarget

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

WIDTH = 320
"""Width of the drawing in pixels."""
BAND = 0.1
"""Half the height at which a region of a line is drawn, metres."""
DOTTED = 'fill="none" stroke-dasharray="2 3"'
TALLEST, FLATTEST = 2.0, 0.3
"""Most and least height, in widths."""


def map_svg(
    problem: Problem, paths: Sequence[Floats] = (), colours: Sequence[str] = (), marks: Sequence[Floats] = ()
) -> str:
    """Obstacles with their ways, regions, target and start, and the paths of some members.

    Parameters
    ----------
    problem : Problem
        Whose map.
    paths : sequence of ndarray, shape (times, 2)
        Positions of one member each, in metres.
    colours : sequence of str
        Of the paths; black where there are too few.
    marks : sequence of ndarray, shape (2,)
        Places to mark with a ring: where something goes wrong.

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    paths, marks = [_flat(path) for path in paths], [_flat(mark[None])[0] for mark in marks]
    regions = {name: shadow(corners) for name, corners in outlines(problem, paths).items()}
    targets = [_flat(line) for line in target_lines(problem)]
    shapes = [shadow(piece.vertices) for _, piece in problem.pieces] + _ends(problem)
    shapes += [shadow(piece.vertices) for zone in problem.zones.values() for piece in zone.pieces]
    shapes += [piece.vertices for patch in problem.terrain.values() for piece in patch.pieces]
    shapes += [*regions.values(), *paths, *targets, *(mark[None] for mark in marks)]
    sheet = _Sheet(*frame([*_standing(problem), *shapes]))
    strokes = [*colours, *["black"] * len(paths)]
    parts = [
        *_patches(sheet, problem),
        *_regions(sheet, regions),
        *_zones(sheet, problem),
        *_obstacles(sheet, problem),
        *(f'<polyline points="{sheet.text(line)}" {DOTTED} stroke="black"/>' for line in targets),
        *(
            f'<polyline points="{sheet.text(path)}" fill="none" stroke="{stroke}" stroke-width="1.3"/>'
            for path, stroke in zip(paths, strokes, strict=False)
        ),
        _start(sheet, problem),
    ]
    for x, y in map(sheet.at, marks):
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7" fill="none" stroke="#c4121f" stroke-width="2.5"/>')
    size = f'width="{WIDTH}" height="{sheet.height}" viewBox="0 0 {WIDTH} {sheet.height}"'
    ground = f'<rect width="{WIDTH}" height="{sheet.height}" fill="white"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{ground}{"".join(parts)}</svg>'


@dataclass(frozen=True, eq=False)
class _Sheet:
    """Where metres are on the drawing."""

    low: Floats
    span: Floats

    @property
    def height(self) -> int:
        """Pixels."""
        return round(WIDTH * float(self.span[1] / self.span[0]))

    def at(self, point: Floats) -> tuple[float, float]:
        """Pixels of one place."""
        # from metres to pixels, whose y runs down
        x, y = ((point - self.low) / self.span).tolist()
        return WIDTH * x, self.height * (1 - y)

    def text(self, points: Floats) -> str:
        """Pixels of places, as SVG wants them."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self.at, points))

    def name(self, name: str, point: Floats, colour: str, lower: float) -> str:
        """A name at a place, some pixels lower."""
        x, y = self.at(point)
        font = 'text-anchor="middle" font-family="sans-serif" font-size="11"'
        return f'<text x="{x:.1f}" y="{max(y + lower, 11):.1f}" fill="{colour}" {font}>{escape(name)}</text>'


def _patches(sheet: _Sheet, problem: Problem) -> Iterator[str]:
    """Patches of terrain with their names."""
    for name, patch in problem.terrain.items():
        for piece in patch.pieces:
            yield f'<polygon points="{sheet.text(piece.vertices)}" fill="#d9c3a0" stroke="#7a5c2e"/>'
        yield sheet.name(name, patch.pieces[0].vertices.mean(axis=0), "#7a5c2e", 4)


def _regions(sheet: _Sheet, regions: dict[str, Floats]) -> Iterator[str]:
    """Areas with their names above them."""
    for name, corners in regions.items():
        yield f'<polygon points="{sheet.text(corners)}" fill="#2166ac" fill-opacity="0.13" stroke="#2166ac"/>'
        yield sheet.name(name, highest(corners), "#2166ac", -3)


def _zones(sheet: _Sheet, problem: Problem) -> Iterator[str]:
    """Areas with a rule, dotted, with their names and rules above them."""
    for name, zone in problem.zones.items():
        colour = "#b2182b" if zone.speed is None else "#8a5a00"
        shapes = [shadow(piece.vertices) for piece in zone.pieces]
        for corners in shapes:
            yield f'<polygon points="{sheet.text(corners)}" fill="{colour}" fill-opacity="0.1" stroke="{colour}"/>'
        yield sheet.name(f"{name}: {zone}", highest(shapes[0]), colour, -3)


def _obstacles(sheet: _Sheet, problem: Problem) -> Iterator[str]:
    """Obstacles with their names where there is room; where moving ones go, dotted."""
    times = np.linspace(0.0, problem.duration, 41)
    for name, motion in problem.motions.items():
        for piece in problem.obstacles[name]:
            way = _flat(piece.vertices.mean(axis=0) + motion.at(times))
            yield f'<polyline points="{sheet.text(way)}" {DOTTED} stroke="#5a5f68"/>'
    for corners in _ends(problem):
        yield f'<polygon points="{sheet.text(corners)}" {DOTTED} stroke="#5a5f68"/>'
    for name, pieces in problem.obstacles.items():
        shapes = [shadow(piece.vertices) for piece in pieces]
        for corners in shapes:
            yield f'<polygon points="{sheet.text(corners)}" fill="#8a8f98"/>'
        widest = max(shapes, key=lambda corners: float(np.ptp(corners, axis=0).min()))
        if float(np.ptp(widest, axis=0).min() / sheet.span[0]) * WIDTH > 14:
            yield sheet.name(name, widest.mean(axis=0), "white", 4)


def _start(sheet: _Sheet, problem: Problem) -> str:
    """An arrow head at each start in the direction of the heading; a disk where a robot has none."""
    return "".join(_head(sheet, problem, place) for place in places(problem).values())


def _head(sheet: _Sheet, problem: Problem, place: Floats) -> str:
    """The mark at one start."""
    x, y = sheet.at(_flat(place[None, :])[0])
    body = problem.fleet.footprint
    if body is not None:
        corners = sheet.text(body.at(place, np.array(problem.fleet.heading)))
        return f'<polygon points="{corners}" fill="none" stroke="black"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.5"/>'
    if not problem.fleet.system.heading_state:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
    turn = f"translate({x:.1f} {y:.1f}) rotate({-np.degrees(problem.fleet.heading):.1f})"
    return f'<path transform="{turn}" d="M8 0L-5 5L-2 0L-5 -5Z"/>'


def _standing(problem: Problem) -> list[Floats]:
    """What each start takes up: a place, or a body."""
    starts, body, heading = places(problem).values(), problem.fleet.footprint, np.array(problem.fleet.heading)
    return [_flat(place[None, :]) if body is None else body.at(place, heading) for place in starts]


def _ends(problem: Problem) -> list[Floats]:
    """Where moving obstacles are at the end, shape (corners, 2) each."""
    return [
        shadow(piece.vertices + motion.at(problem.duration))
        for name, motion in problem.motions.items()
        for piece in problem.obstacles[name]
    ]


def card_html(picture: str, title: str, rows: Sequence[tuple[str, str]]) -> str:
    """A picture with a title and labelled texts beside it, below it where there is no room; for notebooks."""
    cells = "".join(
        f'<tr><td style="text-align:left;vertical-align:top;white-space:nowrap;opacity:0.7">{escape(label)}</td>'
        f'<td style="text-align:left">{escape(text)}</td></tr>'
        for label, text in rows
    )
    side = "flex:1 1 320px;min-width:0;overflow-wrap:anywhere"
    text = f'<div style="{side}"><b>{escape(title)}</b><table>{cells}</table></div>'
    return f'<div style="display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start"><div>{picture}</div>{text}</div>'


def outlines(problem: Problem, paths: Sequence[Floats] = ()) -> dict[str, Floats]:
    """Corners of every region by name; of an unbounded one, the part near everything else that is drawn.

    Parameters
    ----------
    problem : Problem
        Whose regions.
    paths : sequence of ndarray, shape (times, 2)
        What else is drawn, in metres.

    Returns
    -------
    dict of str to ndarray, shape (corners, 2)
        Without regions that are nowhere near.
    """
    bounded = {name: region.vertices for name, region in problem.regions.items() if region.is_bounded}
    if len(problem.fleet.places) != 2:
        return bounded
    patches = [piece.vertices for patch in problem.terrain.values() for piece in patch.pieces]
    drawn = [piece.vertices for _, piece in problem.pieces] + [*patches, *bounded.values(), *paths]
    # unbounded regions are cut by a window around everything else
    low, size = frame([*(place[None, :] for place in places(problem).values()), *drawn])
    window = (low - 0.1 * size - 0.5, low + 1.1 * size + 0.5)
    parts = {name: region if name in bounded else _within(region, *window) for name, region in problem.regions.items()}
    return {name: part.vertices for name, part in parts.items() if not part.is_empty}


def shadow(points: Floats, view: tuple[int, int] = (0, 1)) -> Floats:
    """Corners of the convex hull of points seen in two of their coordinates, counter-clockwise, shape (corners, 2).

    Points of the plane are returned as they are; those of a line become a flat band.

    Examples
    --------
    >>> cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 2)], float)
    >>> shadow(cube, (0, 2)).tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]
    """
    if points.shape[1] == 2:
        return points
    if points.shape[1] == 1:
        low, high = points.min(), points.max()
        return np.array([[low, -BAND], [high, -BAND], [high, BAND], [low, BAND]])
    # convex hull in the view: Andrew's monotone chain, lower and upper part
    flat = np.unique(np.round(points[:, list(view)], 12), axis=0)
    return np.concatenate([_chain(flat)[:-1], _chain(flat[::-1])[:-1]])


def _chain(points: Floats) -> Floats:
    """The right-hand side of the hull of points sorted along it (Andrew's monotone chain)."""
    kept: list[Floats] = []
    for point in points:
        while len(kept) > 1:
            first, second = kept[-1] - kept[-2], point - kept[-1]
            if first[0] * second[1] - first[1] * second[0] > 0:
                break
            kept.pop()
        kept.append(point)
    return np.array(kept)


def _flat(path: Floats) -> Floats:
    """Points in the first two coordinates; those of a line at height zero."""
    return path[:, :2] if path.shape[1] > 1 else np.column_stack([path, np.zeros(len(path))])


def target_lines(problem: Problem, view: Sequence[int] = (0, 1)) -> list[Floats]:
    """Where the fleet should end, as lines of shape (points, coordinates) in metres.

    A formation's places; of mean and covariance the ellipse of one standard deviation, in one coordinate its ends. One
    place, and moments, have no line.

    Parameters
    ----------
    problem : Problem
    view : sequence of int
        The coordinates of the position that are drawn, one or two; those that it has.
    """
    target, columns = problem.objective.target, [k for k in view if k < len(problem.fleet.places)]
    if isinstance(target, Formation):
        return [target.places[:, columns]]
    if isinstance(target, SpreadTarget):
        # ellipse of one standard deviation: m + V diag(lambda)^(1/2) (cos t, sin t)
        values, vectors = np.linalg.eigh(target.covariance[np.ix_(columns, columns)])
        turn = np.linspace(0, 2 * np.pi, 65)
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1) if len(columns) > 1 else np.array([[-1.0], [1.0]])
        return [target.mean[columns] + circle * np.sqrt(np.maximum(values, 0.0)) @ vectors.T]
    return []


def highest(corners: Floats) -> Floats:
    """The middle of an area's highest corners, where its name belongs, shape (2,)."""
    top = corners[:, 1].max()
    return np.asarray(corners[corners[:, 1] > top - 1e-3 * np.ptp(corners[:, 1])].mean(axis=0))


def _within(region: Polyhedron, low: Floats, high: Floats) -> Polyhedron:
    """The part of a region in a box."""
    A = np.vstack([region.A, np.eye(2)])
    return Polyhedron(A, np.concatenate([region.lower, low]), np.concatenate([region.upper, high]))


def frame(shapes: Iterable[Floats]) -> tuple[Floats, Floats]:
    """Lower left corner and size of what is drawn: everything with a border, neither too tall nor too flat."""
    points = np.concatenate(list(shapes))
    low, high = points.min(axis=0), points.max(axis=0)
    # a border of 6 %, then grown about the middle to a height of FLATTEST to TALLEST widths
    border = 0.06 * max(float((high - low).max()), 1e-3)
    middle, size = (low + high) / 2, high - low + 2 * border
    size = np.array([max(size[0], size[1] / TALLEST), max(size[1], size[0] * FLATTEST)])
    return middle - size / 2, size
