"""The enclosure against SciPy's integrators: no member is ever outside, and the radius is small."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general import enclose
from ensemble_ctrl.certificate.general import enclosure as module
from ensemble_ctrl.certificate.general.enclosure import Enclosure
from ensemble_ctrl.certificate.general.picard import approximate
from ensemble_ctrl.certificate.general.start import Start
from ensemble_ctrl.systems import DoubleIntegrator, OdeSystem, Quadrotor
from ensemble_ctrl.systems.arrays import arctan, cos, exp, log, sin, sqrt, tanh

Floats = NDArray[np.float64]
Ranges = Mapping[str, tuple[float, float]]


class Crane(OdeSystem):
    """Oscillates."""

    name, states, positions = "crane", ("x", "v", "angle", "rate"), ("x",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-10.0, 10.0),)
    parameters: ClassVar[Mapping[str, float]] = {"load": 0.15, "length": 0.5}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        _, v, angle, rate = x
        s, c, load = sin(angle), cos(angle), psi["load"]
        a = (u[0] + load * s * (psi["length"] * rate**2 + 9.81 * c)) / (1.0 + load * s**2)
        return [v, a, rate, -(a * c + 9.81 * s) / psi["length"]]


class Planar(OdeSystem):
    """A planar quadrotor."""

    name, states, positions = "planar", ("x", "z", "vx", "vz", "tilt", "rate"), ("x", "z")
    controls, control_units, input_bounds = ("thrust", "torque"), ("N", "N m"), ((0.0, 30.0), (-1.0, 1.0))
    parameters: ClassVar[Mapping[str, float]] = {"mass": 1.0, "drag": 0.1}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        _, _, vx, vz, tilt, rate = x
        lift = u[0] / psi["mass"]
        return [vx, vz, -sin(tilt) * lift - psi["drag"] * vx, cos(tilt) * lift - 9.81, rate, u[1] / 0.05]


class Every(OdeSystem):
    """Every function of `systems.arrays`, stable and unstable states."""

    name, states, positions = "every", ("x", "y", "p", "q"), ("x", "y")
    controls, control_units, input_bounds = ("a", "b"), ("1", "1"), ((-1.0, 1.0), (-1.0, 1.0))
    parameters: ClassVar[Mapping[str, float]] = {"k": 1.0, "m": 2.0, "e": 0.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        px, py, p, q = x
        k, m = psi["k"], psi["m"]
        return [
            tanh(p) + k * sin(q) - 0.3 * px,
            arctan(q) / m + 0.1 * px * cos(py) + psi["e"],
            u[0] - k * p + 0.2 * sqrt(4 + p**2) * exp(-(py**2) / 4),
            u[1] + log(3 + sin(p)) / (m + p**2) - q * k**0.5,
        ]


def start(system: OdeSystem, ranges: Mapping[str, tuple[float, float]], origin: Sequence[float]) -> Start:
    """The box of parameters; names that begin with start_ shift a state."""
    names = tuple(ranges)
    shifts = [system.states.index(n.removeprefix("start_")) if n.startswith("start_") else -1 for n in names]
    lower, upper = (np.array([ranges[n][k] for n in names], dtype=float) for k in (0, 1))
    return Start(names, lower, upper, np.array(origin, dtype=float), np.array(shifts, dtype=np.int64))


INTEGRATED = 2e-11
"""Error of the integrator, relative to the size of a state where that is above 1."""


def rates(system: OdeSystem, u: list[float], psi: dict[str, float], _: float, x: Floats) -> Floats:
    """The right-hand side as an array."""
    return np.array(system.xdot(list(x), u, psi), dtype=float)


def states(system: OdeSystem, begin: Start, member: Floats, controls: Floats, step: float, shares: Floats) -> Floats:
    """States of a member at shares of every step, by DOP853, shape (steps, shares, states)."""
    x = begin.origin.copy()
    psi = {name: float(value) for name, value in system.parameters.items()}
    for name, shift, value in zip(begin.names, begin.shifts, member, strict=True):
        if shift >= 0:
            x[shift] += value
        else:
            psi[name] = float(value)
    found = np.empty((len(controls), len(shares), len(x)))
    for k, u in enumerate(controls):
        run = solve_ivp(
            partial(rates, system, u.tolist(), psi), (0.0, step), x,
            method="DOP853", rtol=3e-14, atol=1e-14, dense_output=True,
        )  # fmt: skip
        assert run.sol is not None
        found[k], x = run.sol(shares * step).T, run.y[:, -1]
        found[k, shares == 1.0] = x
    return found


def beyond(enclosure: Enclosure, begin: Start, member: Floats, path: Floats, shares: Floats) -> float:
    """By how much a member is outside the enclosure, relative to the size of the states; at most zero if inside."""
    inside = (np.abs(member - enclosure.centre) <= enclosure.half + 1e-300).all(axis=1)
    assert inside.any()
    worst = -np.inf
    for cell in np.flatnonzero(inside):
        half = enclosure.half[cell]
        s = np.where(half > 0, (member - enclosure.centre[cell]) / np.where(half > 0, half, 1.0), 0.0)[enclosure.wide]
        terms = np.cos(np.arccos(np.clip(s, -1, 1)) * enclosure.basis.exponents).prod(axis=1)
        for k, step in enumerate(path):
            for share, x in zip(shares, step, strict=True):
                part = min(int(share * enclosure.parts), enclosure.parts - 1)
                piece = k * enclosure.parts + part
                tau = 2 * (share * enclosure.parts - part) - 1
                times = np.cos(np.arccos(np.clip(tau, -1, 1)) * np.arange(enclosure.basis.times))
                near = np.einsum("stp,t,p->s", enclosure.c[piece, :, cell], times, terms)
                gap = (np.abs(x - near) - enclosure.radius[piece, :, cell]) / np.maximum(1.0, np.abs(x))
                worst = max(worst, float(gap.max()))
    return worst


SHARES = np.array([0.0, 0.31, 0.77, 1.0])

CASES: dict[str, tuple[OdeSystem, Ranges, Sequence[float], float, float, float]] = {
    "crane": (Crane(), {"load": (0.1, 0.2)}, [0, 0, 0.1, 0], 4.0, 2.0, 1e-6),
    "crane_two": (Crane(), {"load": (0.1, 0.2), "length": (0.45, 0.55)}, [0, 0, 0, 0], 1.5, 2.0, 1e-5),
    "planar": (Planar(), {"mass": (0.9, 1.1)}, [0, 0, 0, 0, 0, 0], 4.0, 0.05, 1e-6),
    "planar_three": (
        Planar(), {"mass": (0.95, 1.05), "start_vx": (-0.1, 0.1), "drag": (0.0, 0.2)}, [0] * 6, 1.5, 0.05, 1e-6
    ),
    "every": (Every(), {"k": (0.8, 1.2)}, [0.1, 0.2, 0, 0.3], 2.0, 0.8, 1e-6),
    "every_four": (
        Every(),
        {"k": (0.9, 1.1), "m": (1.9, 2.1), "start_x": (-0.1, 0.1), "e": (0.0, 0.1)},
        [0.1, 0.2, 0, 0.3], 0.8, 0.8, 1e-6,
    ),
    "one_member": (Every(), {}, [0, 0, 0, 0], 1.0, 0.8, 1e-8),
    "no_width": (Every(), {"k": (1.1, 1.1), "m": (1.5, 2.5)}, [0, 0, 0, 0], 1.0, 0.8, 1e-6),
    "quadrotor": (Quadrotor(), {"payload": (0.0, 0.4)}, [0] * 6 + [1] + [0] * 6, 1.2, 0.2, 1e-6),
    "double_integrator": (DoubleIntegrator(), {"mass": (0.5, 2.0)}, [1e6, -2e6, 0, 0], 3.0, 1.0, 1e-6),
}  # fmt: skip


def drawn(system: OdeSystem, size: float, steps: int, rng: np.random.Generator) -> Floats:
    """Random commands around those of rest."""
    rest = np.array(system.rest({name: float(value) for name, value in system.parameters.items()}))
    rest = np.where(np.array(system.controls) == "thrust", np.maximum(rest, 9.81), rest)
    return np.asarray(rest + size * rng.uniform(-1, 1, (steps, len(system.controls))))


@pytest.mark.parametrize("name", CASES)
def test_no_member_is_outside(name: str) -> None:
    """Members at the corners, in the middle and at random are inside at all times, and the radius is small."""
    system, ranges, origin, duration, size, wanted = CASES[name]
    rng, steps = np.random.default_rng(5), 12
    begin, controls = start(system, ranges, origin), drawn(system, size, steps, rng)
    found = enclose(system, begin, controls, duration)
    scale = np.maximum(1.0, np.abs(found.c).sum(axis=(3, 4)).max(axis=(0, 2)))
    assert (found.radius.max(axis=(0, 2)) <= wanted * scale).all()
    shares = rng.choice([0.0, 1.0], (2, len(ranges))).tolist() + rng.random((4, len(ranges))).tolist()
    for share in shares:
        member = begin.lower + np.array(share) * (begin.upper - begin.lower)
        path = states(system, begin, member, controls, duration / steps, SHARES)
        assert beyond(found, begin, member, path, SHARES) <= INTEGRATED


def test_a_member_of_other_commands_is_seen_outside() -> None:
    """Commands that differ by a millionth lead out of the enclosure: the test above could fail."""
    system, ranges, origin, duration, size, _ = CASES["planar"]
    rng = np.random.default_rng(5)
    begin, controls = start(system, ranges, origin), drawn(system, size, 12, rng)
    found = enclose(system, begin, controls, duration)
    path = states(system, begin, np.array([1.0]), controls * (1 + 1e-6), duration / 12, SHARES)
    assert beyond(found, begin, np.array([1.0]), path, SHARES) > 1e-8


@pytest.mark.parametrize(("part", "by", "term"), [
    (slice(0, 1), 1e-6, "jump"), (slice(1, 2), 1e-6, ""), (slice(2, None), 1e-8, "defect"),
])  # fmt: skip
def test_the_radius_holds_for_any_polynomials(
    part: slice, by: float, term: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of a piece, its slope, or its bend is moved a little; without jumps or defects the radius would not hold."""
    system, ranges, origin, duration, size, _ = CASES["planar"]
    rng = np.random.default_rng(5)
    begin, controls = start(system, ranges, origin), drawn(system, size, 12, rng)

    def moved(*args: Any) -> Floats:
        c = approximate(*args)
        c[..., part, 0] += by * rng.choice([-1.0, 1.0], (*c.shape[:3], 1))
        return c

    def outside() -> float:
        found = enclose(system, begin, controls, duration)
        return max(beyond(found, begin, member, path, SHARES) for member, path in paths)

    members = [np.array([value]) for value in (0.9, 0.97, 1.1)]
    paths = [(member, states(system, begin, member, controls, duration / 12, SHARES)) for member in members]
    monkeypatch.setattr(module, "approximate", moved)
    assert outside() <= 0
    if term:
        whole = getattr(module.Pieces, term)
        monkeypatch.setattr(module.Pieces, term, lambda *args: 0.0 * whole(*args))
        assert outside() > 0


class Runaway(OdeSystem):
    """Escapes at t = 1 / k."""

    name, positions = "runaway", ("x",)
    states: ClassVar[tuple[str, ...]] = ("x",)
    controls, control_units, input_bounds = ("u",), ("1",), ((-1.0, 1.0),)
    parameters: ClassVar[Mapping[str, float]] = {"k": 1.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["k"] * x[0] ** 2 + u[0]]


class Pole(Runaway):
    """Divides by what vanishes at x = 1."""

    name = "pole"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["k"] + 1e-3 / (x[0] - 1.0)]


class Kink(Runaway):
    """Compares a state."""

    name = "kink"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["k"] if np.all(x[0] < 0.5) else -psi["k"]]


class Catching(Runaway):
    """Compares a state, and does something else where that is refused."""

    name = "catching"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        try:
            return [psi["k"] if x[0] < 0.5 else -psi["k"]]
        except Exception:
            return [psi["k"]]


class Larger(Runaway):
    """Takes the larger of two."""

    name = "larger"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [np.maximum(x[0], psi["k"])]


class Root(Runaway):
    """Takes the root of what becomes negative."""

    name = "root"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [psi["k"] + sqrt(0.5 - x[0])]


class Scalar(Runaway):
    """Can't be evaluated for many members at once."""

    name = "scalar"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [float(x[0]) + psi["k"]]


BAD: dict[OdeSystem, str] = {
    Runaway(): r"x runs away or is no number at t = (0\.9|1).* s for k \d\.\d+",
    Pole(): r"divides by something that may vanish \(it depends on x\) at t = (0\.9|1).* s for k \d\.\d+\.\.\d\.\d+",
    Kink(): r"compares or rounds a state \(it depends on x\) at t = 0\.\.0\.2 s for k",
    Catching(): r"compares or rounds a state \(it depends on x\) at t = 0\.\.0\.2 s for k",
    Larger(): r"applies numpy\.maximum to a state \(it depends on x\) at t = 0\.\.0\.2 s for k",
    Root(): r"x runs away or is no number at t = 0\.\d+\.\.0\.\d+ s for k",
    Scalar(): "can't be evaluated for many members",
}
"""Systems with what is said of them: the state, the time and the cell by name."""


@pytest.mark.parametrize("system", BAD, ids=lambda s: s.name)
def test_what_can_not_be_enclosed_is_said(system: OdeSystem) -> None:
    """A system that escapes, divides by zero on the way or branches on a state ends in an error, not in bounds."""
    begin = start(system, {"k": (0.9, 1.1)}, [0.9 if system.name == "runaway" else 0.0])
    with pytest.raises(Unenclosed, match=BAD[system]):
        enclose(system, begin, np.zeros((10, 1)), 2.0)


class Matrix(Runaway):
    """Written with a matrix: members are seen as one list, and polynomials as objects."""

    name = "matrix"
    states: ClassVar[tuple[str, ...]] = ("x", "y")

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return list(np.array([[0.0, 1.0], [-1.0, 0.0]]) @ np.array([x[0], x[1]]) * psi["k"])


def test_a_system_may_be_written_with_matrices() -> None:
    """It turns at the rate k."""
    begin = start(Matrix(), {"k": (0.9, 1.1)}, [1.0, 0.0])
    found = enclose(Matrix(), begin, np.zeros((10, 1)), 2.0)
    shares = np.array([0.5, 1.0])
    times = (np.arange(10)[:, None] + shares) * 0.2
    for k in (0.9, 1.0, 1.1):
        path = np.stack([np.cos(k * times), -np.sin(k * times)], axis=-1)
        assert beyond(found, begin, np.array([k]), path, shares) <= 1e-15
    assert found.largest < 1e-9


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(bad: float) -> None:
    """Nothing is said of commands and ranges that are no finite numbers."""
    controls = np.zeros((4, 2))
    controls[2, 1] = bad
    with pytest.raises(Unenclosed):
        enclose(Every(), start(Every(), {"k": (0.9, 1.1)}, [0] * 4), controls, 1.0)
    with pytest.raises(Unenclosed):
        enclose(Every(), start(Every(), {"k": (0.9, bad)}, [0] * 4), np.zeros((4, 2)), 1.0)
