"""Where a fleet should end: at one place, each member at its own, or spread in a given way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.stl import Always, And, Formula, Predicate, Within
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import expect

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Formation(ReadOnlyArrays):
    """A place for every member, piecewise linear in one of the fleet's parameters.

    Parameters
    ----------
    parameter : str
        Its name.
    values : array_like, shape (entries,)
        Values of the parameter, increasing, at least two.
    places : array_like, shape (entries, d)
        Where members with these values should end, metres.

    Raises
    ------
    ProblemError
        For other shapes, values that do not increase, or numbers that are not finite.
    """

    parameter: str
    values: Floats
    places: Floats

    def __post_init__(self) -> None:
        expect("target.parameter", self.parameter, str, "the name of a parameter")
        values, places = _numbers("values", self.values), _numbers("places", self.places)
        if values.ndim != 1 or len(values) < 2 or not _placed(places, len(values)):
            shapes = f"{values.shape} and {places.shape}"
            raise ProblemError(f"target: expected two or more values, each with a place, got shapes {shapes}")
        if not (np.diff(values) > 0).all():
            raise ProblemError(f"target: expected increasing values of {self.parameter}, got {values.tolist()}")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "places", places)

    def at(self, value: ArrayLike) -> Floats:
        """Places of members with these values of the parameter, shape (..., d), metres."""
        given = np.asarray(value, dtype=float)
        return np.stack([np.interp(given, self.values, column) for column in self.places.T], axis=-1)

    @property
    def middle(self) -> Floats:
        """The place of the middle value, shape (d,), metres."""
        return self.at((self.values[0] + self.values[-1]) / 2)


@dataclass(frozen=True, eq=False)
class MomentTarget(ReadOnlyArrays):
    """The fleet's moments of position, lowest first; those that are not listed are free.

    Parameters
    ----------
    moments : array_like, shape (count, d)
        Metres, against the orthonormal polynomials of the parameter's distribution: the mean is the first, divided by
        sqrt(2).
    weights : array_like, shape (count,), optional
        Of each moment's squared error; all 1 if not given.

    Raises
    ------
    ProblemError
        For other shapes, negative weights, or numbers that are not finite.
    """

    moments: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        moments = _numbers("moments", self.moments)
        if not len(np.atleast_1d(moments)) or not _placed(moments, len(np.atleast_1d(moments))):
            raise ProblemError(f"target: expected moments of shape (count, d), got shape {moments.shape}")
        weights = np.ones(len(moments)) if self.weights is None else _numbers("weights", self.weights)
        if weights.shape != (len(moments),) or (weights < 0).any():
            raise ProblemError(
                f"target: expected a weight >= 0 for each of {len(moments)} moments, got {weights.tolist()}"
            )
        object.__setattr__(self, "moments", moments)
        object.__setattr__(self, "weights", weights)

    @property
    def middle(self) -> Floats:
        """The mean position, shape (d,), metres."""
        # mean = m_0 / sqrt(2)
        return np.asarray(self.moments[0] / np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class SpreadTarget(ReadOnlyArrays):
    """The fleet's mean position and its covariance.

    Parameters
    ----------
    mean : array_like, shape (d,)
        Metres.
    covariance : array_like, shape (d, d)
        Square metres, symmetric, without negative eigenvalues.

    Raises
    ------
    ProblemError
        For other shapes, a matrix that is no covariance, or numbers that are not finite.
    """

    mean: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        mean, covariance = _numbers("mean", self.mean), _numbers("covariance", self.covariance)
        if not _placed(mean[None], 1) or covariance.shape != 2 * mean.shape:
            shapes = f"{mean.shape} and {covariance.shape}"
            raise ProblemError(f"target: expected a mean and a square covariance of its size, got shapes {shapes}")
        least = float(np.linalg.eigvalsh((covariance + covariance.T) / 2)[0])
        if not np.allclose(covariance, covariance.T) or least < -1e-12:
            raise ProblemError(
                "target: expected a symmetric covariance without negative eigenvalues, got "
                f"{covariance.tolist()} (smallest eigenvalue {least:.3g})"
            )
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    @property
    def middle(self) -> Floats:
        """The mean position, shape (d,), metres."""
        return self.mean


@dataclass(frozen=True, eq=False)
class Pose(ReadOnlyArrays):
    """A place and a heading in which every member has to end, each to a tolerance.

    Parameters
    ----------
    position : array_like, shape (d,)
        Metres.
    heading : float
        Radians from +x, counter-clockwise.
    within : float
        Largest error of each coordinate of the position, metres, above 0.
    turn : float
        Largest error of the heading, radians, above 0 and below pi; whole turns aside.

    Raises
    ------
    ProblemError
        For other shapes, tolerances that are not above 0, or numbers that are not finite.

    Examples
    --------
    >>> str(Pose([1.0, 2.0], np.pi / 2, 0.05, np.radians(5)).reached())
    'G[T,T] (-x >= -1.05 and x >= 0.95 and -y >= -2.05 and y >= 1.95 and heading within 5 deg of 90 deg)'
    """

    position: Floats
    heading: float
    within: float
    turn: float

    def __post_init__(self) -> None:
        position = _numbers("position", self.position)
        if not _placed(np.atleast_2d(position), 1):
            raise ProblemError(f"target: expected a position of one to three numbers, got shape {position.shape}")
        object.__setattr__(self, "position", position)
        for name in ("heading", "within", "turn"):
            value = _numbers(name, getattr(self, name))
            if value.size != 1:
                raise ProblemError(f"target: {name}: expected a number, got shape {value.shape}")
            object.__setattr__(self, name, float(value.item()))
        if not self.within > 0:
            raise ProblemError(f"target: expected a tolerance of the position above 0 m, got {self.within:g}")
        if not 0 < self.turn < np.pi:
            wanted = "a tolerance of the heading above 0 deg and below 180 deg"
            raise ProblemError(f"target: expected {wanted}, got {np.degrees(self.turn):g} deg")

    def reached(self, places: Sequence[str] = ("x", "y"), heading: str = "heading") -> Formula:
        """That a member is there at the end of the plan, a part of a task, by the names of its states."""
        parts: list[Formula] = []
        for name, value in zip(places, self.position.tolist(), strict=True):
            parts.append(Predicate(((name, -1.0),), value + self.within))
            parts.append(Predicate(((name, 1.0),), self.within - value))
        parts.append(Within(heading, self.turn, math.remainder(self.heading, 2 * math.pi)))
        return Always(And(tuple(parts)), math.inf, math.inf)


Target = Formation | MomentTarget | SpreadTarget


def wasserstein(mean: Floats, covariance: Floats, target: SpreadTarget) -> float:
    """Squared Wasserstein distance (m^2) of the normal distribution of a mean and a covariance to a target."""
    # W^2 = |m - m_F|^2 + tr C + tr F - 2 tr (C F)^(1/2) (Dowson and Landau 1982)
    C, F = covariance, target.covariance
    # tr (C F)^(1/2) = tr (R C R)^(1/2) with R = F^(1/2), from eigenvalues
    values, vectors = np.linalg.eigh(F)
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    inner = np.sqrt(np.maximum(np.linalg.eigvalsh(root @ C @ root), 0.0)).sum()
    return float(((mean - target.mean) ** 2).sum() + np.trace(C) + np.trace(F) - 2 * inner)


def _placed(rows: Floats, count: int) -> bool:
    """Whether an array has this many rows of one to three coordinates."""
    return rows.ndim == 2 and len(rows) == count and 1 <= rows.shape[1] <= 3


def _numbers(name: str, values: ArrayLike) -> Floats:
    """A read-only float copy of finite numbers."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ProblemError(f"target: expected numbers for {name}, got {values!r}") from None
    if not np.isfinite(array).all():
        raise ProblemError(f"target: expected finite numbers for {name}, got {array.tolist()}")
    array.setflags(write=False)
    return array
