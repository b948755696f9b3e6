"""What charts show agrees with the replay and the certificate, which compute it another way."""

from __future__ import annotations

import numpy as np
import pytest

from ensemble_ctrl.report.convergence import descents
from ensemble_ctrl.report.pagecharts import Axes, Curve, chart, ticks
from ensemble_ctrl.report.series import by_parameter, over_time
from ensemble_ctrl.report.words import certificate_words, length

from .plans import PROBLEMS, made


@pytest.mark.parametrize("kind", ["plain", "several", "moving", "hit", "bicycle", "equal"])
def test_the_least_clearance_is_the_replays(kind: str) -> None:
    plan = made(kind)
    run = plan.replay(parameters=plan.problem.fleet.grid(600), substeps=2)
    least = min(values.min() for values in by_parameter(plan.problem, plan.controls).clearances.values())
    assert least == pytest.approx(min(c.distance for c in run.clearances), abs=2e-3)
    times, series = over_time(plan.problem, plan.controls)
    (closest,) = [s for s in series if s.name == "closest obstacle"]
    assert closest.low.min() == pytest.approx(least, abs=0.03)
    assert len(times) == plan.problem.steps + 1
    assert (closest.high >= closest.low).all()


@pytest.mark.parametrize("kind", [kind for kind in PROBLEMS if kind not in ("unproven", "mean")])
def test_no_curve_is_below_what_is_proven(kind: str) -> None:
    plan = made(kind)
    profile, certificate = by_parameter(plan.problem, plan.controls), plan.certificate
    assert certificate is not None
    for bound in certificate.clearances:
        if bound.obstacle in profile.clearances:
            assert profile.clearances[bound.obstacle].min() >= bound.proven - 1e-9
    for part in certificate.parts:
        assert profile.parts[part.part].min() >= part.proven - 1e-9


def test_a_window_is_looked_at_alone() -> None:
    plan = made("plain")
    _, series = over_time(plan.problem, plan.controls)
    (goal,) = [s for s in series if s.name == "in(goal)"]
    assert (goal.begin, goal.end) == (3.0, 4.0)
    assert goal.low[0] == pytest.approx(-2.0)


def test_words_name_what_is_claimed() -> None:
    plan = made("plain")
    words = certificate_words(plan.problem, plan.certificate)
    assert len(words.bounds) == 2
    assert "traction from 0.9 to 1.1, at every instant of the 4 s" in words.lead
    assert plan.certificate is not None
    assert length(plan.certificate.clearance) in words.bounds[0]


@pytest.mark.parametrize("metres", np.random.default_rng(3).lognormal(-3, 3, 200))
def test_a_length_never_says_more_than_is_proven(metres: float) -> None:
    number, unit = length(metres).split()
    said = float(number) * {"m": 1.0, "cm": 0.01, "mm": 0.001}[unit]
    assert 0.989 * metres <= said <= metres * (1 + 1e-8)


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-3e-5, 2e-5), (0.9, 1.1), (-5000, 12), (99.9, 100.2)])
def test_ticks_are_few_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 3 <= len(found) <= 7
    assert low - 1e-12 <= found[0] < found[-1] <= high + 1e-12
    assert np.ptp(np.diff(found)) < 1e-9 * (high - low) + 1e-12


def test_a_chart_breaks_its_line_where_there_is_no_value() -> None:
    values = np.array([1.0, 2.0, np.nan, 3.0, 4.0])
    drawn = chart(Axes("x", "y"), [Curve("<b>", np.arange(5.0), values, top=values + 1)], "label")
    assert drawn.count('class="area') == 2
    assert "nan" not in drawn
    assert "<b>" not in drawn


def test_what_is_no_table_of_iterations_is_passed_over() -> None:
    assert descents("") == ()
    assert descents("   7  1.0e+00 2.0e+00 3.0e+00 -1.0\nNumber of objective function evaluations = 12\n") == ()
