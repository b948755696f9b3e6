r"""Moments: an ensemble's state as a function of the parameter, in coordinates.

The parameter is scaled to :math:`s \in [-1, 1]`, the basis is orthonormal with respect to :math:`ds`, and the
order is the last axis but one of every array of moments. NumPy only.

Examples
--------
>>> import numpy as np
>>> basis = LegendreBasis(order=6)
>>> moments = moments_of_function(basis, np.exp)
>>> bool(abs(evaluate_moments(basis, moments, 0.3) - np.exp(0.3)) < 1e-5)
True
"""

from ensemble_ctrl.moments.basis import LegendreBasis
from ensemble_ctrl.moments.bernstein import bernstein_to_moments, moments_to_bernstein, nodes_to_bernstein
from ensemble_ctrl.moments.measure import Interval
from ensemble_ctrl.moments.operators import (
    affine_multiplication_matrix,
    multiplication_matrix,
    shift_left,
    shift_right,
)
from ensemble_ctrl.moments.tensor import TensorBasis
from ensemble_ctrl.moments.transform import (
    evaluate_moments,
    moments_of_function,
    moments_of_samples,
    moments_to_nodes,
    nodes_to_moments,
)

__all__ = [
    "Interval",
    "LegendreBasis",
    "TensorBasis",
    "affine_multiplication_matrix",
    "bernstein_to_moments",
    "evaluate_moments",
    "moments_of_function",
    "moments_of_samples",
    "moments_to_bernstein",
    "moments_to_nodes",
    "multiplication_matrix",
    "nodes_to_bernstein",
    "nodes_to_moments",
    "shift_left",
    "shift_right",
]
