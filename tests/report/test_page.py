"""``report.html``: whole for every kind of plan, small, and inert whatever the problem says."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.html import report_html

from .plans import PROBLEMS, made

VOID = {"meta", "input", "br"}


class Reader(HTMLParser):
    """Elements in order, text by element, and whether every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: dict[str, list[str]] = {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.text.setdefault(self.open[-1], []).append(data)

    def all(self, kind: str) -> list[dict[str, str | None]]:
        """The attributes of the elements of a class."""
        return [a for _, a in self.elements if kind in (a.get("class") or "").split()]


def page(plan: Plan, log: str = "") -> str:
    return report_html(plan, PROBLEMS["plain"], {"command": ["ensemble-plan", "a<b.yaml"]}, log)


@pytest.mark.parametrize("kind", PROBLEMS)
def test_a_page_for_every_kind_of_plan(kind: str) -> None:
    plan = made(kind)
    text = page(plan)
    reader = Reader(text)
    assert reader.open == []
    assert len(text) < 300_000
    drawn = re.sub(r"<pre>.*?</pre>|<script.*</script>", "", text, flags=re.DOTALL)
    assert not re.findall(r"(?<![-\w])(nan|inf)(?![-\w])", drawn)
    titles = reader.text["h2"]
    assert titles[:3] == ["Map", "Certificate", "Controls"]
    assert "Robustness over time" in titles
    assert len([a for a in reader.all("level") if "bound" in (a["class"] or "")]) == 4
    assert len(reader.all("obstacle")) == len(plan.problem.obstacles)
    assert len(reader.all("region")) == len(plan.problem.regions)
    assert len(reader.all("tube")) == (12 if plan.problem.fleet.names else 1)


@pytest.mark.parametrize(
    ("kind", "verdict", "words"),
    [
        ("plain", "good", "Proven: every robot with traction from 0.9 to 1.1"),
        ("unproven", "open", "No certificate was asked for"),
        ("hit", "bad", "Refuted: the robot with traction"),
    ],
)
def test_the_verdict_is_the_plans(kind: str, verdict: str, words: str) -> None:
    text = page(made(kind))
    assert f'class="verdict {verdict}"' in text
    assert f"<p>{words}" in text


def test_text_of_the_problem_is_no_markup() -> None:
    text = page(made("script"))
    reader = Reader(text)
    assert text.count("<script") == 2
    assert [a.get("type") for tag, a in reader.elements if tag == "script"] == ["application/json", None]
    assert reader.text["h1"] == ["<script>alert(1)</script>"]
    assert "a<b.yaml" not in text
    assert "a&lt;b.yaml" in text


def test_nothing_is_loaded_and_only_this_script_may_run() -> None:
    text = page(made("plain"))
    reader = Reader(text)
    assert not [a for _, a in reader.elements if {"src", "href", "onload", "onclick"} & set(a)]
    assert "url(" not in text
    assert "@import" not in text
    (policy,) = [a["content"] for tag, a in reader.elements if a.get("http-equiv") == "Content-Security-Policy"]
    assert policy is not None
    assert policy.startswith("default-src 'none'; ")


def test_members_are_where_the_controls_bring_them() -> None:
    plan = made("moving")
    reader = Reader(page(plan))
    motion = json.loads(next(text for text in reader.text["script"] if text.startswith("{")))
    members = plan.problem.fleet.spread(15)
    paths = trajectories(plan.problem, plan.controls, members, 2)
    tracks = np.array(motion["members"], dtype=float) / 10
    assert (motion["duration"], motion["times"][-1]) == (4.0, 4.0)
    metres = paths[:, -1] - paths[:, 0]
    units = tracks[:, -1] - tracks[:, 0]
    scale = units[:, 0] / metres[:, 0]
    assert scale == pytest.approx(np.full(15, scale[0]), rel=2e-3)
    assert units[:, 1] == pytest.approx(-scale[0] * metres[:, 1], abs=0.2)
    assert np.array(motion["obstacles"]["cart"][-1]) / 10 == pytest.approx(scale[0] * np.array([0.8, -1.2]), abs=0.2)
    dots = [(float(a["cx"] or 0), float(a["cy"] or 0)) for a in reader.all("member")]
    assert np.array(dots) == pytest.approx(tracks[:, -1], abs=0.1)


def test_convergence_is_read_from_the_log() -> None:
    row = "{:4d}  {:.7e} 6.28e-02 5.09e+00  -2.0 0.00e+00    -  0.00e+00 0.00e+00   0"
    rows = [row.format(k, 9.0 - k) for k in (0, 1, 2, 3, 0, 1, 2)]
    log = "\n".join(["This is Ipopt", *rows])
    text = page(made("plain"), log)
    assert "Convergence" in Reader(text).text["h2"]
    assert "2 solves of IPOPT" in text
    assert "Convergence" not in Reader(page(made("plain"), "EXIT: nothing")).text["h2"]


def test_a_long_plan_is_a_small_page() -> None:
    plain = made("plain")
    problem = plain.problem.with_(steps=2000)
    plan = Plan(problem, np.repeat(plain.controls, 50, axis=0), "planned", {}, plain.replayed, plain.certificate)
    assert len(page(plan)) < 400_000


def test_the_wheel_has_the_pages_parts() -> None:
    import ensemble_ctrl.report as report

    folder = Path(report.__file__).parent
    assert {"page.html", "page.css", "page.js"} <= {path.name for path in folder.iterdir()}


def test_the_slider_says_the_time_and_not_a_thousandth() -> None:
    (slider,) = [a for tag, a in Reader(page(made("plain"))).elements if tag == "input"]
    assert slider["aria-valuetext"] == f"{made('plain').problem.duration:.2f} s"
