r"""What every system gives: its states, commands and parameters, and the ODE that they follow.

A member's state `x` follows ``xdot(x, u, psi)`` while its command `u` is constant over a step.  The right-hand side is
written once, over numbers, NumPy arrays of members and CasADi expressions alike.  Nothing else checks the kind of a
system: what differs between systems is an attribute here, and what a problem may use of one is in
`ensemble_ctrl.problem.capabilities`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.systems.integration import Rule, extrapolated

Floats = NDArray[np.float64]


class System:
    r"""The dynamics ``dx/dt = xdot(x, u, psi)`` that every member of a fleet shares.

    A subclass gives the names of its states and commands, and writes `xdot`; that is all. Its class attributes are

    Attributes
    ----------
    name, summary : str
        For lists and reports.
    states : tuple of str
        Names of the states, in order; tasks refer to them.
    positions : tuple of str
        Which states are the position, one to three of them, metres: regions and obstacles are about these.
    state_units : tuple of str, optional
        Units of the states, for messages; without them the position is in metres and other units are not named.
    controls, control_units : tuple of str
        Names and units of the commands.
    input_bounds : tuple of (float, float)
        Default bounds of each command.
    parameters : mapping of str to float
        What may differ between members, each with the value where it does not.
    parameter_units : mapping of str to str, optional
        Units of the parameters, for labels.
    heading_state : str, optional
        The state that is a heading in the plane, radians from +x counter-clockwise, if there is one.
    signals : mapping of str to str
        What a task may refer to besides `spoken`, with the unit of each.
    transcription, enclosure : str
        By name: which optimisation variables represent members (`ensemble_ctrl.planning.planner`), and what encloses
        them in a proof (`ensemble_ctrl.certificate`).
    on_arcs : bool
        Whether members move on exact arcs, each by its own member coefficients (`ensemble_ctrl.systems.arcs`).
    command_kind : str
        What a command is in a ROS 2 bag: ``twist`` of speed and turn rate, ``drive`` of speed and steering angle; else
        numbers.
    shifts : tuple of str
        States whose start only shifts the position curve, by as much.
    factors : tuple of str
        Parameters that are factors, above 0.

    Notes
    -----
    Write `xdot` with arithmetic and the functions of `ensemble_ctrl.systems.arrays` (``sin``, ``sqrt``, ...), without
    ``if`` on states: it is evaluated on expressions too.

    Examples
    --------
    >>> class Cart(System):
    ...     name, states, positions = "cart", ("x", "v"), ("x",)
    ...     controls, control_units, input_bounds = ("force",), ("N",), ((-5.0, 5.0),)
    ...     parameters = {"mass": 1.0}
    ...     def xdot(self, x, u, psi):
    ...         return [x[1], u[0] / psi["mass"]]
    >>> end = Cart().flow(np.zeros((2, 2)), [2.0], {"mass": np.array([1.0, 2.0])}, 1.0, substeps=1)
    >>> end.round(3)
    array([[1. , 0.5],
           [2. , 1. ]])
    """

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    states: ClassVar[tuple[str, ...]] = ()
    positions: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ()
    controls: ClassVar[tuple[str, ...]] = ()
    control_units: ClassVar[tuple[str, ...]] = ()
    input_bounds: ClassVar[tuple[tuple[float, float], ...]] = ()
    parameters: Mapping[str, float] = {}
    parameter_units: ClassVar[Mapping[str, str]] = {}
    heading_state: ClassVar[str] = ""
    signals: ClassVar[Mapping[str, str]] = {}
    transcription: ClassVar[str] = "states"
    enclosure: ClassVar[str] = "general"
    on_arcs: ClassVar[bool] = False
    command_kind: ClassVar[str] = ""
    shifts: ClassVar[tuple[str, ...]] = ()
    factors: ClassVar[tuple[str, ...]] = ()

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        """Rates of the states.

        Parameters
        ----------
        x : sequence of arrays
            One entry for each of `states`: a number, an array over members, or an expression.
        u : sequence of arrays
            One entry for each of `controls`.
        psi : mapping of str to array
            The parameters by name.

        Returns
        -------
        sequence of arrays
            One rate for each state, in the state's unit per second.
        """
        raise NotImplementedError(f"{type(self).__name__}.xdot")

    def exact(self, x: Any, u: Any, psi: Mapping[str, Any], step: Any) -> Sequence[Any] | None:
        """The states after `step` seconds of a constant command in closed form; None where there is no such form."""
        return None

    def check(self, psi: Mapping[str, float]) -> None:
        """Refuse parameters for which the equations make no sense.

        Raises
        ------
        ProblemError
            For example for a mass that is not positive. It is called with the corners of a fleet's ranges.
        """

    def check_names(self, names: Collection[str]) -> None:
        """Refuse parameters that can't differ between members together.

        Raises
        ------
        ProblemError
            For example for two names of one thing.
        """

    def identity(self, start: Mapping[str, float], states: Floats) -> list[object]:
        """What distinguishes how members move from another system, for a certificate's fingerprint.

        Parameters
        ----------
        start : mapping of str to float
            Where all members start, as given.
        states : ndarray, shape (n_x, 1)
            Where the middle member starts.
        """
        return [self.name, sorted(self.settings().items()), states.tolist()]

    def rest(self, psi: Mapping[str, float]) -> Sequence[float]:
        """The command that costs no effort, such as the thrust of a hover; zero unless a subclass changes it."""
        return [0.0] * len(self.controls)

    def gain(self, psi: Mapping[str, float]) -> float | None:
        """The member's factor k, not 0, where commands move it by k times what they move every other one; None here.

        That is, the position is the free motion, under zero commands, plus k c(t) with the same c for all members.
        """
        return None

    def start(self) -> Mapping[str, float]:
        """States that do not start at zero unless a fleet sets them, such as the scalar part of a quaternion."""
        return {}

    def attitude(self, x: Floats) -> Floats:
        """How a robot is turned, as unit quaternions (x, y, z, w) for programs that draw it; not turned at all here.

        Parameters
        ----------
        x : ndarray, shape (n_x, times)

        Returns
        -------
        ndarray, shape (4, times)
        """
        return np.array([0.0, 0.0, 0.0, 1.0])[:, None] * np.ones(x.shape[1])

    def settings(self) -> Mapping[str, Any]:
        """Numbers that all members share and that a problem file may give, by name; written back into problem files."""
        return {}

    @property
    def spoken(self) -> tuple[str, ...]:
        """The states that a task may refer to: all of them."""
        return self.states

    @property
    def has_exact(self) -> bool:
        """Whether `exact` is written."""
        return type(self).exact is not System.exact

    def flow(
        self, x: Floats, u: Any, psi: Mapping[str, Any], step: float, substeps: int, rule: Rule = extrapolated
    ) -> Floats:
        """The states of all members after a step of a constant command.

        Parameters
        ----------
        x : ndarray, shape (n_x, members)
        u : sequence of float or arrays of shape (members,)
            The command.
        psi : mapping of str to array of shape (members,)
        step : float
            Seconds.
        substeps : int
            Steps of the rule; of no matter where `exact` is written.
        rule : callable
            A rule of `ensemble_ctrl.systems.integration`.

        Returns
        -------
        ndarray, shape (n_x, members)
        """
        if self.has_exact:
            return self._stacked(self.exact(list(x), u, psi, step), x, "exact")
        return np.asarray(rule(lambda at: self.derivatives(at, u, psi), x, step, substeps))

    def derivatives(self, x: Floats, u: Any, psi: Mapping[str, Any]) -> Floats:
        """`xdot` as one array of the shape of `x`, (n_x, members), checked for its shape.

        Raises
        ------
        ProblemError
            If `xdot` returns something else than one real rate for each state.
        """
        return self._stacked(self.xdot(list(x), u, psi), x, "xdot")

    def _stacked(self, rows: Any, x: Floats, what: str) -> Floats:
        """What a system returns as one array of the shape of `x`."""
        place = f"{type(self).__name__}.{what}"
        try:
            found = len(rows)
        except TypeError:
            raise ProblemError(f"{place}: expected {len(self.states)} rates, got {type(rows).__name__}") from None
        if found != len(self.states):
            names = ", ".join(self.states)
            raise ProblemError(f"{place}: expected {len(self.states)} entries ({names}), got {found}")
        # one row a state; constants are spread over the members
        result = np.empty_like(x)
        for name, row, value in zip(self.states, result, rows, strict=True):
            if np.iscomplexobj(value):  # its imaginary part would be lost
                raise ProblemError(f"{place}: expected real numbers for {name}, got complex ones")
            try:
                row[...] = value
            except (TypeError, ValueError):
                shape = getattr(value, "shape", type(value).__name__)
                raise ProblemError(f"{place}: expected an array over members for {name}, got {shape}") from None
        return result

    def require_complete(self) -> None:
        """Refuse a system whose attributes are incomplete or inconsistent.

        Raises
        ------
        ProblemError
            Naming the attribute that is missing or does not fit the others.
        """
        kind = type(self).__name__
        for attribute in ("name", "states", "positions", "controls"):
            if not getattr(self, attribute):
                raise ProblemError(f"{kind}.{attribute}: this is required, but missing")
        if len(set(self.states)) != len(self.states) or not all(name.isidentifier() for name in self.states):
            raise ProblemError(f"{kind}.states: expected different names, got {self.states}")
        unknown = [name for name in self.positions if name not in self.states]
        if unknown or not 1 <= len(self.positions) <= 3:
            raise ProblemError(f"{kind}.positions: expected one to three of the states, got {self.positions}")
        if self.state_units and len(self.state_units) != len(self.states):
            wanted = f"one entry for each of {', '.join(self.states)}, or none"
            raise ProblemError(f"{kind}.state_units: expected {wanted}, got {self.state_units}")
        for attribute in ("control_units", "input_bounds"):
            if len(getattr(self, attribute)) != len(self.controls):
                wanted = f"one entry for each of {', '.join(self.controls)}"
                raise ProblemError(f"{kind}.{attribute}: expected {wanted}, got {getattr(self, attribute)}")


OdeSystem = System
"""The name that users' systems build on."""
