r"""The rows and terms of the paper's problems, each on the moments of every order.

With :math:`m_k^\pm` the signed moments of the basis, :math:`\xi = b_i + M` and K the sharpness of log-sum-exp,

.. math::

    -M m_k^+ - \xi m_k^- \le a_i m_k + M (m_k^+ - m_k^-)\, z_i \le \xi m_k^+ + M m_k^-, \qquad \sum_i z_i \ge 1,

    \rho(m) = -\frac1K \log \sum_{j,k,\pm} e^{-K r_{jk\pm}}, \qquad
    r_{jk\pm} \le \frac1K \log \sum_{t \in [a, b]} e^{K \mu_{jk\pm}(t)},

where :math:`\mu_{jk-} = a_j m_k - (b_j m_k^+ - c_j m_k^-)` and
:math:`\mu_{jk+} = (c_j m_k^+ - b_j m_k^-) - a_j m_k` are how far the two bounds of ``eq:polyhedron_moment`` are kept
for face j of a way-point and order k.

*Guarantee*: **necessary, not sufficient** for the members.  The smooth maximum over time is above the exact one by up
to ``log(times) / K``, as in the paper.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.layout import Numbers
from ensemble_ctrl.ocp.moment_form import Read
from ensemble_ctrl.ocp.program import Block, Build
from ensemble_ctrl.ocp.published import equations
from ensemble_ctrl.ocp.published.equations import Visit
from ensemble_ctrl.ocp.task import SHARPNESS
from ensemble_ctrl.ocp.truncation import Truncation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Facets:
    """One convex piece with its binaries.

    Attributes
    ----------
    normals : ndarray, shape (facets, 2)
        Rows a of the free sides ``a x <= b``, of unit length.
    levels : ndarray, shape (facets,)
        b, metres, with the robot's radius.
    times : ndarray of int, shape (times,)
        At which it is avoided.
    binaries : ndarray of int, shape (times, facets)
        Indices of z in the decision vector.
    """

    normals: Floats
    levels: Floats
    times: Ints
    binaries: Ints

    @classmethod
    def of(cls, block: equations.Block, layout: Numbers) -> Facets:
        """Hand out a binary for each facet and time."""
        normals, levels = block.piece.unit_rows()
        shape = (len(block.times), len(levels))
        return cls(-normals, -levels - block.radius, block.times, layout.binary(shape[0] * shape[1]).reshape(shape))

    def best(self, mean: Floats) -> Floats:
        """1 for the facet that a path of shape (steps + 1, 2) is furthest behind, at each time, else 0."""
        gaps = self.levels - mean[self.times] @ self.normals.T
        return np.asarray(np.eye(len(self.levels))[gaps.argmax(axis=1)])


def obstacle_rows(facets: Facets, truncation: Truncation, read: Read, big: float) -> Block:
    """``eq:setPolyObsArr`` in moments: every facet, order and time of one piece."""
    positive, negative = truncation.basis.signed_moments()
    n, image = read.count, ca.sparsify(ca.DM(read.to_moments))
    switch = ca.DM(big * (positive - negative))

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # a m_k + M (m_k^+ - m_k^-) z
        along: ca.SX = ca.mtimes(image, d[0] * z[:n] + d[1] * z[n : 2 * n])
        return along + switch * z[2 * n]

    # an instance for each time and facet
    count = len(facets.levels)
    places = read.at[facets.times.repeat(count)]
    xi = np.tile(facets.levels + big, len(facets.times))
    # -M m^+ - xi m^- <= .. <= xi m^+ + M m^-
    lower = -big * positive - np.outer(xi, negative)
    upper = np.outer(xi, positive) + big * negative
    data = np.tile(facets.normals, (len(facets.times), 1))
    columns = np.column_stack([places, facets.binaries.ravel()])
    return Block("avoiding (eq:setPolyObsArr)", build, columns, data, lower, upper)


def disjunction_rows(facets: Facets) -> Block:
    """``sum z >= 1`` at every time."""
    times, count = facets.binaries.shape
    low = np.ones((times, 1))
    return Block("choosing", lambda z, d: ca.sum1(z), facets.binaries, np.zeros((times, 0)), low, low * count)


@dataclass(frozen=True, eq=False)
class Levels:
    """The levels r of one visit: a smooth maximum over its window for each face, order and side.

    Attributes
    ----------
    index : ndarray of int, shape (levels,)
        Places in the decision vector.
    order : ndarray of int, shape (levels,)
    normal : ndarray, shape (levels, 2)
        ``normal . m_k + offset`` is how far a bound is kept.
    offset : ndarray, shape (levels,)
    times : ndarray of int
    """

    index: Ints
    order: Ints
    normal: Floats
    offset: Floats
    times: Ints

    @classmethod
    def of(cls, visit: Visit, truncation: Truncation, layout: Numbers) -> Levels:
        """Both sides of ``eq:polyhedron_moment`` for every face and order."""
        region = visit.region.two_sided()
        lower, upper = region.moment_bounds(truncation.basis)
        # a m_k - lower_k and upper_k - a m_k, where there is a bound
        offsets = np.concatenate([-lower.ravel(), upper.ravel()])
        order = np.tile(np.arange(len(lower)).repeat(len(region.A)), 2)
        normal = np.concatenate([np.tile(region.A, (len(lower), 1)), np.tile(-region.A, (len(lower), 1))])
        ok = np.isfinite(offsets)
        return cls(layout.more(int(ok.sum())), order[ok], normal[ok], offsets[ok], visit.times)

    def start(self, moments: Floats) -> Floats:
        """The largest levels for moments of shape (steps + 1, orders, 2)."""
        at = moments[self.times][:, self.order]
        kept = SHARPNESS * (np.einsum("tld,ld->tl", at, self.normal) + self.offset)
        # log-sum-exp over the times, shifted by the largest
        top = kept.max(axis=0)
        return np.asarray(top + np.log(np.exp(kept - top).sum(axis=0))) / SHARPNESS

    def blocks(self, read: Read) -> list[Block]:
        """``r <= log(sum_t exp(K mu(t))) / K``, a block for each order."""
        return [self._block(k, read) for k in np.unique(self.order).tolist()]

    def _block(self, k: int, read: Read) -> Block:
        """The rows of one order, over the variables that its moment is made of."""
        own, used = self.order == k, np.flatnonzero(read.to_moments[k])
        weights, size, times = read.to_moments[k][used].tolist(), len(used), len(self.times)
        each = np.concatenate([used, read.count + used])
        # variables time by time, then the level
        places = read.at[self.times][:, each].ravel()
        columns = np.column_stack([np.tile(places, (int(own.sum()), 1)), self.index[own]])
        data = np.column_stack([self.normal[own], self.offset[own]])
        low = np.zeros((len(data), 1))
        return Block("visiting (eqVisitWP)", _visiting(weights, size, times), columns, data, low, low + np.inf)


def _visiting(weights: list[float], size: int, times: int) -> Build:
    """One row: the smooth maximum over time less the level."""

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        kept = []
        for t in range(times):
            at = z[2 * size * t : 2 * size * (t + 1)]
            x, y = (sum(w * part[i] for i, w in enumerate(weights)) for part in (at[:size], at[size:]))
            kept.append(d[0] * x + d[1] * y + d[2])
        # log(sum_t exp(K mu)) / K - r
        largest: ca.SX = ca.logsumexp(SHARPNESS * ca.vertcat(*kept)) / SHARPNESS
        return largest - z[2 * size * times]

    return build


def robustness_term(levels: list[Levels], weight: float) -> Block:
    """``-w rho``, with the smooth minimum over all levels."""
    index = np.concatenate([one.index for one in levels])

    def build(z: ca.SX, d: ca.SX) -> ca.SX:
        # rho = -log(sum exp(-K r)) / K
        least: ca.SX = -ca.logsumexp(-SHARPNESS * z) / SHARPNESS
        return -weight * least

    none = np.zeros((1, 0))
    return Block("robustness (eq:WayPointObsAvoid)", build, index[None], none, none, none)
