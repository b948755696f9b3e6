r"""Moments: an ensemble's state as a function of the parameter, in coordinates.

The parameter is scaled to :math:`s \in [-1, 1]`, the basis is orthonormal with respect to its distribution (scaled to a
total mass of 2: :math:`ds` for the uniform one), and the order is the last axis but one of every array of
moments. NumPy only, but for the cdf of Beta and normal distributions, and the draws of normal ones, which load SciPy.

Examples
--------
>>> import numpy as np
>>> basis = LegendreBasis(order=6)
>>> moments = moments_of_function(basis, np.exp)
>>> bool(abs(evaluate_moments(basis, moments, 0.3) - np.exp(0.3)) < 1e-5)
True
"""

from typing import Any

from ensemble_ctrl.core.renamed import warn_renamed
from ensemble_ctrl.moments._check import MAX_ORDER
from ensemble_ctrl.moments.basis import Basis, LegendreBasis
from ensemble_ctrl.moments.bernstein import bernstein_to_moments, moments_to_bernstein, nodes_to_bernstein
from ensemble_ctrl.moments.beta import Beta
from ensemble_ctrl.moments.distribution import Distribution
from ensemble_ctrl.moments.measure import Interval
from ensemble_ctrl.moments.mixture import Mixture
from ensemble_ctrl.moments.normal import TruncatedNormal
from ensemble_ctrl.moments.operators import (
    affine_multiplication_matrix,
    multiplication_matrix,
    shift_left,
    shift_right,
)
from ensemble_ctrl.moments.orthonormal import OrthonormalBasis
from ensemble_ctrl.moments.samples import Samples
from ensemble_ctrl.moments.tensor import TensorBasis, kron, tensor_rule
from ensemble_ctrl.moments.transform import (
    change_of_basis,
    evaluate_moments,
    inner_products,
    moments_of_function,
    moments_of_samples,
    moments_to_nodes,
    nodes_to_moments,
)

DISTRIBUTIONS: dict[str, type[Distribution]] = {"uniform": Interval, "beta": Beta, "normal": TruncatedNormal}
"""Every distribution over a range by the name that a problem file uses."""

__all__ = [
    "DISTRIBUTIONS",
    "MAX_ORDER",
    "Basis",
    "Beta",
    "Distribution",
    "Interval",
    "LegendreBasis",
    "Mixture",
    "OrthonormalBasis",
    "Samples",
    "TensorBasis",
    "TruncatedNormal",
    "affine_multiplication_matrix",
    "bernstein_to_moments",
    "change_of_basis",
    "evaluate_moments",
    "inner_products",
    "kron",
    "moments_of_function",
    "moments_of_samples",
    "moments_to_bernstein",
    "moments_to_nodes",
    "multiplication_matrix",
    "nodes_to_bernstein",
    "nodes_to_moments",
    "shift_left",
    "shift_right",
    "tensor_rule",
]


def __getattr__(name: str) -> Any:
    """The class `Distribution` under its name of version 0.1."""
    if name != "Law":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warn_renamed("ensemble_ctrl.moments.Law", "ensemble_ctrl.moments.Distribution")
    return Distribution
