"""The ensemble: shared dynamics, the parameters that differ between its members, and where and how they start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import expect, numbers
from ensemble_ctrl.moments import Law, Samples, tensor_rule
from ensemble_ctrl.problem.arguments import laws_of, mapping_of, quantity_of
from ensemble_ctrl.problem.ensemble import PRIMES, Ensemble, Member
from ensemble_ctrl.systems import ArcSystem

Floats = NDArray[np.float64]
START_COLUMNS = {"start_heading": 2, "start_x": 3, "start_y": 4}
"""Parameters of the start, offsets from the fleet's own, and their places in a drive."""


def frozen(values: Any, shape: tuple[int, ...], what: str) -> Floats:
    """A read-only float copy of `values`, checked for shape and finiteness."""
    array = numbers(what, values, f"{shape} numbers")
    if array.shape != shape:
        raise ProblemError(f"{what}: expected {shape} numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ProblemError(f"{what}: expected finite numbers, got {array.tolist()}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Fleet(Ensemble):
    """Who moves: robots on arcs. Those of other systems are an `OdeFleet`.

    Parameters
    ----------
    system : ArcSystem
        The dynamics all members share.
    parameters : mapping of str to Law
        The law of each parameter that differs between members, independent of each other. Names are those of
        ``system.parameters`` (dimensionless factors), and ``start_x``, ``start_y`` (metres) and ``start_heading``
        (radians), which are offsets from `position` and `heading`. Factors that are not named are 1.
    position : array_like, shape (2,)
        Start position in metres.
    heading : float
        Start heading in radians, counted from +x counter-clockwise whatever the system's own convention.
    input_lower, input_upper : array_like, shape (2,)
        Bounds of the commands (m/s and rad/s for a unicycle, m/s and rad for a bicycle).
    radius : float
        Radius of a robot in metres; obstacles grow by it.
    rate_bounds : array_like, shape (2,), optional
        Largest change of each command per second, between successive steps; infinite if not given.
    cloud : mapping of str to array_like of shape (robots,), optional
        Measured robots whose parameters belong together: for each of some parameters that bend trajectories the values
        of all robots, in one order. Their laws have to be the `Samples` of these values. Means, moments and draws
        follow the cloud; a plan still holds for all combinations in the ranges.

    Raises
    ------
    ProblemError
        For names that the system does not know or that say the same thing twice, and for numbers that are not finite.
    """

    system: ArcSystem
    parameters: Mapping[str, Law]
    position: Floats
    heading: float
    input_lower: Floats
    input_upper: Floats
    radius: float = 0.0
    cloud: Mapping[str, Floats] | None = None
    rate_bounds: Floats | None = None

    def __post_init__(self) -> None:
        expect("fleet.system", self.system, ArcSystem)
        object.__setattr__(self, "parameters", ReadOnlyMapping(laws_of("fleet.parameters", self.parameters)))
        for name, kind in (("heading", "angle"), ("radius", "length")):
            object.__setattr__(self, name, quantity_of(f"fleet.{name}", getattr(self, name), kind))
        for name in ("position", "input_lower", "input_upper"):
            object.__setattr__(self, name, frozen(getattr(self, name), (2,), f"fleet.{name}"))
        if not np.isfinite([self.heading, self.radius]).all() or self.radius < 0:
            raise ProblemError(f"fleet: expected a finite heading and a radius >= 0, got {self.heading}, {self.radius}")
        if (self.input_lower > self.input_upper).any():
            raise ProblemError(f"fleet.input_bounds: low above high: {self.input_lower}, {self.input_upper}")
        if self.rate_bounds is not None:
            rates = numbers("fleet.rate_bounds", self.rate_bounds, "two numbers above 0")
            if rates.shape != (2,) or np.isnan(rates).any() or (rates <= 0).any():
                raise ProblemError(f"fleet.rate_bounds: expected two numbers above 0, got {self.rate_bounds!r}")
            rates.setflags(write=False)
            object.__setattr__(self, "rate_bounds", rates)
        self._check_names()
        if self.cloud is not None:
            object.__setattr__(self, "cloud", ReadOnlyMapping(self._checked_cloud(self.cloud)))

    def _checked_cloud(self, cloud: Mapping[str, ArrayLike]) -> dict[str, Floats]:
        """Columns of one length, whose laws are their samples."""
        given = mapping_of("fleet.cloud", cloud, object, "columns")
        columns = {name: numbers(f"fleet.cloud[{name!r}]", values) for name, values in given.items()}
        lengths = {column.shape for column in columns.values()}
        if len(lengths) != 1 or any(len(shape) != 1 for shape in lengths):
            raise ProblemError(f"fleet.cloud: expected columns of one length, got shapes {sorted(lengths)}")
        bending = [self.names[k] for k in self.bent]
        for name, column in columns.items():
            if name not in bending:
                raise ProblemError(f"fleet.cloud: expected parameters that bend trajectories, got {name!r}")
            if self.parameters[name] != Samples(column):
                raise ProblemError(f"fleet.cloud: expected the law of {name} to be the samples of its column")
            column.setflags(write=False)
        return columns

    def _check_names(self) -> None:
        """Known names, each factor told once."""
        known = [*self.system.parameters, *START_COLUMNS]
        for name in self.parameters:
            if name not in known:
                raise ProblemError(f"fleet.parameters: expected names among {', '.join(known)}, got {name!r}")
        for place in (0, 1):
            twice = [n for n in self.parameters if n in self.system.parameters and self.system.parameters[n][place]]
            if len(twice) > 1:
                raise ProblemError(f"fleet.parameters: expected one of {' and '.join(twice)}, got both")

    @property
    def enclosure(self) -> str:
        """The name of the enclosure that proofs of this fleet use."""
        return self.system.enclosure

    @property
    def identity(self) -> list[object]:
        """The system, and the pose at the start."""
        return [self.system, self.position.tolist(), self.heading]

    @property
    def states(self) -> tuple[str, ...]:
        """The position alone."""
        return ("x", "y")

    @property
    def places(self) -> tuple[str, ...]:
        """The position."""
        return ("x", "y")

    @property
    def state_units(self) -> dict[str, str]:
        """Metres."""
        return dict.fromkeys(self.states, "m")

    def trajectories(self, controls: Floats, members: Floats, step: float) -> Floats:
        """Positions by exact arcs, shape (members, steps + 1, 2), metres."""
        return self.system.positions(controls, self.drives(members), step)

    @property
    def own_heading(self) -> float:
        """Start heading in radians in the system's own convention."""
        return self.heading if self.system.heading_from == "x" else np.pi / 2 - self.heading

    @property
    def start(self) -> Floats:
        """Middle of the start positions, shape (2,), metres."""
        return np.asarray(self.drives(self.center[None])[0, 3:])

    @property
    def start_place(self) -> Floats:
        """Middle of the start positions."""
        return self.start

    @cached_property
    def directions(self) -> Floats:
        """How much each parameter adds to a drive, shape (parameters, 5)."""
        rows = np.zeros((len(self.parameters), 5))
        for row, name in zip(rows, self.names, strict=True):
            if name in START_COLUMNS:
                row[START_COLUMNS[name]] = -1.0 if name == "start_heading" and self.system.heading_from == "y" else 1.0
            else:
                row[:2] = self.system.parameters[name]
        return rows

    @cached_property
    def origin(self) -> Floats:
        """The drive from which `directions` count, shape (5,)."""
        told = self.directions[:, :2].any(axis=0)
        return np.array([*np.where(told, 0.0, 1.0), self.own_heading, *self.position])

    @cached_property
    def bent(self) -> tuple[int, ...]:
        """Columns of the parameters that bend the position curve; the others only shift the start."""
        return tuple(np.flatnonzero(self.directions[:, :3].any(axis=1)).tolist())

    @cached_property
    def shift(self) -> Floats:
        """Half the side lengths of the box of start positions around its middle, shape (2,), metres."""
        half = (self.upper - self.lower) / 2
        return np.asarray(half @ np.abs(self.directions[:, 3:]))

    @cached_property
    def shift_covariance(self) -> Floats:
        """Covariance of the start positions, shape (2, 2), square metres: no control can change it."""
        total = np.zeros((2, 2))
        for direction, law in zip(self.directions, self.parameters.values(), strict=True):
            if not direction[:3].any():
                s, weights = law.rule(2)
                psi = law.to_parameter(s)
                variance = float(weights @ psi**2 / 2 - (weights @ psi / 2) ** 2)
                total += variance * np.outer(direction[3:], direction[3:])
        return total

    @cached_property
    def fastest(self) -> tuple[float, float]:
        """Largest linear and angular factor of any member."""
        corners = self.drives(self.corners)
        return float(np.abs(corners[:, 0]).max()), float(np.abs(corners[:, 1]).max())

    @cached_property
    def slowest(self) -> float:
        """Smallest linear factor of any member."""
        return float(self.drives(self.corners)[:, 0].min())

    def drives(self, members: Floats) -> Floats:
        """The drives of members of shape (members, parameters), shape (members, 5)."""
        return np.asarray(self.origin + members @ self.directions)

    def representatives(self, count: int) -> Floats:
        """Exactly `count` members of equal weight that stand for the laws, shape (count, parameters).

        Even in the law of the first parameter, scattered evenly in those of the others; robots of the cloud stay whole.
        """
        share = (0.5 + np.arange(count)[:, None] * np.sqrt(PRIMES[: len(self.names)])) % 1.0
        share[:, :1] = (0.5 + np.arange(count)[:, None]) / count
        laws = self.parameters.values()
        members = np.column_stack([law.quantile(s) for law, s in zip(laws, share.T, strict=True)]) if laws else share
        if self.cloud is not None:
            first = self.names.index(next(iter(self.cloud)))
            robots = (share[:, first] * len(next(iter(self.cloud.values())))).astype(int)
            for name, column in self.cloud.items():
                members[:, self.names.index(name)] = column[robots]
        return members

    def sample(self, count: int, seed: int) -> Floats:
        """Members drawn from the parameters' laws, shape (count, parameters)."""
        drawn = super().sample(count, seed)
        if self.cloud is not None:
            robots = np.random.default_rng(seed).integers(0, len(next(iter(self.cloud.values()))), count)
            for name, column in self.cloud.items():
                drawn[:, self.names.index(name)] = column[robots]
        return drawn

    def mass(self, lower: Floats, upper: Floats) -> float:
        """Share of the fleet in a closed box of parameters, under the laws and the cloud.

        Parameters
        ----------
        lower, upper : ndarray, shape (parameters,)
            The box.

        Returns
        -------
        float
            0 to 1; measured members are counted.
        """
        cloud, share, together = self.cloud or {}, 1.0, []
        counted = whole = 1
        for k, (name, law) in enumerate(self.parameters.items()):
            values = cloud.get(name, law.measured)
            if values is None:
                below = np.nextafter(lower[k], -np.inf)
                share *= float(law.cdf(upper[k]) - law.cdf(below))
                continue
            inside = (values >= lower[k]) & (values <= upper[k])
            if name in cloud:
                together.append(inside)
            else:
                counted, whole = counted * int(inside.sum()), whole * len(values)
        if together:
            counted, whole = counted * int(np.all(together, axis=0).sum()), whole * len(together[0])
        return max(0.0, share) * (counted / whole)

    def rule(self, count: int) -> tuple[Floats, Floats]:
        """As `Ensemble.rule`; measured robots are their own points, each with the same weight."""
        if self.cloud is None:
            return super().rule(count)
        own = [self.names[k] in self.cloud for k in self.bent]
        others, weights = tensor_rule([law for law, mine in zip(self.bent_laws, own, strict=True) if not mine], count)
        robots = len(next(iter(self.cloud.values())))
        scaled = np.empty((robots, len(others), len(own)))
        scaled[:, :, [not mine for mine in own]] = others
        for column, (k, law) in enumerate(zip(self.bent, self.bent_laws, strict=True)):
            if own[column]:
                scaled[:, :, column] = law.to_scaled(self.cloud[self.names[k]])[:, None]
        return scaled.reshape(-1, len(own)), np.tile(weights / robots, robots)


__all__ = ["START_COLUMNS", "Fleet", "Member", "frozen"]
