"""Cards of problems, plans and errors for notebooks."""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.report.transform import conflict_places

from .plans import PROBLEMS, made

SVG = "{http://www.w3.org/2000/svg}"


def picture(card: str) -> ET.Element:
    """The drawing of a card, as XML."""
    (svg,) = re.findall(r"<svg.*?</svg>", card, re.DOTALL)
    return ET.fromstring(svg)


@pytest.mark.parametrize("kind", PROBLEMS)
def test_a_card_for_every_kind_of_plan(kind: str) -> None:
    plan = made(kind)
    for card in (plan.problem._repr_html_(), plan._repr_html_()):
        drawn = picture(card)
        names = [text.text for text in drawn.iter(f"{SVG}text")]
        assert set(plan.problem.regions) <= set(names)
        assert "nan" not in card
        assert "<script" not in card
        width, height = float(drawn.attrib["width"]), float(drawn.attrib["height"])
        for polygon in drawn.iter(f"{SVG}polygon"):
            for point in polygon.attrib["points"].split():
                x, y = map(float, point.split(","))
                assert -1 <= x <= width + 1
                assert -1 <= y <= height + 1


def test_what_moves_is_shown_at_its_end_and_on_its_way() -> None:
    drawn = picture(made("moving").problem._repr_html_())
    dotted = [element.tag.removeprefix(SVG) for element in drawn.iter() if "stroke-dasharray" in element.attrib]
    assert dotted == ["polyline", "polygon"]


def test_failures_are_ringed_where_they_are() -> None:
    plan = made("hit")
    assert len(list(picture(plan._repr_html_()).iter(f"{SVG}circle"))) == len(conflict_places(plan)) > 0
    post = plan.problem.obstacles["post"][0]
    for _, place in conflict_places(plan):
        assert post.distance(place[None])[0] < 0
    assert conflict_places(made("plain")) == []
    assert list(picture(made("plain")._repr_html_()).iter(f"{SVG}circle")) == []


def test_an_error_draws_its_plan() -> None:
    plan = made("hit")
    error = ec.SolveError("a < b fails", plan)
    card = error._repr_html_()
    assert card.startswith("<div><p><b>a &lt; b fails</b></p>")
    assert plan._repr_html_() in card
    assert ec.SolveError("nothing")._repr_html_() == "<div><p><b>nothing</b></p></div>"


def test_a_notebook_shows_the_card_in_place_of_a_traceback() -> None:
    kind = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell
    shell = kind.instance()
    from IPython.utils.capture import capture_output

    shell.user_ns["failure"] = ec.SolveError("no way around", made("hit"))
    with capture_output() as captured:
        shell.run_cell("raise failure")
    kind.clear_instance()
    shown = [output.data for output in captured.outputs if "text/html" in output.data]
    assert "<svg" in shown[0]["text/html"]
    assert "no way around" in captured.stdout + captured.stderr
    assert "Traceback" not in captured.stdout + captured.stderr


def test_cards_load_no_plotting_library() -> None:
    code = (
        "import sys, numpy as np, ensemble_ctrl as ec\n"
        "p = ec.load_text(sys.stdin.read())\n"
        "p._repr_html_(); plan = ec.Plan(p, np.zeros((40, 2)), 'infeasible'); plan._repr_html_()\n"
        "ec.SolveError('x', plan)._repr_html_()\n"
        "print([m for m in ('matplotlib', 'PIL', 'IPython', 'shapely') if m in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, input=PROBLEMS["plain"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
