"""A fleet of several kinds of robots: a mixture of distributions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import finite_array, finite_number
from ensemble_ctrl.moments.distribution import Distribution
from ensemble_ctrl.moments.lanczos import merged, recurrence_of_points, usable
from ensemble_ctrl.moments.orthonormal import WeightedDistribution
from ensemble_ctrl.moments.recurrence import Recurrence, values

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, init=False, repr=False)
class Mixture(WeightedDistribution):
    """Members that follow one of several distributions, chosen with given weights.

    Parameters
    ----------
    *parts : tuple of (Distribution, float)
        One or more distributions in the same unit, each with a positive weight; weights need not sum to 1.

    Attributes
    ----------
    parts : tuple of (Distribution, float)
        The distributions with their weights as given.

    Raises
    ------
    ProblemError
        If there are no parts, or one is not a distribution with a positive finite weight.

    Notes
    -----
    The union of the distributions' Gauss rules has the same integrals of polynomials as the mixture, so that the
    Lanczos process on it makes no error but rounding.

    Examples
    --------
    >>> from ensemble_ctrl.moments import Interval
    >>> distribution = Mixture((Interval(0.9, 0.95), 2), (Interval(1.05, 1.1), 1))
    >>> distribution.lower, distribution.upper, round(float(distribution.cdf(1.0)), 4)
    (0.9, 1.1, 0.6667)
    """

    parts: tuple[tuple[Distribution, float], ...]
    lower: float
    upper: float

    def __init__(self, *parts: tuple[Distribution, float]) -> None:
        if not parts:
            raise ProblemError("parts: expected one or more pairs of a distribution and a weight, got none")
        object.__setattr__(self, "parts", tuple(_checked(i, part) for i, part in enumerate(parts)))
        object.__setattr__(self, "lower", min(distribution.lower for distribution, _ in self.parts))
        object.__setattr__(self, "upper", max(distribution.upper for distribution, _ in self.parts))

    def __repr__(self) -> str:
        return f"Mixture({', '.join(f'({distribution!r}, {weight:g})' for distribution, weight in self.parts)})"

    @property
    def shares(self) -> FloatArray:
        """The parts' shares of the fleet, shape (parts,), which sum to 1."""
        weights = np.array([weight for _, weight in self.parts])
        weights = weights / weights.max()
        return np.asarray(weights / weights.sum())

    def recurrence(self, order: int) -> Recurrence:
        """Coefficients up to `order`, or up to the highest order that the values determine."""
        # the mixture's measure on the parts' Gauss points: polynomials of degree 2 order + 3 are integrated exactly
        points = self.points(order + 2)
        return usable(recurrence_of_points(*points, order), *points)

    def points(self, count: int) -> tuple[FloatArray, FloatArray]:
        """The points of the parts' rules."""
        rules = [
            self._rule(distribution, share, count)
            for (distribution, _), share in zip(self.parts, self.shares, strict=True)
        ]
        points, weights = (np.concatenate(part) for part in zip(*rules, strict=True))
        return merged(points, weights)

    def partial_moments(self, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        """Integrals of the polynomials up to `s`: those over the parts, in the parts' own polynomials."""
        parts = zip(self.parts, self.shares, strict=True)
        # int_{-1}^s phi_k dmu = sum over the parts of share times int_{-1}^s phi_k dmu_part
        total: FloatArray = sum(
            (share * self._partial(distribution, recurrence, np.asarray(s)) for (distribution, _), share in parts),
            np.zeros(1),
        )
        return total

    def _rule(self, distribution: Distribution, share: float, count: int) -> tuple[FloatArray, FloatArray]:
        """A part's Gauss rule on the scale of the mixture, with the part's share of the weight."""
        s, weights = distribution.rule(count)
        return np.clip(self.to_scaled(distribution.to_parameter(s)), -1.0, 1.0), share * weights

    def _partial(self, distribution: Distribution, recurrence: Recurrence, s: FloatArray) -> FloatArray:
        """Integrals over one part up to `s`, shape ``(*S, order + 1)``."""
        nodes, weights = self._rule(distribution, 1.0, recurrence.order + 1)
        phi = values(recurrence, nodes)
        if not distribution.half_width:
            return np.where(s[..., None] >= nodes[0], 2 * phi[0], 0.0)
        # the mixture's polynomials in those of the part, whose partial moments are known
        own = distribution.basis(min(recurrence.order, distribution.max_order))
        expanded = (weights[:, None] * own.evaluate(distribution.rule(recurrence.order + 1)[0])).T @ phi
        # s of the mixture on the scale of the part
        scaled = (self.center - distribution.center + self.half_width * s) / distribution.half_width
        return np.asarray(own.partial_moments(scaled) @ expanded)

    def cdf(self, psi: ArrayLike) -> FloatArray:
        """Share of the fleet with a parameter of at most `psi`; see `Distribution.cdf`."""
        at = finite_array("psi", psi)
        return np.asarray(
            sum(share * distribution.cdf(at) for (distribution, _), share in zip(self.parts, self.shares, strict=True))
        )

    def _draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """`count` parameters: first which distribution, then its draw."""
        which = rng.choice(len(self.parts), count, p=self.shares)
        drawn = np.empty(count)
        for i, (distribution, _) in enumerate(self.parts):
            chosen = which == i
            drawn[chosen] = distribution.sample(int(chosen.sum()), rng)
        return drawn


def _checked(i: int, part: object) -> tuple[Distribution, float]:
    """One part, a distribution and its weight."""
    if not (isinstance(part, tuple | list) and len(part) == 2 and isinstance(part[0], Distribution)):
        raise ProblemError(f"parts[{i}]: expected a pair of a distribution and a weight, got {part!r}")
    weight = finite_number(f"parts[{i}]: weight", part[1])
    if weight <= 0:
        raise ProblemError(f"parts[{i}]: weight: expected a number above 0, got {weight:g}")
    return part[0], weight
