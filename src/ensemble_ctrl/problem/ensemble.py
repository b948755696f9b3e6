"""An ensemble: parameters with their distributions, and ways of listing, drawing and weighing members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import numbers
from ensemble_ctrl.moments import Distribution, Samples, tensor_rule
from ensemble_ctrl.problem.arguments import mapping_of

Floats = NDArray[np.float64]
Member = dict[str, float]
"""The parameters of one robot by their names."""

PRIMES = np.array([1, 2, 3, 5, 7, 11, 13])
"""Multiples of their roots scatter over an interval, each in its own way."""


class Ensemble(ReadOnlyArrays):
    """The parameters of a fleet with their distributions; members are rows of numbers in the parameters' order.

    Attributes
    ----------
    parameters : mapping of str to Distribution
        The distribution of each parameter, independent of each other.
    samples : mapping of str to ndarray of shape (robots,), or None
        Columns of parameters that were measured together, where there are such.
    """

    parameters: Mapping[str, Distribution]
    samples: Mapping[str, Floats] | None = None

    def with_distributions(self, distributions: Mapping[str, Distribution]) -> Self:
        """The same fleet with other distributions of its parameters, for which joint samples do not hold."""
        changes: dict[str, Any] = {"parameters": dict(distributions)} | (
            {} if self.samples is None else {"samples": None}
        )
        return replace(self, **changes)  # type: ignore[type-var]

    def checked_samples(self, samples: Mapping[str, ArrayLike]) -> dict[str, Floats]:
        """Columns of one length, whose distributions are their samples."""
        given = mapping_of("fleet.samples", samples, object, "columns")
        columns = {name: numbers(f"fleet.samples[{name!r}]", values) for name, values in given.items()}
        lengths = {column.shape for column in columns.values()}
        if len(lengths) != 1 or any(len(shape) != 1 for shape in lengths):
            raise ProblemError(f"fleet.samples: expected columns of one length, got shapes {sorted(lengths)}")
        bending = [self.names[k] for k in self.dynamic]
        for name, column in columns.items():
            if name not in bending:
                known = ", ".join(bending) or "fleet.parameters has none"
                raise ProblemError(f"fleet.samples: expected parameters that bend trajectories ({known}), got {name!r}")
            if self.parameters[name] != Samples(column):
                raise ProblemError(f"fleet.samples: expected the distribution of {name} to be its samples")
            column.setflags(write=False)
        return columns

    @cached_property
    def dynamic(self) -> tuple[int, ...]:
        """Columns of the parameters that bend the position curve."""
        return tuple(range(len(self.parameters)))

    def sample(self, count: int, seed: int | tuple[int, int]) -> Floats:
        """Members drawn from the parameters' distributions, shape (count, parameters).

        `seed` is a number, or that and the index of a block: each block is a stream of its own.
        """
        drawn = np.empty((count, len(self.parameters)))
        first, own = (np.random.default_rng(seed), [*seed]) if isinstance(seed, tuple) else (seed, [seed])
        for k, distribution in enumerate(self.parameters.values()):
            # an independent stream of random numbers for each parameter
            drawn[:, k] = distribution.sample(count, first if k == 0 else np.random.default_rng([*own, k]))
        if self.samples is not None:
            # joint samples: whole rows, drawn with replacement
            robots = np.random.default_rng(seed).integers(0, len(next(iter(self.samples.values()))), count)
            for name, column in self.samples.items():
                drawn[:, self.names.index(name)] = column[robots]
        return drawn

    def rule(self, count: int) -> tuple[Floats, Floats]:
        """Points and weights that integrate over the distributions of the dynamic parameters.

        Parameters
        ----------
        count : int
            Polynomials up to degree ``2 count - 1`` in each independent parameter are integrated exactly.

        Returns
        -------
        scaled, weights : ndarray, shapes (points, dynamic parameters) and (points,)
            Weights sum to 2; measured robots are their own points, each with the same weight.
        """
        if self.samples is None:
            return tensor_rule(self.dynamic_distributions, count)
        own = [self.names[k] in self.samples for k in self.dynamic]
        # every row of the joint samples with the product rule of the other parameters
        others, weights = tensor_rule(
            [distribution for distribution, mine in zip(self.dynamic_distributions, own, strict=True) if not mine],
            count,
        )
        robots = len(next(iter(self.samples.values())))
        scaled = np.empty((robots, len(others), len(own)))
        scaled[:, :, [not mine for mine in own]] = others
        for column, (k, distribution) in enumerate(zip(self.dynamic, self.dynamic_distributions, strict=True)):
            if own[column]:
                scaled[:, :, column] = distribution.to_scaled(self.samples[self.names[k]])[:, None]
        return scaled.reshape(-1, len(own)), np.tile(weights / robots, robots)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the columns of every array of members."""
        return tuple(self.parameters)

    @cached_property
    def lower(self) -> Floats:
        """Lower ends of the parameters' ranges, shape (parameters,)."""
        return np.array([distribution.lower for distribution in self.parameters.values()])

    @cached_property
    def upper(self) -> Floats:
        """Upper ends of the parameters' ranges, shape (parameters,)."""
        return np.array([distribution.upper for distribution in self.parameters.values()])

    @cached_property
    def center(self) -> Floats:
        """Middles of the parameters' ranges, shape (parameters,)."""
        return np.array([distribution.center for distribution in self.parameters.values()])

    @property
    def dynamic_distributions(self) -> tuple[Distribution, ...]:
        """Distributions of the dynamic parameters."""
        distributions = list(self.parameters.values())
        return tuple(distributions[k] for k in self.dynamic)

    @property
    def corners(self) -> Floats:
        """The members at the corners of the box of parameters, shape (2^parameters, parameters)."""
        ends = [(distribution.lower, distribution.upper) for distribution in self.parameters.values()]
        return np.array(list(product(*ends)), dtype=float).reshape(2 ** len(ends), len(ends))

    def dynamic_members(self, scaled: Floats) -> Floats:
        """Members at scaled points in [-1, 1] of the dynamic parameters, the start in the middle of its box.

        Parameters
        ----------
        scaled : ndarray, shape (members, dynamic parameters)

        Returns
        -------
        ndarray, shape (members, parameters)
        """
        # psi_k = c_k + h_k s_k for the dynamic parameters, centres for the others
        members = np.tile(self.center, (len(scaled), 1))
        for column, (k, distribution) in enumerate(zip(self.dynamic, self.dynamic_distributions, strict=True)):
            members[:, k] = distribution.to_parameter(scaled[:, column])
        return members

    def grid(self, count: int) -> Floats:
        """About `count` members spread evenly over the ranges, both ends of each included, shape (.., parameters)."""
        wide = [distribution.upper > distribution.lower for distribution in self.parameters.values()]
        # count^(1 / n) values in each of the n ranges that have a width
        each = max(2, round(count ** (1 / max(sum(wide), 1))))
        axes = [
            np.linspace(distribution.lower, distribution.upper, each if w else 1)
            for distribution, w in zip(self.parameters.values(), wide, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) if axes else np.zeros((1, 0))

    def spread(self, count: int) -> Floats:
        """Exactly `count` members to draw: even in the first parameter, scattered in the others, shape (count, ..)."""
        # Kronecker sequence: fractional parts of 1/2 + k sqrt(q) for different q, and even steps in the first parameter
        share = (0.5 + np.arange(count)[:, None] * np.sqrt(PRIMES[: len(self.names)])) % 1.0
        share[:, :1] = np.linspace(0.0, 1.0, count)[:, None]
        return np.asarray(self.lower + share * (self.upper - self.lower))

    def representatives(self, count: int) -> Floats:
        """Exactly `count` members of equal weight that represent the distributions, shape (count, parameters).

        Even in the distribution of the first parameter, scattered evenly in the others; joint samples stay whole.
        """
        # quantiles at the points of a Kronecker sequence, in the first parameter at midpoints
        share = (0.5 + np.arange(count)[:, None] * np.sqrt(PRIMES[: len(self.names)])) % 1.0
        share[:, :1] = (0.5 + np.arange(count)[:, None]) / count
        distributions = self.parameters.values()
        members = (
            np.column_stack([distribution.quantile(s) for distribution, s in zip(distributions, share.T, strict=True)])
            if distributions
            else share
        )
        if self.samples is not None:
            first = self.names.index(next(iter(self.samples)))
            robots = (share[:, first] * len(next(iter(self.samples.values())))).astype(int)
            for name, column in self.samples.items():
                members[:, self.names.index(name)] = column[robots]
        return members

    def mass(self, lower: Floats, upper: Floats) -> float:
        """Share of the fleet in a closed box of parameters, under the distributions and the joint samples.

        Parameters
        ----------
        lower, upper : ndarray, shape (parameters,)
            The box.

        Returns
        -------
        float
            0 to 1; measured members are counted.
        """
        # continuous distributions: product of cdf differences; measured values: counted, joint ones row by row
        samples, share, together = self.samples or {}, 1.0, []
        counted = whole = 1
        for k, (name, distribution) in enumerate(self.parameters.items()):
            values = samples.get(name, distribution.measured)
            if values is None:
                below = np.nextafter(lower[k], -np.inf)
                share *= float(distribution.cdf(upper[k]) - distribution.cdf(below))
                continue
            inside = (values >= lower[k]) & (values <= upper[k])
            if name in samples:
                together.append(inside)
            else:
                counted, whole = counted * int(inside.sum()), whole * len(values)
        if together:
            counted, whole = counted * int(np.all(together, axis=0).sum()), whole * len(together[0])
        return max(0.0, share) * (counted / whole)

    def members(self, parameters: ArrayLike | Sequence[Mapping[str, float]]) -> Floats:
        """Members from numbers or names.

        Parameters
        ----------
        parameters : array_like or sequence of mappings
            Shape (members,) for a fleet with one parameter, (members, parameters) for any, or a mapping with every
            parameter's name for each member.

        Returns
        -------
        ndarray, shape (members, parameters)

        Raises
        ------
        ProblemError
            If they are none of these, are empty, or are not finite; a NaN would fail no comparison.
        """
        wanted = f"finite numbers of shape (members, {len(self.names)}) or names {', '.join(self.names)}"
        try:
            if not isinstance(parameters, np.ndarray):
                rows: list[Any] = list(parameters)  # type: ignore[arg-type]
                parameters = [[one[n] for n in self.names] if isinstance(one, Mapping) else one for one in rows]
            array = np.array(parameters, dtype=float)
        except (TypeError, ValueError, KeyError):
            raise ProblemError(f"parameters: expected {wanted}, got {parameters!r}") from None
        if array.ndim == 1 and len(self.names) == 1:
            array = array[:, None]
        if array.ndim != 2 or not len(array) or array.shape[1] != len(self.names) or not np.isfinite(array).all():
            raise ProblemError(f"parameters: expected {wanted}, got shape {array.shape}")
        return array

    def named(self, member: Floats) -> Member:
        """The parameters of one member by name."""
        return dict(zip(self.names, np.asarray(member, dtype=float).tolist(), strict=True))
