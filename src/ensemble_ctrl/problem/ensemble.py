"""What every fleet is: parameters that differ between its members, and ways of listing and drawing members."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import numbers
from ensemble_ctrl.moments import Law, tensor_rule

Floats = NDArray[np.float64]
Member = dict[str, float]
"""The parameters of one robot by their names."""

PRIMES = np.array([1, 2, 3, 5, 7, 11, 13])
"""Multiples of their roots scatter over an interval, each in its own way."""


class Ensemble(ReadOnlyArrays, ABC):
    """The parameters of a fleet with their laws; members are rows of numbers in the parameters' order.

    Attributes
    ----------
    parameters : mapping of str to Law
        The law of each parameter, independent of each other.
    input_lower, input_upper : ndarray, shape (n_u,)
        Bounds of the commands.
    radius : float
        Of a robot, metres.
    """

    parameters: Mapping[str, Law]
    input_lower: Floats
    input_upper: Floats
    radius: float
    cloud: Mapping[str, Floats] | None = None
    """Columns of parameters that were measured together, where a fleet has such."""

    def with_laws(self, laws: Mapping[str, Law]) -> Self:
        """The same fleet with other laws of its parameters, for which a cloud does not stand."""
        changes: dict[str, Any] = {"parameters": dict(laws)} | ({} if self.cloud is None else {"cloud": None})
        return replace(self, **changes)  # type: ignore[type-var]

    @property
    @abstractmethod
    def enclosure(self) -> str:
        """The name of the enclosure that proofs of this fleet use (`ensemble_ctrl.certificate.PROOFS`)."""

    @property
    @abstractmethod
    def identity(self) -> list[object]:
        """What tells how members move, and from where, from that of another fleet."""

    @property
    @abstractmethod
    def states(self) -> tuple[str, ...]:
        """Names of the states that a task speaks of, the columns of `trajectories`."""

    @property
    @abstractmethod
    def places(self) -> tuple[str, ...]:
        """Which states are the position."""

    @property
    @abstractmethod
    def start_place(self) -> Floats:
        """Middle of the start positions, shape (d,), metres."""

    @property
    @abstractmethod
    def state_units(self) -> dict[str, str]:
        """Unit of each state, for those that have a known one."""

    def unit_of(self, names: Iterable[str]) -> str:
        """What follows a number that is the smallest of distances in these states; of no states, a distance in space.

        A unit, or words like ``in mixed units (m, m/s)`` and ``in m or the unit of temp``.
        """
        named = set(names) or set(self.places)
        known = sorted({self.state_units[name] for name in named if name in self.state_units})
        others = [f"the unit of {name}" for name in sorted(named) if name not in self.state_units]
        if others:
            return f"in {' or '.join([*known, *others])}"
        known = ["without unit" if unit == "1" else unit for unit in known]
        return known[0] if len(known) == 1 else f"in mixed units ({', '.join(known)})"

    @abstractmethod
    def trajectories(self, controls: Floats, members: Floats, step: float) -> Floats:
        """States of members at the ends of all steps.

        Parameters
        ----------
        controls : ndarray, shape (steps, n_u)
        members : ndarray, shape (members, parameters)
        step : float
            Seconds.

        Returns
        -------
        ndarray, shape (members, steps + 1, states)
        """

    @cached_property
    def place_columns(self) -> slice | list[int]:
        """Where the position stands among the states."""
        columns = [self.states.index(name) for name in self.places]
        first = columns[0]
        return slice(first, first + len(columns)) if columns == list(range(first, first + len(columns))) else columns

    @cached_property
    def bent(self) -> tuple[int, ...]:
        """Columns of the parameters that bend the position curve."""
        return tuple(range(len(self.parameters)))

    def sample(self, count: int, seed: int) -> Floats:
        """Members drawn from the parameters' laws, shape (count, parameters)."""
        drawn = np.empty((count, len(self.parameters)))
        for k, law in enumerate(self.parameters.values()):
            drawn[:, k] = law.sample(count, seed if k == 0 else np.random.default_rng([seed, k]))
        return drawn

    def rule(self, count: int) -> tuple[Floats, Floats]:
        """Points and weights that integrate over the laws of the bent parameters.

        Parameters
        ----------
        count : int
            Polynomials up to degree ``2 count - 1`` in each independent parameter are integrated exactly.

        Returns
        -------
        scaled, weights : ndarray, shapes (points, bent parameters) and (points,)
            Weights sum to 2.
        """
        return tensor_rule(self.bent_laws, count)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the columns of every array of members."""
        return tuple(self.parameters)

    @cached_property
    def lower(self) -> Floats:
        """Lower ends of the parameters' ranges, shape (parameters,)."""
        return np.array([law.lower for law in self.parameters.values()])

    @cached_property
    def upper(self) -> Floats:
        """Upper ends of the parameters' ranges, shape (parameters,)."""
        return np.array([law.upper for law in self.parameters.values()])

    @cached_property
    def center(self) -> Floats:
        """Middles of the parameters' ranges, shape (parameters,)."""
        return np.array([law.center for law in self.parameters.values()])

    @property
    def bent_laws(self) -> tuple[Law, ...]:
        """Laws of the bent parameters."""
        laws = list(self.parameters.values())
        return tuple(laws[k] for k in self.bent)

    @property
    def corners(self) -> Floats:
        """The members at the corners of the box of parameters, shape (2^parameters, parameters)."""
        ends = [(law.lower, law.upper) for law in self.parameters.values()]
        return np.array(list(product(*ends)), dtype=float).reshape(2 ** len(ends), len(ends))

    def bent_members(self, scaled: Floats) -> Floats:
        """Members at scaled points in [-1, 1] of the bent parameters, the start in the middle of its box.

        Parameters
        ----------
        scaled : ndarray, shape (members, bent parameters)

        Returns
        -------
        ndarray, shape (members, parameters)
        """
        members = np.tile(self.center, (len(scaled), 1))
        for column, (k, law) in enumerate(zip(self.bent, self.bent_laws, strict=True)):
            members[:, k] = law.to_parameter(scaled[:, column])
        return members

    def grid(self, count: int) -> Floats:
        """About `count` members spread evenly over the ranges, both ends of each included, shape (.., parameters)."""
        wide = [law.upper > law.lower for law in self.parameters.values()]
        each = max(2, round(count ** (1 / max(sum(wide), 1))))
        axes = [
            np.linspace(law.lower, law.upper, each if w else 1)
            for law, w in zip(self.parameters.values(), wide, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)) if axes else np.zeros((1, 0))

    def spread(self, count: int) -> Floats:
        """Exactly `count` members to draw: even in the first parameter, scattered in the others, shape (count, ..)."""
        share = (0.5 + np.arange(count)[:, None] * np.sqrt(PRIMES[: len(self.names)])) % 1.0
        share[:, :1] = np.linspace(0.0, 1.0, count)[:, None]
        return np.asarray(self.lower + share * (self.upper - self.lower))

    def checked_controls(self, controls: ArrayLike) -> Floats:
        """Commands as an array of shape (steps, n_u).

        Raises
        ------
        ProblemError
            For commands that are empty, of another shape or not finite; a NaN would fail no comparison.
        """
        array, n_u = numbers("controls", controls), len(self.input_lower)
        if array.ndim != 2 or not array.size or array.shape[1] != n_u or not np.isfinite(array).all():
            raise ProblemError(f"controls: expected finite numbers of shape (steps, {n_u}), got shape {array.shape}")
        return array

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
