"""A part of the campaign over later features, and its own robots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp

from ensemble_ctrl.certificate import apart, commands, disturbance, terrain
from ensemble_ctrl.certificate.bodies import Body
from tests.examples import quick

from .cases import FAMILIES, of_family
from .geometry import body_distance, distance
from .judge import judge
from .paths import driven, members_of, willful
from .run import judged
from .world import Errors, Featured

SEED, SIZE = 11, 8
SHAPES = {
    "triangle": ((1.0, 1.0), (2.0, 1.2), (1.1, 2.0)),
    "square": ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)),
}


@pytest.mark.parametrize("chunk", quick(range(6), 0))
def test_no_claim_about_later_features_is_false(chunk: int) -> None:
    found = judged(SEED, range(chunk * SIZE, (chunk + 1) * SIZE))
    assert [(index, case.base.family, one.faults) for index, case, one in found if one.faults] == []


def without(*names: str) -> Callable[..., Any]:
    """A change of `disturbance._Rates.of` that leaves some bounds out."""
    whole = disturbance._Rates.of.__func__  # type: ignore[attr-defined]

    def changed(cls: Any, *args: Any) -> Any:
        found = whole(cls, *args)
        for name in names:
            object.__setattr__(found, name, 0.0 * getattr(found, name))
        return found

    return changed


WHOLE, LEAST = Body.corners, apart._least
BROKEN: dict[str, tuple[str, object, str, Callable[..., Any]]] = {
    "pushes": ("drifting", disturbance._Rates, "of", without("drift")),
    "speeds": ("drifting", disturbance._Rates, "of", without("speed")),
    "headings": ("drifting", disturbance._Rates, "of", without("turn")),
    "early and late commands": ("drifting", disturbance._Rates, "of", without("speed_jumps")),
    "delays": ("drifting", disturbance, "_lags", lambda rates, step: np.zeros(len(rates.way))),
    "errors of signals": ("drifting", commands.Commands, "_errors", lambda self, names: np.zeros(self.flow.steps)),
    "terrain": ("drifting", terrain._Cell, "strays", lambda self, marks: np.zeros((2, marks.shape[1]))),
    "corners of bodies": ("bodies", Body, "corners", lambda self, n, s, c: _shrunk(WHOLE(self, n, s, c))),
    "distances": ("apart", apart, "_least", lambda here, there, n: LEAST(here, there, n) + 0.01),
}
"""What is taken out of the proof, and the family that has to notice."""
NEEDS: dict[str, Callable[[Featured], object]] = {
    "pushes": lambda case: case.errors.place,
    "speeds": lambda case: case.errors.first,
    "headings": lambda case: case.errors.heading,
    "early and late commands": lambda case: case.errors.jitter,
    "delays": lambda case: case.errors.delay,
    "terrain": lambda case: case.terrain,
}
"""Cases that can notice."""


def _shrunk(found: tuple[Any, Any]) -> tuple[Any, Any]:
    """Corners of a smaller body."""
    return 0.9 * found[0], 0.9 * found[1]


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_proof_of_a_later_feature_is_found_out(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    family, owner, attribute, changed = BROKEN[name]
    monkeypatch.setattr(owner, attribute, classmethod(changed) if attribute == "of" else changed)
    for index in range(400):
        rng = np.random.default_rng([SEED, index])
        case = of_family(family, rng)
        if NEEDS.get(name, bool)(case) and judge(case, rng).faults:
            return
    pytest.fail("no case noticed")


@pytest.mark.parametrize("family", ["bodies", "terrain", "drifting"])
def test_robots_without_errors_are_where_scipy_says(family: str) -> None:
    case = of_family(family, np.random.default_rng(3))
    object.__setattr__(case, "errors", Errors(heading=0.3, place=0.1))
    object.__setattr__(case, "terrain", {})
    rng, each = np.random.default_rng(4), 16
    members, will = members_of(case, rng, 1), willful(case, rng, 1, each)
    paths = driven(case, members, will, each)

    def rates(n: int) -> Callable[[float, Any], list[float]]:
        along, push, turn = will.along[0, n], 0.1 * will.push[0, n], 0.3 * will.turn[0, n]
        v, own = paths.rates["v"][0, n], paths.rates["omega"][0, n] - turn
        x, y = push * np.cos(along), push * np.sin(along)
        return lambda t, z: [v * np.cos(z[2]) + x, v * np.sin(z[2]) + y, own + turn]

    state = np.array([*paths.place[0, 0], paths.heading[0, 0]])
    for n, (begin, end) in enumerate(zip(paths.times[:-1], paths.times[1:], strict=True)):
        state = solve_ivp(rates(n), (begin, end), state, rtol=1e-10, atol=1e-12).y[:, -1]
    size = 1e-8 * (1 + np.abs(paths.place).max())
    assert paths.place[0, -1] == pytest.approx(state[:2], abs=size)
    assert paths.heading[0, -1] == pytest.approx(state[2], abs=1e-8)


@pytest.mark.parametrize("name", SHAPES)
def test_distances_are_those_of_shapely(name: str) -> None:
    rng, shape = np.random.default_rng(5), SHAPES[name]
    places, headings = rng.uniform(-4, 4, (200, 2)), rng.uniform(-4, 4, 200)
    footprint = np.array([[-0.5, -0.2], [1.0, -0.2], [0.8, 0.4], [-0.5, 0.3]])
    polygon = shapely.Polygon(shape)
    for place, heading, point, body in zip(
        places, headings, distance(shape, places), body_distance(shape, footprint, places, headings), strict=True
    ):
        c, s = np.cos(heading), np.sin(heading)
        moved = shapely.Polygon(place + footprint @ np.array([[c, s], [-s, c]]))
        assert max(point, 0.0) == pytest.approx(polygon.distance(shapely.Point(place)), abs=1e-12)
        assert max(body, 0.0) == pytest.approx(polygon.distance(moved), abs=1e-12)
        assert (body < 0) == bool(polygon.intersects(moved))


def test_every_family_draws_what_it_is_about() -> None:
    drawn = {name: [of_family(name, np.random.default_rng([SEED, k])) for k in range(12)] for name in FAMILIES}
    assert all(case.footprint for case in drawn["bodies"])
    assert all(case.starts for case in drawn["apart"])
    assert all(case.zones for case in drawn["zones"])
    assert all(case.terrain for case in drawn["terrain"])
    assert any(case.errors.delay for case in drawn["uncertain"])
    assert any(case.errors.hold for case in drawn["uncertain"])
