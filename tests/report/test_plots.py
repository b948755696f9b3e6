"""Pictures by their kind: what is in them, units on every axis, and legible in a column of a paper."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from ensemble_ctrl import report
from ensemble_ctrl.api.planning import with_baseline
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.folder import result_files
from ensemble_ctrl.moments import LegendreBasis
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report import palette
from ensemble_ctrl.report.canvas import FORMATS
from ensemble_ctrl.report.figures import write_figures
from ensemble_ctrl.report.kinds.certificate import draw_certificate
from ensemble_ctrl.report.kinds.moments import moments
from ensemble_ctrl.report.plot import KINDS, write_plot
from tests.examples import quick

from .plans import made


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", quick(["plain", "several", "equal", "hit", "moving", "unbounded", "mean"], "several", "equal", "moving")
)
def test_every_picture_of_every_plan(name: str, kind: str) -> None:
    ax = Figure().subplots()
    assert made(name).plot(kind, ax=ax) is ax
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.canvas.draw()
    shown = ax.child_axes if kind in ("controls", "moments") else [ax]
    for axes in shown:
        assert "[" in axes.get_ylabel() or kind == "certificate"
    assert "[" in shown[-1].get_xlabel() or (name == "equal" and kind == "clearance")


@pytest.mark.parametrize("kind", KINDS)
def test_dollars_in_names_are_dollars(kind: str, tmp_path: Path) -> None:
    plain = made("plain")
    problem = plain.problem
    odd = problem.with_(
        name="$x^$",
        obstacles={**problem.obstacles, "$o^$": problem.obstacles["post"]},
        regions={**problem.regions, "$r^$": problem.regions["goal"]},
    )
    plan = replace(plain, problem=odd)
    ax = Figure().subplots()
    plan.plot(kind, ax=ax)
    assert r"\$x^\$" in ax.get_title()
    write_plot(plan, kind, tmp_path / "x.png")
    if kind == "trajectories":
        names = write_figures(odd, plan.controls, tmp_path)
        assert set(names) == set(os.listdir(tmp_path)) - {"x.png"}


def test_another_kind_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"expected one of trajectories, controls, .*, got 'moment'"):
        made("plain").plot("moment", ax=Figure().subplots())


def test_a_plan_without_a_certificate_is_certified_for_its_picture() -> None:
    ax = made("unproven").plot("certificate", ax=Figure().subplots())
    assert [t.get_text() for t in ax.get_yticklabels()] == ["avoid(post)", "F[3,4] in(goal)"]


def test_bars_are_as_long_as_what_is_proven() -> None:
    plan = made("hit")
    assert plan.certificate is not None
    ax = plan.plot("certificate", ax=Figure().subplots())
    lengths = sorted(bar.get_width() for bar in ax.patches)  # type: ignore[attr-defined]
    bounds = [b.proven for b in plan.certificate.clearances] + [b.proven for b in plan.certificate.parts]
    assert lengths == pytest.approx(sorted(bounds))


@pytest.mark.parametrize(
    "bounds", [(0.01, 2.0), (0.0002, 0.03, 5.0), (-0.3, 0.004, 1.0), (-2.0, -0.01), (0.5, 2.0), (0.0, 1.0)]
)
def test_the_tightest_bound_is_seen_beside_the_widest(bounds: tuple[float, ...]) -> None:
    """Every bar but that of zero takes a tenth of the axis or more, with its end and its number inside."""
    certificate = made("plain").certificate
    assert certificate is not None
    (first, *_) = certificate.clearances
    several = tuple(replace(first, obstacle=f"o{k}", proven=v, sampled=v + 1e-3) for k, v in enumerate(bounds))
    ax = draw_certificate("p", replace(certificate, clearances=several, parts=()), Figure().subplots(), {})
    to_share = ax.transData + ax.transAxes.inverted()
    zero = to_share.transform((0.0, 0.0))[0]
    for bound in bounds:
        end = to_share.transform((bound, 0.0))[0]
        assert abs(end - zero) >= 0.1 or bound == 0
        assert 0 <= end <= 0.9
    spread = max(map(abs, bounds)) > 10 * min(abs(b) for b in bounds if b)
    assert ("log" in ax.get_xlabel()) == (spread or 0.0 in bounds)


def brightness(colour: str) -> float:
    """Relative luminance of ``#rrggbb`` (WCAG 2.1)."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def contrast(first: str, second: str) -> float:
    """Contrast ratio of two colours (WCAG 2.1)."""
    low, high = sorted((brightness(first), brightness(second)))
    return (high + 0.05) / (low + 0.05)


TEXT = [
    ("on-obstacle", "obstacle"),
    ("soft", "card"),
    ("soft", "ground"),
    ("ink", "card"),
    ("ink", "ground"),
    ("region", "card"),
    ("patch-edge", "card"),
    *((name, f"{name}-ground") for name in ("good", "bad", "open")),
]


@pytest.mark.parametrize(("text", "ground"), TEXT)
def test_text_on_the_page_can_be_read_in_both_schemes(text: str, ground: str) -> None:
    style = (Path(report.__file__).parent / "drawing.css").read_text(encoding="utf-8")
    light, dark = (dict(re.findall(r"--([\w-]+): (#\w{6})", part)) for part in style.split("@media (prefers-color", 1))
    assert contrast(light[text], light[ground]) >= 4.5
    assert contrast(dark[text], dark[ground]) >= 4.5


def test_names_on_obstacles_can_be_read_in_pictures_and_films() -> None:
    assert contrast(palette.ON_OBSTACLE, palette.OBSTACLE) >= 4.5
    ax = made("plain").plot("trajectories", ax=Figure().subplots())
    (name,) = [text for text in ax.texts if text.get_text() == "post"]
    assert name.get_color() == palette.ON_OBSTACLE
    assert contrast(palette.SOFT, "#ffffff") >= 4.5
    assert contrast(palette.REGION, "#ffffff") >= 4.5
    assert contrast(palette.PATCH_EDGE, "#ffffff") >= 4.5


def test_moments_are_integrals_of_exact_trajectories() -> None:
    plan = made("plain")
    s, w = np.polynomial.legendre.leggauss(40)
    paths = trajectories(plan.problem, plan.controls, 1.0 + 0.1 * s)
    phi = LegendreBasis(3).evaluate(s)
    found = dict(moments(plan.problem, plan.controls))
    assert list(found) == ["m_{0}", "m_{1}", "m_{2}", "m_{3}"]
    for k, values in enumerate(found.values()):
        assert values == pytest.approx(np.einsum("n,ntd->td", w * phi[:, k], paths), abs=1e-12)


@pytest.mark.parametrize("name", ["several", "equal", "bicycle", "spread"])
def test_the_first_moment_is_the_mean(name: str) -> None:
    plan = made(name)
    fleet = plan.problem.fleet
    _, first = next(iter(moments(plan.problem, plan.controls)))
    members = fleet.sample(40_000, 1)
    members = members if len(fleet.names) else np.zeros((1, 0))
    mean = trajectories(plan.problem, plan.controls, members).mean(axis=0)
    assert first / np.sqrt(2.0) == pytest.approx(mean, abs=0.004)


def test_the_unconstrained_fleet_is_dashed_and_the_plan_solid() -> None:
    plan = with_baseline(made("hit"))
    assert plan.baseline is not None
    ax = plan.plot(ax=Figure().subplots())
    dashed = [line for line in ax.lines if line.get_linestyle() == "--"]
    assert len(dashed) == 11
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["unconstrained"]  # type: ignore[union-attr]
    assert any(len(c.get_segments()) == 21 for c in ax.collections if hasattr(c, "get_segments"))


@pytest.mark.parametrize("name", quick(["plain", "unbounded", "long"], "long"))
@pytest.mark.parametrize("kind", KINDS)
def test_a_column_of_a_paper(kind: str, name: str, tmp_path: Path) -> None:
    path = write_plot(made(name), kind, tmp_path / "a.png")
    picture = Image.open(path)
    assert picture.width == 1050  # 3.5 in of 300 dots
    dark = np.asarray(picture.convert("L")) < 128
    assert dark.any()
    assert not dark[:, :3].any()  # nothing is cut off at the sides
    assert not dark[:, -3:].any()
    assert not dark[-3:].any()
    assert not dark[:3].any()


@pytest.mark.parametrize("format", FORMATS)
def test_formats(format: str, tmp_path: Path) -> None:
    path = write_plot(made("plain"), "moments", tmp_path / "a", format)
    begin = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[format]
    assert path.read_bytes().startswith(begin)


def test_fonts_are_not_smaller_than_a_paper_allows(tmp_path: Path) -> None:
    from matplotlib import rc_context
    from matplotlib.text import Text

    from ensemble_ctrl.report.canvas import PAPER

    for kind in KINDS:
        with rc_context(PAPER):
            ax: Axes = Figure().subplots()
            made("plain").plot(kind, ax=ax)
            assert min(float(text.get_fontsize()) for text in ax.findobj(Text)) >= 5.5


def test_what_plot_writes_may_be_overwritten() -> None:
    assert {f"figure-{kind}.{ending}" for kind in KINDS for ending in FORMATS} <= result_files()
