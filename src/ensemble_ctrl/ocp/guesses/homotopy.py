"""What a route is called: the obstacles that it passes, in order, and on which side of it each lies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.ocp.guesses.routes import swept

Floats = NDArray[np.float64]


def homotopy(corners: Floats, obstacles: Mapping[str, Sequence[Obstacle]]) -> str:
    """A route's name, such as ``o1 left, o3 right``: o1 lies to its left, and is passed first.

    Parameters
    ----------
    corners : ndarray, shape (corners, 2)
        The route, metres.
    obstacles : mapping of str to sequence of Obstacle
        Convex pieces by name.

    Returns
    -------
    str
        ``between`` for an obstacle in several pieces that lie on both sides; ``straight`` where none is passed.

    Notes
    -----
    An obstacle is passed if the point of the route nearest to it is neither end. Its side is the sign of the angle by
    which the route goes round it, so two routes of one homotopy class lie on the same side of everything.
    """
    passed = []
    for name, pieces in obstacles.items():
        middles = np.array([piece.vertices.mean(axis=0) for piece in pieces]).reshape(-1, 2)
        along = [_nearest(corners, middle) for middle in middles]
        if any(0 < share < 1 for share in along):
            passed.append((float(np.mean(along)), f"{name} {_side(swept(corners, middles)[-1])}"))
    return ", ".join(text for _, text in sorted(passed)) or "straight"


def distinct(names: Iterable[str]) -> list[str]:
    """The names with a number behind those that came before."""
    seen: Counter[str] = Counter()
    told = []
    for name in names:
        seen[name] += 1
        told.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return told


def _side(turns: Floats) -> str:
    """The side from the angles swept round the middles of the pieces."""
    side = "left" if (turns > 0).all() else "right" if (turns < 0).all() else "between"
    return f"{side} and round" if (np.abs(turns) >= 2 * np.pi).any() else side


def _nearest(corners: Floats, point: Floats) -> float:
    """Where on a polyline the point nearest to `point` is, as a share of its length."""
    along = np.diff(corners, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    # projection on each segment, clipped to it; the nearest one's place along the whole polyline
    share = np.clip(((point - corners[:-1]) * along).sum(axis=1) / np.maximum(lengths**2, 1e-12), 0.0, 1.0)
    gaps = np.linalg.norm(corners[:-1] + share[:, None] * along - point, axis=1)
    k = int(gaps.argmin())
    return float((lengths[:k].sum() + share[k] * lengths[k]) / max(float(lengths.sum()), 1e-12))
