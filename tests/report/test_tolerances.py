"""The bars of what a plan tolerates on its page."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from ensemble_ctrl.planning.tolerance import Tolerance, Tolerated
from ensemble_ctrl.report.html import report_html
from ensemble_ctrl.report.tolerances import MEASURED, tolerance_bars

from .plans import made
from .test_page import Reader

DRIFT = Tolerated("drift of the position", "m/s", 0.004, 0.0041, "post", 3.0, {"traction": 0.9}, 0.005)
SPEED = Tolerated("error of v", "", 0.01, 0.0102, "F[3,4] in(<goal>)", None, {})
TURN = Tolerated("error of omega", "", 0.04, None, "", None, {})
MIX = Tolerated("the errors of the problem, times", "", 0.5, 0.51, "post", 3.0, {}, 0.75)
FOUND = Tolerance((DRIFT, SPEED, TURN), MIX)


def widths(text: str) -> list[tuple[str, float]]:
    """The class and the width of each bar, in order."""
    return [(kind, float(width)) for kind, width in re.findall(r'<i(?: class="(.*?)")? style="width:(.*?)%"', text)]


def test_bars_of_one_unit_have_one_scale() -> None:
    # 4 of 5 mm/s; 1 of 4 %; 4 of 4 %; a mix below 1 on a scale to 1
    wanted = [("tried", 100.0), ("", 80.0), ("", 25.0), ("", 100.0), ("tried", 75.0), ("", 50.0)]
    assert widths(tolerance_bars(FOUND)) == wanted


def test_each_bar_says_its_bound_and_where_it_ends() -> None:
    text = tolerance_bars(FOUND)
    assert "<b>4 mm/s</b>" in text
    assert "then post at t = 3.00 s (traction 0.9); broken by an attack with 5 mm/s<" in text
    assert "then F[3,4] in(&lt;goal&gt;)<" in text
    assert "and more than that makes no sense<" in text
    assert "Red: neither proven nor broken" in text
    quiet = Tolerance((replace(DRIFT, broken=None),), replace(MIX, broken=None))
    assert "Red:" not in tolerance_bars(quiet)


def test_a_plan_that_is_not_proven_has_empty_bars() -> None:
    nothing = replace(DRIFT, bound=0.0, beyond=0.0, broken=None)
    found = Tolerance((nothing,), replace(MIX, bound=0.0, beyond=0.0, broken=None))
    assert widths(tolerance_bars(found)) == [("", 0.0), ("", 0.0)]


@pytest.mark.parametrize("measured", [True, False])
def test_the_page_shows_what_was_measured(measured: bool) -> None:
    plan = made("plain")
    plan = replace(plan, details={**plan.details, MEASURED: FOUND}) if measured else plan
    reader = Reader(report_html(plan, ""))
    assert reader.open == []
    assert ("Tolerated errors of the model" in reader.text["h2"]) is measured
    assert len(reader.all("bar")) == (4 if measured else 0)
