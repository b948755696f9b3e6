"""The fleet: a system that all members share, the parameters that differ between them, and where they start."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.renamed import renamed_fields
from ensemble_ctrl.core.values import expect, known_only, numbers
from ensemble_ctrl.moments import Distribution
from ensemble_ctrl.problem.arc_members import START_COLUMNS, ArcMembers
from ensemble_ctrl.problem.arguments import distributions_of
from ensemble_ctrl.problem.arguments.fleets import per_control, radius_of, rates_of, rest_of_start, start_of
from ensemble_ctrl.problem.arguments.members import check_members
from ensemble_ctrl.problem.ensemble import Member
from ensemble_ctrl.problem.integrated import accurate, integrated
from ensemble_ctrl.problem.starts import Offsets, starts_of
from ensemble_ctrl.problem.uncertainty import NONE, Uncertainty
from ensemble_ctrl.problem.units import unit_of
from ensemble_ctrl.systems import System
from ensemble_ctrl.systems.integration import Rule, extrapolated

Floats = NDArray[np.float64]

NO_STARTS: Offsets = ReadOnlyMapping({})
"""Of members that all start at one place."""
START_PREFIX = "start_"
"""What the name of a parameter that shifts a state's start begins with."""


@renamed_fields(cloud="samples")
@dataclass(frozen=True, eq=False, init=False)
class Fleet(ArcMembers):
    """Who moves.

    Parameters
    ----------
    system : System
        The dynamics that all members share.
    parameters : mapping of str to Distribution
        The distribution of each parameter that differs between members, independent of each other. Names are those of
        ``system.parameters``, and ``start_`` with the name of a state, an offset of its start. Parameters of the system
        that are not named have its values.
    position : array_like, shape (d,), optional
        Start position in metres, short for its states in `start`.
    heading : float, optional
        Start heading in radians, counted from +x counter-clockwise whatever the system's own convention; short for that
        state in `start`, for systems that have one.
    input_lower, input_upper : array_like, shape (n_u,), optional
        Bounds of the commands; the system's own if not given.
    radius : float
        Radius of a robot in metres; obstacles grow by it.
    samples : mapping of str to array_like of shape (robots,), optional
        Measured robots whose parameters belong together: for each of some parameters that bend trajectories the values
        of all robots, in one order. Their distributions have to be the `Samples` of these values. Means, moments and
        draws follow the joint samples; a plan still holds for all combinations in the ranges.
    rate_bounds : array_like, shape (n_u,), optional
        Largest change of each command per second, between successive steps; infinite if not given.
    start : mapping of str to float, optional
        Where all members start, by the names of states; the others start at the system's own values, or zero.
    starts : mapping of str to array_like of shape (d,), or array_like of shape (n, d), optional
        Members that start at different places under the same command: the places, as offsets from the start in metres,
        by name. There are members with all the parameters at each of them.
    uncertainty : Uncertainty, optional
        What robots may do beside the model; proofs hold for all of it. By default they follow the model.
    footprint : Footprint, optional
        The shape of a robot, which ``avoid`` keeps out of obstacles; it grows by `radius`. A point, or a disk of that
        radius, if not given.

    Raises
    ------
    ProblemError
        For names that the system does not know or that give the same thing twice, numbers that are not finite,
        parameters that the system refuses, and rates that are not finite or of another shape at the start.

    Examples
    --------
    >>> from ensemble_ctrl.moments import Interval
    >>> from ensemble_ctrl.systems import DoubleIntegrator, Unicycle
    >>> fleet = Fleet(DoubleIntegrator(), {"mass": Interval(1.0, 2.0)}, start={"vx": 1.0})
    >>> fleet.trajectories(np.array([[2.0, 0.0]]), fleet.corners, 1.0)[:, -1, :2]
    array([[2. , 0. ],
           [1.5, 0. ]])
    >>> Fleet(Unicycle(), {"traction": Interval(0.9, 1.1)}, position=[0, 1], heading=0.0).start
    {'x': 0.0, 'y': 1.0, 'heading': 0.0}
    """

    system: System
    parameters: Mapping[str, Distribution]
    input_lower: Floats
    input_upper: Floats
    radius: float
    samples: Mapping[str, Floats] | None
    rate_bounds: Floats | None
    start: Mapping[str, float]
    uncertainty: Uncertainty
    starts: Offsets
    footprint: Footprint | None

    def __init__(
        self,
        system: System,
        parameters: Mapping[str, Distribution],
        position: ArrayLike | None = None,
        heading: float | str | None = None,
        input_lower: ArrayLike | None = None,
        input_upper: ArrayLike | None = None,
        radius: float | str = 0.0,
        samples: Mapping[str, ArrayLike] | None = None,
        rate_bounds: ArrayLike | None = None,
        *,
        start: Mapping[str, float] | None = None,
        uncertainty: Uncertainty | None = None,
        starts: Mapping[str, ArrayLike] | ArrayLike | None = None,
        footprint: Footprint | None = None,
    ) -> None:
        expect("fleet.system", system, System).require_complete()
        self._set(
            system=system, parameters=ReadOnlyMapping(distributions_of("fleet.parameters", parameters)), samples=None
        )
        self._check_names()
        self._set(start=start_of(system, start, position, heading), radius=radius_of(radius))
        lower, upper = np.array(system.input_bounds, dtype=float).T
        lower = per_control(system, "input_lower", lower if input_lower is None else input_lower)
        upper = per_control(system, "input_upper", upper if input_upper is None else input_upper)
        if (lower > upper).any():
            raise ProblemError(f"fleet.input_bounds: low above high: {lower}, {upper}")
        self._set(input_lower=lower, input_upper=upper, rate_bounds=rates_of(system, rate_bounds))
        self._set(uncertainty=expect("fleet.uncertainty", uncertainty or NONE, Uncertainty).checked(system))
        self._set(footprint=None if footprint is None else expect("fleet.footprint", footprint, Footprint))
        if samples is not None:
            self._set(samples=ReadOnlyMapping(self.checked_samples(samples)))
        self._set(starts=NO_STARTS)
        if not system.on_arcs:
            check_members(self)
        if starts is not None:
            self._set(starts=starts_of(system, starts))

    def _set(self, **fields: Any) -> None:
        """Fields of a new fleet."""
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _check_names(self) -> None:
        """Known parameters and states; states that a task can refer to."""
        for name in self.system.states:
            if name in RESERVED:
                wanted = "names that are no words of the task language"
                raise ProblemError(f"{type(self.system).__name__}.states: expected {wanted}, got {name!r}")
        known = [*self.system.parameters, *(START_PREFIX + name for name in self.system.states)]
        for name in self.parameters:
            if name not in known:
                own = ", ".join([*self.system.parameters, f"{START_PREFIX}<state>"])
                raise ProblemError(f"fleet.parameters: expected names among {own}, got {name!r}")
        self.system.check_names(self.parameters)

    def with_(self, **changes: Any) -> Self:
        """A copy with some arguments replaced, `position` and `heading` among them, checked like a new fleet."""
        known_only("fleet.with_", self, changes, "position", "heading")
        return replace(self, **{"start": rest_of_start(self.system, self.start, changes)} | changes)

    def at_start(self, name: str) -> Self:
        """The members at one of the starts: a fleet that starts there.

        Raises
        ------
        ProblemError
            For a name that no start has.
        """
        if name not in self.starts:
            raise ProblemError(f"start: expected one of {', '.join(self.starts) or 'no names'}, got {name!r}")
        base = self.of_one_start
        return base.with_(position=base.position + np.array(self.starts[name]))

    @property
    def of_one_start(self) -> Self:
        """The members that start at the start itself, for what does not depend on the place; the fleet, if all do."""
        return self.with_(starts=None) if self.starts else self

    def _require_one_start(self) -> None:
        """Refuse to say where members start that start at different places."""
        if self.starts:
            names = ", ".join(self.starts)
            several = f"this is for one start, and fleet.starts has several: {names}"
            raise UnsupportedError(f"{several}; for one of them give its place as fleet.start alone")

    @property
    def size_text(self) -> str:
        """How large a robot is, in words."""
        if self.footprint is None:
            return f"radius {self.radius:g} m"
        return f"footprint {self.footprint}" + (f" grown by {self.radius:g} m" if self.radius else "")

    @property
    def identity(self) -> list[object]:
        """What distinguishes how members move, and from where, from another fleet."""
        if self.starts:
            return [[name, *self.at_start(name).identity] for name in self.starts]
        return self.system.identity(self.start, self.start_states(self.center[None]))

    @property
    def enclosure(self) -> str:
        """The name of the enclosure that proofs of this fleet use (`ensemble_ctrl.certificate`)."""
        return self.system.enclosure

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states that a task may refer to, the columns of `trajectories`."""
        return self.system.spoken

    @property
    def places(self) -> tuple[str, ...]:
        """Which states are the position."""
        return self.system.positions

    @property
    def state_units(self) -> dict[str, str]:
        """As the system declares them; metres for a position without a declared unit."""
        known = dict(zip(self.states, self.system.state_units, strict=False))
        return dict.fromkeys(self.places, "m") | known

    def unit_of(self, names: Iterable[str]) -> str:
        """What follows a number that is the smallest of distances in these states; of no states, a distance in space.

        A unit, or words like ``in mixed units (m, m/s)`` and ``in m or the unit of temp``.
        """
        return unit_of(self.state_units | dict(self.system.signals), set(names) or set(self.places))

    @cached_property
    def place_columns(self) -> slice | list[int]:
        """Where the position stands among the states."""
        columns = [self.states.index(name) for name in self.places]
        first = columns[0]
        return slice(first, first + len(columns)) if columns == list(range(first, first + len(columns))) else columns

    @cached_property
    def position(self) -> Floats:
        """Where members start but for the offsets of the parameters, shape (d,), metres."""
        self._require_one_start()
        given = {**self.system.start(), **self.start}
        place = np.array([float(given.get(name, 0.0)) for name in self.places])
        place.setflags(write=False)
        return place

    @property
    def heading(self) -> float:
        """Start heading but for the offset of a parameter, radians from +x counter-clockwise; 0 where there is none."""
        return float(self.start.get(self.system.heading_state, 0.0))

    @cached_property
    def start_place(self) -> Floats:
        """Middle of the start positions, shape (d,), metres."""
        columns = [self.system.states.index(name) for name in self.places]
        return np.asarray(self.start_states(self.center[None])[columns, 0])

    @cached_property
    def dynamic(self) -> tuple[int, ...]:
        """Columns of the parameters that bend the position curve; the others only shift the start."""
        shifts = {START_PREFIX + name for name in self.system.shifts}
        return tuple(k for k, name in enumerate(self.names) if name not in shifts)

    @cached_property
    def shifting(self) -> Floats:
        """How much each parameter shifts the whole position curve, shape (parameters, d)."""
        # 1 in the row of start_x and the column of x, for each coordinate
        rows = np.zeros((len(self.names), len(self.places)))
        for k in set(range(len(self.names))) - set(self.dynamic):
            rows[k, self.places.index(self.names[k].removeprefix(START_PREFIX))] = 1.0
        return rows

    @cached_property
    def shift(self) -> Floats:
        """Half the side lengths of the box by which parameters shift the position curve, shape (d,), metres."""
        # half widths of the shifting parameters, per coordinate
        return np.asarray((self.upper - self.lower) / 2 @ self.shifting)

    @cached_property
    def shift_covariance(self) -> Floats:
        """Covariance of these shifts, shape (d, d), square metres: no control can change it."""
        total = np.zeros((len(self.places), len(self.places)))
        for direction, distribution in zip(self.shifting, self.parameters.values(), strict=True):
            if direction.any():
                # variance of psi by two Gauss points, exact for degree 3
                s, weights = distribution.rule(2)
                psi = distribution.to_parameter(s)
                variance = float(weights @ psi**2 / 2 - (weights @ psi / 2) ** 2)
                total += variance * np.outer(direction, direction)
        return total

    def shifted(self, name: str) -> int:
        """The state whose start a parameter shifts; -1 for a parameter of the system."""
        return -1 if name in self.system.parameters else self.system.states.index(name.removeprefix(START_PREFIX))

    def rest(self, member: Floats) -> Floats:
        """The command that costs no effort, of one member of shape (parameters,), within the bounds, shape (n_u,)."""
        psi = {name: float(value[0]) for name, value in self.psi(member[None]).items()}
        return np.asarray(np.clip(np.array(self.system.rest(psi), dtype=float), self.input_lower, self.input_upper))

    def psi(self, members: Floats) -> dict[str, Floats]:
        """The system's parameters of members of shape (members, parameters), each of shape (members,)."""
        columns = dict(zip(self.names, members.T, strict=True))
        return {
            name: columns.get(name, np.full(len(members), float(value)))
            for name, value in self.system.parameters.items()
        }

    def start_states(self, members: Floats) -> Floats:
        """States of members at time zero, shape (n_x, members)."""
        self._require_one_start()
        given = {**self.system.start(), **self.start}
        states = np.tile(
            np.array([float(given.get(name, 0.0)) for name in self.system.states])[:, None], (1, len(members))
        )
        for name, column in zip(self.names, members.T, strict=True):
            if (state := self.shifted(name)) >= 0:
                states[state] += column
        return states

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

    def trajectories(self, controls: Floats, members: Floats, step: float) -> Floats:
        """The `states` of members at the ends of all steps: on exact arcs, or with an estimated error below `ACCURACY`.

        Parameters
        ----------
        controls : ndarray, shape (steps, n_u)
        members : ndarray, shape (members, parameters)
        step : float
            Seconds.

        Returns
        -------
        ndarray, shape (members, steps + 1, states)

        Raises
        ------
        RunawayError
            If a state is not finite, or the system is too stiff for the rule.
        """
        if self.system.on_arcs:
            return self.arcs.paths(controls, self.coefficients(members), step)
        return accurate(self, controls, members, step)

    def full_states(self, controls: Floats, members: Floats, step: float) -> Floats:
        """As `trajectories`, with every state of the system, shape (members, steps + 1, n_x)."""
        found = self.trajectories(controls, members, step)
        if not self.system.on_arcs:
            return found
        turns = self.arcs.headings(controls, self.coefficients(members), step)
        return np.concatenate([found, turns[..., None]], axis=2)

    @cached_property
    def counted(self) -> dict[tuple[bytes, float], int]:
        """The substeps that the last controls need: a replay needs them block by block."""
        return {}

    def integrated(
        self, controls: Floats, members: Floats, step: float, substeps: int, rule: Rule = extrapolated
    ) -> Floats:
        """States by a given number of steps of a rule, finite or not (`ensemble_ctrl.problem.integrated`)."""
        return integrated(self, controls, members, step, substeps, rule)


__all__ = ["START_COLUMNS", "START_PREFIX", "Fleet", "Member"]
