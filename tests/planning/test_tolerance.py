"""How much error of the model a plan tolerates, and plans that tolerate most."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.planning.tolerance import measure
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.uncertainty import Uncertainty
from tests.certificate.test_disturbance import CONTROLS, problem

PLAIN = problem(Uncertainty())
"""A problem whose clearance is about 14 cm."""


def proven(whole: Problem, bounds: Uncertainty) -> bool:
    """Whether the plan is proven with other errors."""
    return ec.certify(whole.with_(fleet=whole.fleet.with_(uncertainty=bounds)), CONTROLS).proven == "yes"


def test_each_bound_is_the_largest_that_is_proven() -> None:
    found = measure(PLAIN, CONTROLS)
    by_name = {one.kind: one for one in found.kinds}
    assert str(found).startswith("proven with errors of the model up to\n  drift of the position ")
    assert len(str(found).splitlines()) == len(found.kinds) + 2
    made: dict[str, Callable[[float], Uncertainty]] = {
        "drift of the position": lambda b: Uncertainty({"position": b}),
        "error of the turn rate": lambda b: Uncertainty({"heading": b}),
        "error of v": lambda b: Uncertainty(shares={"v": b}),
        "traction that varies": lambda b: Uncertainty(varies={"traction": b}),
        "delay": lambda b: Uncertainty(delay=b),
    }
    for name, bounds in made.items():
        one = by_name[name]
        assert one.beyond is not None
        assert one.bound < one.beyond <= 1.03 * one.bound
        assert proven(PLAIN, bounds(one.bound))
        assert not proven(PLAIN, bounds(one.beyond))
        assert one.ends
    # a drift of w for t seconds takes w t from the clearance at t
    drift = by_name["drift of the position"]
    least = ec.certify(PLAIN, CONTROLS).clearances[0]
    assert drift.bound * drift.time >= 0.9 * least.proven  # type: ignore[operator]
    assert 0 < found.mix.bound < 1


def test_the_errors_of_a_problem_are_scaled_together() -> None:
    own = Uncertainty({"position": 0.004, "heading": 0.004}, heading_hold=1.0)
    whole = PLAIN.with_(fleet=PLAIN.fleet.with_(uncertainty=own))
    found = measure(whole, CONTROLS).mix
    assert found.bound > 1
    assert proven(PLAIN, own.scaled(found.bound))
    assert not proven(PLAIN, own.scaled(found.beyond or np.inf))


def test_a_plan_that_is_not_proven_tolerates_nothing() -> None:
    found = measure(PLAIN, 0 * CONTROLS)
    assert all(one.bound == 0 for one in (*found.kinds, found.mix))


def test_an_attack_needs_more_than_is_tolerated() -> None:
    found = measure(PLAIN.with_(fleet=PLAIN.fleet.with_(parameters={})), CONTROLS, attacked=True)
    drift = found.kinds[0]
    assert drift.broken is not None
    assert drift.bound < drift.broken < 1.35 * drift.bound


SMALL = """
fleet: {model: unicycle, parameters: {traction: {range: [0.95, 1.05]}}, start: {position: [0, 0], heading: 0}}
horizon: {duration: 6 s, steps: 30}
regions: {goal: {box: [[2.5, 3.5], [-0.5, 0.5]]}}
obstacles: {post: {box: [[1.2, 1.6], [-0.5, 0.1]]}}
task: F[5,6] in(goal) and G avoid(obstacles)
objective: {tolerance: {disturbance: {position: 5 mm/s}}}
verify: {members: 100}
"""


def test_a_plan_that_is_to_tolerate_most() -> None:
    whole = ec.load_text(SMALL)
    found = ec.plan(whole)
    assert found.verified
    scale = found.details["tolerance"]["scale"]
    assert found.problem.fleet.uncertainty.disturbance["position"] == pytest.approx(0.005 * scale)
    assert found.problem.objective.tolerance is None
    plain = ec.plan(whole.with_(objective=ec.Objective()))
    alone = measure(plain.problem, plain.controls).kinds[0]
    assert 0.005 * scale > 2 * alone.bound
    missed = found.details["tolerance"]["missed"]
    assert missed is None or scale < missed <= 1.2 * scale


def test_what_a_file_can_ask_for() -> None:
    with pytest.raises(ec.ConfigError, match=r"objective.tolerance: expected errors of the model, got none"):
        ec.load_text(SMALL.replace("position: 5 mm/s", "position: 0"))
    with pytest.raises(ec.ConfigError, match=r"objective.tolerance.disturbance.positon: unknown name"):
        ec.load_text(SMALL.replace("position: 5 mm/s", "positon: 5 mm/s"))
    with pytest.raises(ec.ConfigError, match=r"expected verify.certificate: true"):
        ec.load_text(SMALL.replace("members: 100", "certificate: false"))


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ensemble_ctrl.cli.tolerance import measure_plan

    plan = ec.Plan(PLAIN, CONTROLS, "planned", {})
    plan.save(tmp_path / "plan.npz")
    assert measure_plan(tmp_path / "plan.npz", False, tmp_path / "bars.png", False, True, False) == 0
    with pytest.raises(ec.EnsembleError, match=r"^--chart: expected a name that ends .* or .svg, got 'b.doc'$"):
        measure_plan(tmp_path / "plan.npz", False, tmp_path / "b.doc", False, True, False)
    assert "drift of the position" in capsys.readouterr().out
    assert (tmp_path / "bars.png").stat().st_size > 5_000
    assert measure_plan(tmp_path / "plan.npz", False, None, True, True, False) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["kinds"][0]["unit"] == "m/s"
