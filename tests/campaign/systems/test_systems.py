"""A small part of the campaign of systems; ``make campaign`` runs all of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.general import enclosure, models
from tests.paths import ROOT

from . import run
from .cases import make, of_family
from .judge import judge
from .oracle import along
from .twins import FILES, commands, disagreements, judged, twin

SEED, CHUNKS, SIZE, MEMBERS = 1000, 5, 4, 50


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_no_member_is_outside_and_no_claim_is_false(chunk: int) -> None:
    """1,000 triples of a system, a plan and a member in all."""
    found = run.some(SEED, range(chunk * SIZE, (chunk + 1) * SIZE), MEMBERS)
    assert [(line.index, line.judged.faults) for line in found if line.judged.faults] == []
    assert sum(bool(line.judged.reason) for line in found) <= 1


def less(whole: Callable[..., Any], share: float, *args: Any) -> Any:
    """A share of what a function returns."""
    return share * whole(*args)


BROKEN: dict[str, tuple[Any, str, str]] = {
    "no defect": (enclosure.Pieces, "defect", "drawn"),
    "a tenth of the radius": (enclosure, "radii", "drawn"),
    "sizes of models": (models.Model, "size", "drawn"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_enclosure_is_found_out(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Members are seen outside, so that the campaign could fail."""
    where, what, family = BROKEN[name]
    whole, share = getattr(where, what), 0.1 if "radius" in name else 0.0
    monkeypatch.setattr(where, what, lambda *args: less(whole, share, *args))
    rngs = (np.random.default_rng([SEED, index]) for index in range(12))
    assert any("outside" in str(judge(of_family(family, rng, 12), rng).faults) for rng in rngs)


def test_the_oracle_agrees_with_dop853() -> None:
    """At a relative tolerance of 1e-13, for some systems of every family."""
    for index in range(30):
        case = make(SEED, index, 1)
        psi = {name: np.full(1, value, dtype=np.longdouble) for name, value in case.system.parameters.items()}
        first = case.origin.astype(np.longdouble)[:, None]
        step = case.duration / len(case.controls)
        path, error = along(
            case.system, first, psi, case.controls, np.longdouble(step), np.ones(1, dtype=np.longdouble)
        )
        assert error < 1e-16
        x, numbers = case.origin, {name: float(value) for name, value in case.system.parameters.items()}
        for u in case.controls:
            rates = partial(_rates, case.system, u.tolist(), numbers)
            x = solve_ivp(rates, (0.0, step), x, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        assert x == pytest.approx(path[-1, -1, :, 0].astype(float), rel=1e-9, abs=1e-9)


def _rates(system: Any, u: list[float], psi: dict[str, float], _: float, x: Any) -> Any:
    """The right-hand side as an array."""
    return np.array(system.xdot(list(x), u, psi), dtype=float)


@pytest.mark.parametrize("name", ["fleets/bicycle", "fleets/uncertain_start", "risk/share", "distributions/measured"])
def test_both_enclosures_of_arcs_hold_each_other(name: str) -> None:
    """``python -m tests.campaign.systems.twins`` takes all problem files."""
    path = ROOT / "configs" / f"{name}.yaml"
    assert path in FILES
    assert judged(path) == []


def test_enclosures_of_other_arcs_do_not_hold_each_other() -> None:
    """Robots that drive 1 % faster are told apart."""
    problem = ec.load(ROOT / "configs" / "three_obstacles.yaml")
    controls = commands(problem)
    faster = ec.certify(twin(problem), controls * [1.01, 1.0])
    assert list(disagreements(ec.certify(problem, controls), faster)) != []


def test_the_page_prints_what_was_found() -> None:
    told = json.loads(run.RESULT.read_text(encoding="utf-8"))
    assert run.page(told) in run.PAGE.read_text(encoding="utf-8")
    whole = told["families"]["all"]
    assert whole["faulty"] == 0
    assert whole["triples"] >= 20_000
    assert whole.get("no enclosure", 0) <= run.OPEN * whole["cases"]
