"""Products of bases: orthonormal functions of several independent parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments._check import finite_array
from ensemble_ctrl.moments.basis import Basis
from ensemble_ctrl.moments.bernstein import bernstein_to_moments, nodes_to_bernstein
from ensemble_ctrl.moments.distribution import Distribution
from ensemble_ctrl.moments.transform import nodes_to_moments

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TensorBasis:
    r"""Products ``phi_k1(s_1) phi_k2(s_2) ...`` of one-dimensional orthonormal polynomials.

    Their measure has total mass 2 however many parameters there are, so that the mean is ``m_0 / sqrt(2)`` as it is for
    one parameter; with one factor this is that factor, and with none it is the constant function.

    Parameters
    ----------
    factors : tuple of Basis
        One basis for each parameter. Functions, nodes and moments are numbered with the last parameter fastest.

    Examples
    --------
    >>> from ensemble_ctrl.moments import LegendreBasis
    >>> basis = TensorBasis((LegendreBasis(1), LegendreBasis(2)))
    >>> basis.count, basis.indices[:4]
    (6, ((0, 0), (0, 1), (0, 2), (1, 0)))
    """

    factors: tuple[Basis, ...]

    @property
    def count(self) -> int:
        """How many functions, and how many Gauss nodes."""
        return int(np.prod([f.order + 1 for f in self.factors], dtype=int))

    @property
    def indices(self) -> tuple[tuple[int, ...], ...]:
        """The degrees ``(k1, k2, ...)`` of every function."""
        return tuple(product(*(range(f.order + 1) for f in self.factors)))

    @property
    def nodes(self) -> FloatArray:
        """Gauss nodes, shape (count, parameters), scaled."""
        return np.array(list(product(*(f.nodes for f in self.factors))), dtype=float).reshape(self.count, -1)

    @property
    def weights(self) -> FloatArray:
        """Gauss weights, shape (count,); their sum is 2."""
        # weights multiply as shares of the fleet, w / 2
        return np.asarray(2 * kron([f.weights[None, :] / 2 for f in self.factors])[0])

    def evaluate(self, s: ArrayLike) -> FloatArray:
        """Values of the functions.

        Parameters
        ----------
        s : array_like, shape (points, parameters)
            Scaled parameters.

        Returns
        -------
        ndarray, shape (points, count)

        Raises
        ------
        ProblemError
            For numbers that are not finite, or another number of columns.
        """
        s = finite_array("s", s)
        if s.ndim != 2 or s.shape[1] != len(self.factors):
            raise ProblemError(f"s: expected shape (points, {len(self.factors)}), got {s.shape}")
        # phi_index = sqrt(1/2) prod_k sqrt(2) phi_{i_k}(s_k): total mass 2
        values = np.full((len(s), 1), np.sqrt(0.5))
        for column, factor in zip(s.T, self.factors, strict=True):
            one = np.sqrt(2.0) * factor.evaluate(column)
            values = (values[:, :, None] * one[:, None, :]).reshape(len(s), -1)
        return values

    def signed_moments(self) -> tuple[FloatArray, FloatArray]:
        """Integrals of the functions' positive and negative parts, two arrays of shape (count,)."""
        # (uv)+ = u+ v+ + u- v- and (uv)- = u+ v- + u- v+, factor by factor
        pairs = [tuple(m / np.sqrt(2.0) for m in f.signed_moments()) for f in self.factors]
        positive, negative = np.ones(1), np.zeros(1)
        for plus, minus in pairs:
            positive, negative = (
                np.kron(positive, plus) + np.kron(negative, minus),
                np.kron(positive, minus) + np.kron(negative, plus),
            )
        return np.sqrt(2.0) * positive, np.sqrt(2.0) * negative

    def nodes_to_moments(self) -> FloatArray:
        """Matrix from values at the nodes to moments, shape (count, count)."""
        return self._scaled(nodes_to_moments)

    def nodes_to_bernstein(self, degrees: Sequence[int]) -> FloatArray:
        """Matrix from values at the nodes to Bernstein coefficients, shape (prod(degrees + 1), count).

        Notes
        -----
        *Guarantee*: the values on the whole box are in the convex hull of the coefficients, if the degrees are the
        orders; with lower degrees so is the projection onto the moments up to them.
        """
        # coefficients of a product: Kronecker product of the factors' matrices
        pairs = zip(self.factors, degrees, strict=True)
        return kron([nodes_to_bernstein(f, degree=degree) for f, degree in pairs])

    def bernstein_to_moments(self) -> FloatArray:
        """Matrix from Bernstein coefficients of the factors' orders to moments, shape (count, count)."""
        return self._scaled(bernstein_to_moments)

    def _scaled(self, matrix: Callable[[Basis], FloatArray]) -> FloatArray:
        """The product of a matrix of every factor, for a measure of mass 2."""
        # sqrt(1/2) of each factor's matrix: measures of mass 1, whose product has mass 1
        return np.asarray(np.sqrt(2.0) * kron([matrix(f) / np.sqrt(2.0) for f in self.factors]))


def kron(matrices: Sequence[FloatArray]) -> FloatArray:
    """The Kronecker product of any number of matrices, the last one's entries fastest."""
    return reduce(lambda a, b: np.asarray(np.kron(a, b)), matrices, np.ones((1, 1)))


def tensor_rule(distributions: Sequence[Distribution], count: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights that integrate over the product of distributions.

    Parameters
    ----------
    distributions : sequence of Distribution
        One for each parameter.
    count : int
        Polynomials up to degree ``2 count - 1`` in each parameter are integrated exactly, up to rounding.

    Returns
    -------
    s, weights : ndarray, shapes (points, parameters) and (points,)
        Scaled points, and weights, which sum to 2.
    """
    # product rule: weights multiply as shares of the fleet, and sum to 2
    rules = [distribution.rule(count) for distribution in distributions]
    points = list(product(*(s for s, _ in rules)))
    weights = 2 * kron([w[None, :] / 2 for _, w in rules])[0]
    return np.array(points, dtype=float).reshape(len(points), len(distributions)), np.asarray(weights)
