"""What a map shows, in two coordinates: the plane, space from above and from the side, or a line over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.drawing import frame, highest, outlines, shadow, target_lines
from ensemble_ctrl.problem.starts import places
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.report.transform import Canvas

Floats = NDArray[np.float64]
View = tuple[int, int]

VIEWS: dict[int, tuple[View, ...]] = {2: ((0, 1),), 3: ((0, 1), (0, 2))}
"""Pairs of coordinates that are drawn, for so many: the plane, or space from above and from the side. A line has none:
it is drawn over time."""
OVER_TIME = 0.55
"""Height of a line over time, in widths."""
NAMED = 12
"""Starts up to which their names are drawn."""
INSTANTS = 21
"""Times at which moving obstacles count for what a map has to show."""


@dataclass(frozen=True, eq=False)
class Shape:
    """An obstacle as it is drawn.

    Attributes
    ----------
    name : str
    pieces : tuple of ndarray, shape (corners, 2)
    beside : tuple of bool
        Which pieces lie beside the fleet's way along the coordinates that are not drawn, so that they would only hide
        it.
    motion : Motion or None
        How it moves.
    """

    name: str
    pieces: tuple[Floats, ...]
    beside: tuple[bool, ...]
    motion: Motion | None = None

    @property
    def largest(self) -> Floats:
        """The piece that has most room for a name, of those in the way if there are any."""
        met = [piece for piece, beside in zip(self.pieces, self.beside, strict=True) if not beside]
        return max(met or self.pieces, key=lambda corners: float(np.ptp(corners, axis=0).prod()))


@dataclass(frozen=True, eq=False)
class MapContent:
    """One drawing of a map.

    Attributes
    ----------
    problem : Problem
        Whose map.
    view : (int, int) or None
        The coordinates of the position that are drawn; None for a line over time.
    paths : ndarray, shape (members, times, 2)
        Ways of members.
    obstacles : tuple of Shape
    regions : dict of str to ndarray, shape (corners, 2)
        Zones among them, by their names with their rules.
    patches : tuple of Shape
        Patches of terrain.
    zones : dict of str to Zone
        Which of the regions are pieces of zones, by the same names.
    """

    problem: Problem
    view: View | None
    paths: Floats
    obstacles: tuple[Shape, ...]
    regions: dict[str, Floats]
    patches: tuple[Shape, ...] = ()
    zones: dict[str, Zone] = field(default_factory=dict)

    @property
    def labels(self) -> tuple[str, str]:
        """What runs along both axes, with units."""
        if self.view is None:
            return "t [s]", f"{self.problem.fleet.places[0]} [m]"
        across, up = (f"{self.problem.fleet.places[k]} [m]" for k in self.view)
        return across, up

    @property
    def hidden(self) -> str:
        """The coordinate along which space is seen; empty in the plane."""
        others = [n for k, n in enumerate(self.problem.fleet.places) if self.view and k not in self.view]
        return ", ".join(others)

    @property
    def heading(self) -> float | None:
        """Of the fleet at the start, radians; None for robots that have none."""
        return self.problem.fleet.heading if self.problem.fleet.system.heading_state else None

    @property
    def tags(self) -> dict[str, Floats]:
        """Above which point the name of a region belongs, below it for a zone, shape (2,); side by side over time."""
        if self.view is not None:
            return {name: highest(corners) for name, corners in self.regions.items()}
        each = self.problem.duration / max(len(self.regions), 1)
        return {n: np.array([(k + 0.5) * each, c[:, 1].max()]) for k, (n, c) in enumerate(self.regions.items())}

    @property
    def starts(self) -> dict[str, Floats]:
        """Where the fleet starts, by the names of its starts, shape (2,) each."""
        return {name: self.at(place, 0.0) for name, place in places(self.problem).items()}

    @property
    def named_starts(self) -> dict[str, Floats]:
        """The starts whose names are drawn: of several, unless there are too many."""
        return self.starts if 1 < len(self.starts) <= NAMED else {}

    @property
    def standing(self) -> list[Floats]:
        """Bodies of a footprint at the starts, shape (corners, 2) each."""
        body = self.problem.fleet.footprint
        if body is None or self.heading is None:
            return []
        return [body.at(place, np.array(self.heading)) for place in self.starts.values()]

    @property
    def target(self) -> Floats | None:
        """The one place where the fleet should end, shape (2,), if there is one."""
        place = self.problem.objective.place
        return None if place is None else self.at(np.asarray(place, dtype=float), self.problem.duration)

    @property
    def lines(self) -> list[Floats]:
        """Other targets, as lines of shape (points, 2)."""
        if self.view is not None:
            return target_lines(self.problem, self.view)
        return [np.insert(line, 0, self.problem.duration, axis=1) for line in target_lines(self.problem, (0,))]

    @property
    def radius(self) -> float:
        """Of a robot, metres; zero over time, where a disk would mean nothing."""
        return 0.0 if self.view is None else self.problem.fleet.radius

    def at(self, place: Floats, time: float) -> Floats:
        """A place at a time in the drawing's coordinates, shape (2,)."""
        return np.array([time, place[0]]) if self.view is None else place[list(self.view)]

    def canvas(self, width: float, left: float = 0.0, top: float = 0.0, more: Sequence[Floats] = ()) -> Canvas:
        """A drawing so wide that shows all of it, wherever obstacles go, and more shapes of shape (points, 2)."""
        ways = [*(start[None, :] for start in self.starts.values()), *self.paths]
        # discs of the robots' radius reach beyond their ways
        reach = self.radius if self.problem.fleet.footprint is None else 0.0
        corners = reach * np.array([[-1.0, -1.0], [1.0, 1.0]])
        shapes = [*self.standing, *(end + corners for way in ways for end in (way.min(axis=0), way.max(axis=0)))]
        for obstacle in (*self.obstacles, *self.patches):
            times = np.linspace(0.0, self.problem.duration, INSTANTS)
            offsets = np.zeros((1, 2)) if obstacle.motion is None else obstacle.motion.at(times)
            shapes += [corners + offset for corners in obstacle.pieces for offset in offsets]
        shapes += [*self.regions.values(), *self.lines, *more]
        if self.view is not None:
            return Canvas.around(*frame(shapes), width, left, top)
        points = np.concatenate(shapes)
        low, size = points.min(axis=0), np.ptp(points, axis=0)
        border = np.array([0.03, 0.08]) * np.maximum(size, 1e-3)
        return Canvas.around(low - border, size + 2 * border, width, left, top, OVER_TIME)


def map_contents(problem: Problem, paths: Floats) -> tuple[MapContent, ...]:
    """The drawings that show all of a map.

    Parameters
    ----------
    problem : Problem
    paths : ndarray, shape (members, times, d)
        Positions of members at times that are evenly spread over the horizon, or in the plane at any.
    """
    return tuple(_content(problem, paths, view) for view in VIEWS.get(len(problem.fleet.places), (None,)))


def _content(problem: Problem, paths: Floats, view: View | None) -> MapContent:
    """One of them."""
    if view is None:
        # a line: time across, position up
        times = np.broadcast_to(np.linspace(0.0, problem.duration, paths.shape[1]), paths.shape[:2])
        return MapContent(problem, None, np.stack([times, paths[..., 0]], axis=-1), (), dict(_bands(problem)))
    obstacles = []
    for name, pieces in problem.obstacles.items():
        shadows = tuple(shadow(piece.vertices, view) for piece in pieces)
        beside = tuple(_beside(piece.vertices, view, paths) for piece in pieces)
        motion = problem.motions.get(name)
        if motion is not None:  # it may come in the way from where it is drawn
            motion, beside = replace(motion, offsets=motion.offsets[:, list(view)]), (False,) * len(pieces)
        obstacles.append(Shape(name, shadows, beside, motion))
    regions = {name: shadow(corners, view) for name, corners in outlines(problem, list(paths)).items()}
    zones = {}
    for name, zone in problem.zones.items():
        for k, piece in enumerate(zone.pieces):
            number = f" ({k + 1})" if len(zone.pieces) > 1 else ""
            title = f"{name}{number}: {zone}"
            regions[title], zones[title] = shadow(piece.vertices, view), zone
    patches = tuple(
        Shape(name, tuple(shadow(piece.vertices, view) for piece in patch.pieces), (False,) * len(patch.pieces))
        for name, patch in problem.terrain.items()
    )
    return MapContent(problem, view, paths[..., list(view)], tuple(obstacles), regions, patches, zones)


def moved_bodies(problem: Problem, paths: Floats, turned: Floats) -> list[Floats]:
    """Corners of the bodies of a footprint on their ways, shape (corners, 2) each; none for robots that are discs.

    Parameters
    ----------
    problem : Problem
    paths : ndarray, shape (members, times, 2)
    turned : ndarray, shape (members, times)
        Headings, radians.
    """
    body = problem.fleet.footprint
    return [] if body is None else list(body.at(paths, turned).reshape(len(paths), -1, 2))


def _bands(problem: Problem) -> Iterator[tuple[str, Floats]]:
    """Bounded regions of a line over the whole time."""
    for name, region in problem.regions.items():
        if region.is_bounded:
            low, high, end = float(region.vertices.min()), float(region.vertices.max()), problem.duration
            yield name, np.array([[0.0, low], [end, low], [end, high], [0.0, high]])


def _beside(corners: Floats, view: View, paths: Floats) -> bool:
    """Whether no way is as far along the coordinates that are not drawn."""
    # the intervals in some hidden coordinate do not overlap
    hidden = [k for k in range(corners.shape[1]) if k not in view]
    low, high = paths[..., hidden].min(axis=(0, 1)), paths[..., hidden].max(axis=(0, 1))
    return bool((corners[:, hidden].min(axis=0) > high).any() or (corners[:, hidden].max(axis=0) < low).any())
