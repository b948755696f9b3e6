"""Fleets of systems defined by a differential equation, and their trajectories with a stated accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.constraints.stl._tokens import RESERVED
from ensemble_ctrl.core.errors import ProblemError, RunawayError
from ensemble_ctrl.core.readonly import ReadOnlyMapping
from ensemble_ctrl.core.values import expect, numbers
from ensemble_ctrl.moments import Law
from ensemble_ctrl.problem.arguments import laws_of, numbers_by_name, quantity_of
from ensemble_ctrl.problem.ensemble import Ensemble
from ensemble_ctrl.systems import OdeSystem
from ensemble_ctrl.systems.integration import Rule, extrapolated, halving_error

Floats = NDArray[np.float64]

START_PREFIX = "start_"
"""What the name of a parameter that shifts a state's start begins with."""
ACCURACY = 1e-8
"""Largest estimated error of any state at any grid time in a replay, relative to its size where that is above 1."""
SURE = 16
"""Steps of integration in one step of control with which a state that is not finite counts as running away."""
MOST_SUBSTEPS = 128
"""Steps of integration in one step of control beyond which a system counts as too stiff."""


@dataclass(frozen=True, eq=False)
class OdeFleet(Ensemble):
    """Who moves: robots that follow a differential equation.

    Parameters
    ----------
    system : OdeSystem
        The dynamics all members share.
    parameters : mapping of str to Law
        The law of each parameter that differs between members, independent of each other. Names are those of
        ``system.parameters``, and ``start_`` with the name of a state, an offset of its start. Parameters of the system
        that are not named have its values.
    start : mapping of str to float
        Where all members start, by the names of states; the others start at the system's own values, or zero.
    input_lower, input_upper : array_like, shape (n_u,), optional
        Bounds of the commands; the system's own if not given.
    radius : float
        Radius of a robot in metres; obstacles grow by it.
    rate_bounds : array_like, shape (n_u,), optional
        Largest change of each command per second, between successive steps; infinite if not given.

    Raises
    ------
    ProblemError
        For names that the system does not know, numbers that are not finite, parameters that the system refuses, and
        rates that are not finite or of another shape at the start.

    Examples
    --------
    >>> from ensemble_ctrl.moments import Interval
    >>> from ensemble_ctrl.systems import DoubleIntegrator
    >>> fleet = OdeFleet(DoubleIntegrator(), {"mass": Interval(1.0, 2.0)}, {"vx": 1.0})
    >>> fleet.trajectories(np.array([[2.0, 0.0]]), fleet.corners, 1.0)[:, -1, :2]
    array([[2. , 0. ],
           [1.5, 0. ]])
    """

    system: OdeSystem
    parameters: Mapping[str, Law]
    start: Mapping[str, float]
    input_lower: Floats | None = None  # type: ignore[assignment]
    input_upper: Floats | None = None  # type: ignore[assignment]
    radius: float = 0.0
    rate_bounds: Floats | None = None

    def __post_init__(self) -> None:
        expect("fleet.system", self.system, OdeSystem)
        self.system.require_complete()
        for name in self.system.states:
            if name in RESERVED:
                wanted = "names that are no words of the task language"
                raise ProblemError(f"{type(self.system).__name__}.states: expected {wanted}, got {name!r}")
        object.__setattr__(self, "parameters", ReadOnlyMapping(laws_of("fleet.parameters", self.parameters)))
        object.__setattr__(self, "start", ReadOnlyMapping(numbers_by_name("fleet.start", self.start)))
        object.__setattr__(self, "radius", quantity_of("fleet.radius", self.radius, "length"))
        lower, upper = np.array(self.system.input_bounds, dtype=float).T
        for name, given, own in (("input_lower", self.input_lower, lower), ("input_upper", self.input_upper, upper)):
            object.__setattr__(self, name, self._per_control(name, own if given is None else given))
        if (self.input_lower > self.input_upper).any():  # type: ignore[operator]
            raise ProblemError(f"fleet.input_bounds: low above high: {self.input_lower}, {self.input_upper}")
        if not np.isfinite(self.radius) or self.radius < 0:
            raise ProblemError(f"fleet.radius: expected a radius of at least 0 m, got {self.radius}")
        if self.rate_bounds is not None:
            rates = self._per_control("rate_bounds", self.rate_bounds, finite=False)
            if (rates <= 0).any():
                raise ProblemError(f"fleet.rate_bounds: expected numbers above 0, got {rates.tolist()}")
            object.__setattr__(self, "rate_bounds", rates)
        self._check_names()
        self._check_members()

    def _per_control(self, name: str, values: ArrayLike, finite: bool = True) -> Floats:
        """A read-only number for each command."""
        array = numbers(f"fleet.{name}", values, "one number for each command")
        wanted = f"one number for each of {', '.join(self.system.controls)}"
        if array.shape != (len(self.system.controls),) or np.isnan(array).any() or (finite and np.isinf(array).any()):
            raise ProblemError(f"fleet.{name}: expected {wanted}, got {array.tolist()}")
        array.setflags(write=False)
        return array

    def _check_names(self) -> None:
        """Known parameters and states."""
        known = [*self.system.parameters, *(START_PREFIX + name for name in self.system.states)]
        for name in self.parameters:
            if name not in known:
                own = ", ".join([*self.system.parameters, f"{START_PREFIX}<state>"])
                raise ProblemError(f"fleet.parameters: expected names among {own}, got {name!r}")
        for name, value in self.start.items():
            if name not in self.system.states:
                raise ProblemError(f"fleet.start: expected names among {', '.join(self.system.states)}, got {name!r}")
            if not np.isfinite(value):
                raise ProblemError(f"fleet.start.{name}: expected a finite number, got {value}")

    def _check_members(self) -> None:
        """The system takes every corner of the ranges and the middle, and its rates are numbers at the start."""
        rest: Sequence[float] = ()
        for member in (*self.corners, self.center):
            psi = {name: float(value[0]) for name, value in self.psi(member[None]).items()}
            self.system.check(psi)
            rest = self.system.rest(psi)
        command = self._per_control("system.rest", rest)
        members = np.concatenate([self.corners, self.center[None]])
        try:
            with np.errstate(all="ignore"):
                rates = self.system.rates(self.start_states(members), command, self.psi(members))
        except (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
            what = f"{type(self.system).__name__}.xdot can't be evaluated"
            raise ProblemError(f"{what}: {type(error).__name__}: {error}") from error
        bad = np.argwhere(~np.isfinite(rates))
        if len(bad):
            state, member = bad[0]
            told = ", ".join(f"{n} = {v:g}" for n, v in self.named(members[member]).items()) or "every member"
            what = f"{type(self.system).__name__}.xdot"
            name = self.system.states[state]
            raise ProblemError(
                f"{what}: expected finite rates at the start, got {rates[state, member]} for {name} ({told})"
            )

    @property
    def enclosure(self) -> str:
        """The name of the enclosure that proofs of this fleet use."""
        return self.system.enclosure

    @property
    def identity(self) -> list[object]:
        """The system with its settings, and the state at the start."""
        start = self.start_states(self.center[None])
        return [self.system.name, sorted(self.system.settings().items()), start.tolist()]

    @property
    def states(self) -> tuple[str, ...]:
        """The system's states."""
        return self.system.states

    @property
    def places(self) -> tuple[str, ...]:
        """The system's position."""
        return self.system.positions

    @property
    def state_units(self) -> dict[str, str]:
        """What the system says; metres for the position where it says nothing."""
        known = dict(zip(self.states, self.system.state_units, strict=False))
        return dict.fromkeys(self.places, "m") | known

    @cached_property
    def position(self) -> Floats:
        """Middle of the start positions, shape (d,), metres."""
        return np.asarray(self.start_states(self.center[None])[self.place_columns, 0])

    @property
    def start_place(self) -> Floats:
        """Middle of the start positions."""
        return self.position

    @property
    def shift_covariance(self) -> Floats:
        """Zero, shape (d, d): every parameter bends trajectories here."""
        return np.zeros((len(self.places), len(self.places)))

    def shifted(self, name: str) -> int:
        """The state whose start a parameter shifts; -1 for a parameter of the system."""
        return -1 if name in self.system.parameters else self.states.index(name.removeprefix(START_PREFIX))

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
        told = {**self.system.start(), **self.start}
        states = np.tile(np.array([float(told.get(name, 0.0)) for name in self.states])[:, None], (1, len(members)))
        for name, column in zip(self.names, members.T, strict=True):
            if (state := self.shifted(name)) >= 0:
                states[state] += column
        return states

    def trajectories(self, controls: Floats, members: Floats, step: float) -> Floats:
        """States of members at the ends of all steps, with an estimated error below `ACCURACY`.

        Returns
        -------
        ndarray, shape (members, steps + 1, n_x)

        Raises
        ------
        RunawayError
            If a state is not finite, or the system is too stiff for the rule.
        """
        key = np.asarray(controls, dtype=float).tobytes(), step
        if (count := self._counted.get(key)) is None:
            self._counted.clear()
            count = self._counted[key] = self.substeps(controls, step)
        states = self.integrated(controls, members, step, count)
        self._require_finite(states, members, step)
        return states

    @cached_property
    def _counted(self) -> dict[tuple[bytes, float], int]:
        """The substeps that the last controls need: a replay asks block by block."""
        return {}

    def integrated(
        self, controls: Floats, members: Floats, step: float, substeps: int, rule: Rule = extrapolated
    ) -> Floats:
        """The same with a given number of steps of a rule, finite or not."""
        states = np.empty((len(controls) + 1, len(self.states), len(members)))
        states[0], psi = self.start_states(members), self.psi(members)
        with np.errstate(all="ignore"):
            for k, command in enumerate(np.asarray(controls, dtype=float)):
                states[k + 1] = self.system.flow(states[k], command, psi, step, substeps, rule)
        return states.transpose(2, 0, 1)

    def substeps(self, controls: Floats, step: float, accuracy: float = ACCURACY, rule: Rule = extrapolated) -> int:
        """How many steps of a rule a step of control needs, by halving until the estimated error is small enough.

        Notes
        -----
        The error is estimated for the corners of the ranges and the middle, at every grid time.
        """
        members = np.concatenate([self.corners, self.center[None]])
        if self.system.has_exact:
            return 1
        count, coarse = 1, self.integrated(controls, members, step, 1, rule)
        while True:
            fine = self.integrated(controls, members, step, 2 * count, rule)
            with np.errstate(all="ignore"):
                error = np.abs(halving_error(rule, coarse, fine)) / np.maximum(1.0, np.abs(fine))
            if np.isfinite(error).all() and error.max() <= accuracy:
                return 2 * count
            if 2 * count >= SURE and not np.isfinite(coarse).all():
                self._require_finite(fine, members, step)
            if 2 * count >= MOST_SUBSTEPS:
                self._require_finite(fine, members, step)
                member, k, state = np.unravel_index(int(error.argmax()), error.shape)
                rule_text = f"{MOST_SUBSTEPS} steps of integration in each step of {step:g} s"
                what = f"too stiff: {self.states[state]} is known to {error.max():.2g} only with {rule_text}"
                raise self._runaway(f"{what}, not to {accuracy:g},", members[member], int(k), step)
            count, coarse = 2 * count, fine

    def _require_finite(self, states: Floats, members: Floats, step: float) -> None:
        """Refuse trajectories that run away or turn into NaN."""
        bad = ~np.isfinite(states)
        if bad.any():
            member, k, state = np.argwhere(bad)[0]
            raise self._runaway(f"{self.states[state]} leaves all bounds", members[member], int(k), step)

    def _runaway(self, what: str, member: Floats, k: int, step: float) -> RunawayError:
        """What happens to a member at a grid time, as an error."""
        parameters = self.named(member)
        told = ", ".join(f"{n} = {v:g}" for n, v in parameters.items()) or "every member"
        text = f"{what} at t = {k * step:.4g} s for {told}"
        return RunawayError(f"{self.system.name}: {text}", text, parameters, k * step)
