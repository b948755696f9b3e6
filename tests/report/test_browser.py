"""``report.html`` in a real browser, where one is installed."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ensemble_ctrl.report.html import report_html

from .browser import Page, chromium, executable
from .plans import PROBLEMS, made, ode_made

BROWSER = executable()
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no headless Chromium here")
MOVE = "(() => {{ const s = document.getElementById('time'); s.value = {}; s.dispatchEvent(new Event('input')); }})()"
PLACES = "[...document.querySelectorAll('.member')].map(d => [+d.getAttribute('cx'), +d.getAttribute('cy')])"


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None
    with chromium(BROWSER) as page:
        yield page


def write(kind: str, folder: Path) -> Path:
    plan = made(kind)
    path = folder / f"{kind}.html"
    path.write_text(report_html(plan, PROBLEMS[kind]), encoding="utf-8")
    return path


def pixels(tab: Page) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(tab.picture())).convert("RGB")).astype(int)


def test_the_slider_and_the_button_move_the_fleet(tab: Page, tmp_path: Path) -> None:
    tab.complaints.clear()
    tab.requests.clear()
    tab.screen(1200, 900)
    path = write("moving", tmp_path)
    tab.open(path)
    end = np.array(tab.run(PLACES))
    assert tab.run("document.getElementById('clock').textContent") == "t = 4.00 s"
    assert tab.run("document.getElementById('time').getAttribute('aria-valuetext')") == "4.00 s"
    tab.run(MOVE.format(0))
    start = np.array(tab.run(PLACES))
    assert tab.run("document.getElementById('clock').textContent") == "t = 0.00 s"
    assert tab.run("document.getElementById('time').getAttribute('aria-valuetext')") == "0.00 s"
    assert np.ptp(start, axis=0).max() < 0.2  # all start at one place
    assert (end[:, 0] - start[:, 0]).min() > 100
    tab.run(MOVE.format(500))
    middle = np.array(tab.run(PLACES))
    assert middle[:, 0] == pytest.approx((start[:, 0] + end[:, 0]) / 2, abs=6)
    tab.run(MOVE.format(505))  # between two of the times that the page holds
    assert (np.array(tab.run(PLACES))[:, 0] > middle[:, 0]).all()
    tab.run(MOVE.format(500))
    moved = tab.run("document.querySelector('[data-moves]').getAttribute('transform')")
    assert moved.startswith("translate(")
    assert tab.run("[...document.querySelectorAll('.cursor')].every(c => c.getAttribute('x1') === '253.0')")
    tab.run("document.getElementById('play').click()")
    assert tab.run("document.getElementById('play').textContent") == "Pause"
    tab.run("new Promise(done => setTimeout(done, 400))")
    later = np.array(tab.run(PLACES))
    assert (later[:, 0] > middle[:, 0]).all()
    tab.run("document.getElementById('play').click()")
    assert tab.run("document.getElementById('play').textContent") == "Play"
    assert tab.complaints == []
    assert tab.requests == [path.resolve().as_uri()]


def test_a_script_in_a_name_does_nothing(tab: Page, tmp_path: Path) -> None:
    tab.complaints.clear()
    tab.open(write("script", tmp_path))
    assert tab.run("document.querySelector('h1').textContent") == "<script>alert(1)</script>"
    assert tab.run("document.querySelectorAll('script').length") == 2
    tab.run("document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"window.hit = 1\">')")
    tab.run("new Promise(done => setTimeout(done, 100))")
    assert tab.run("window.hit === undefined")  # the page's policy, should an escape ever be missing


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark(tab: Page, tmp_path: Path, dark: bool) -> None:
    tab.screen(1200, 900, dark)
    tab.open(write("plain", tmp_path))
    shown = pixels(tab)
    corner = shown[2, 2]
    assert (corner.max() < 60) if dark else (corner.min() > 230)
    box = tab.run("(({x, y}) => [x, y])(document.querySelector('.obstacle').getBoundingClientRect())")
    x, y = round(box[0] + 6), round(box[1] + 6)
    assert np.ptp(shown[y, x]) < 25  # an obstacle is grey
    assert 60 < shown[y, x].mean() < 190
    ink = tab.run("getComputedStyle(document.querySelector('dd')).color")
    light = [int(part) for part in ink[4:-1].split(",")]
    assert (min(light) > 200) if dark else (max(light) < 60)


@pytest.mark.parametrize("kind", ["several", "hit", "bicycle"])
def test_a_phone_needs_no_scrolling_sideways(tab: Page, tmp_path: Path, kind: str) -> None:
    tab.complaints.clear()
    tab.screen(390, 800)
    tab.open(write(kind, tmp_path))
    assert tab.run("document.documentElement.scrollWidth") <= 390
    sizes = tab.run(
        "[...document.querySelectorAll('main svg text')].map(t => t.getBoundingClientRect())"
        ".map(r => Math.max(r.width, r.height))"
    )
    assert min(sizes) > 7
    assert tab.complaints == []


@pytest.mark.parametrize("width", [1200, 390])
def test_the_slider_moves_the_fleet_in_every_view(tab: Page, tmp_path: Path, width: int) -> None:
    tab.complaints.clear()
    tab.screen(width, 900)
    path = tmp_path / "space.html"
    path.write_text(report_html(ode_made("space"), ""), encoding="utf-8")
    tab.open(path)
    end = np.array(tab.run(PLACES))
    tab.run(MOVE.format(0))
    start = np.array(tab.run(PLACES))
    assert len(start) == 30
    assert np.ptp(start[:15], axis=0).max() < 0.2
    assert np.ptp(start[15:], axis=0).max() < 0.2
    assert (end[:, 0] - start[:, 0]).min() > 100
    assert end[:15, 0] == pytest.approx(end[15:, 0], abs=0.2)  # both views have one scale
    assert tab.run("document.documentElement.scrollWidth") <= width
    assert tab.complaints == []
