"""Which equations of the paper a program has, and what of a task they can say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import Always, Eventually, Inside
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.problem import Problem

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Equations:
    """Switches of the paper's equations, each of which can be seen alone; the dynamics are always there.

    Parameters
    ----------
    polyhedron : bool
        ``eq:polyhedron_moment`` for every region to stay in: all orders, all faces.
    obstacles : bool
        ``eq:setPolyObsArr``, the big-M rows of every obstacle: all facets, all orders, all times.
    disjunction : bool
        ``sum z >= 1`` for every obstacle and time.
    robustness : bool
        The reward ``rho(m)`` of ``eq:WayPointObsAvoid``, from ``eqVisitWP``.
    terminal : bool
        The penalty ``|m(T) - m_F|^2``.
    effort : bool
        The penalty ``u^T u + v^T v``.
    """

    polyhedron: bool = True
    obstacles: bool = True
    disjunction: bool = True
    robustness: bool = True
    terminal: bool = True
    effort: bool = True


@dataclass(frozen=True, eq=False)
class Visit:
    """A way-point to visit.

    Attributes
    ----------
    region : Polyhedron
    times : ndarray of int
        The grid times of its window.
    """

    region: Polyhedron
    times: Ints


@dataclass(frozen=True, eq=False)
class Block:
    """A convex piece of an obstacle.

    Attributes
    ----------
    piece : Obstacle
    radius : float
        Metres by which it grows.
    times : ndarray of int
        The grid times at which it is avoided, without the start.
    """

    piece: Obstacle
    radius: float
    times: Ints


@dataclass(frozen=True, eq=False)
class PublishedTask:
    """What the paper's equations say of a task, on the grid of a program.

    Attributes
    ----------
    visits : tuple of Visit
        Of the parts ``F[a,b] in(region)``.
    blocks : tuple of Block
        Of the parts ``G[a,b] avoid(obstacle)``.
    """

    visits: tuple[Visit, ...]
    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, problem: Problem) -> PublishedTask:
        """Read a task on the problem's own grid.

        Raises
        ------
        UnsupportedError
            For parts of the task, and motions, that the paper has no equations for.
        """
        visits = []
        for part in problem.specification.parts:
            inside = isinstance(part.written, Always | Eventually) and isinstance(part.written.child, Inside)
            if not inside:
                wanted = "F[a,b] in(region), G[a,b] in(region) and G[a,b] avoid(obstacle)"
                raise UnsupportedError(f"task: the paper has equations for {wanted}, got {part.written}")
            if isinstance(part.written, Eventually) and isinstance(part.written.child, Inside):
                region = problem.regions[part.written.child.name]
                visits.append(Visit(region, _times(problem, part.begin, part.end, first=0)))
        blocks = []
        for avoid in problem.specification.avoid:
            if avoid.motion is not None:
                raise UnsupportedError(f"motions: the paper's obstacles stand still, got {avoid.name} that moves")
            times = _times(problem, avoid.begin, avoid.end, first=1)
            blocks += [Block(piece, avoid.radius, times) for piece in avoid.pieces]
        return cls(tuple(visits), tuple(blocks))


def _times(problem: Problem, begin: float, end: float, first: int) -> Ints:
    """Grid times from the first on that are in a window."""
    grid = problem.times
    inside = (grid >= begin - 1e-9) & (grid <= end + 1e-9)
    return np.flatnonzero(inside & (np.arange(len(grid)) >= first))
