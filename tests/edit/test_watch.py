"""A search and a loop, live on a page."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli.watch import Steps, _plain
from ensemble_ctrl.planning.online.driver import drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.simulated import FINE
from ensemble_ctrl.planning.online.simulated_obstacles import SimulatedScene
from ensemble_ctrl.planning.online.step import Step
from tests.report.browser import Page, chromium

from .editor import PATIENCE, Editor, gone, served
from .test_page import BROWSER, asks_nobody, wait
from .test_view import needs_browser, visit

SMALL = """
name: small
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
  radius: 5 cm
horizon: {duration: 4 s, steps: 40}
regions: {goal: {box: [[1.5, 3], [-0.5, 0.5]]}}
obstacles: {post: {box: [[0.6, 1.0], [-0.2, 0.2]]}}
task: F[3, 4] in(goal) and G avoid(obstacles)
"""

CART = """
online:
  applied_steps: 5
  obstacles:
    cart:
      box: [[2.2, 2.5], [1.2, 1.5]]
      appears: 1 s
      vanishes: 3 s
      motion: {velocity: [0.2, 0.1], uncertainty: {position: 3 cm, speed: 3 cm/s}}
      seen_every: 1 s
      strays: towards
"""


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as page:
        page.screen(1280, 900)
        yield page


@pytest.fixture
def file(tmp_path: Path) -> Path:
    found = tmp_path / "small.yaml"
    found.write_text(SMALL, encoding="utf-8")
    return found


def watched(command: str, file: Path) -> Any:
    """The command with its page."""
    return served(command, str(file), "--watch", "--no-plots", "-o", str(file.parent / "out"), said_in="stderr")


def events(one: Editor, kind: str) -> list[dict[str, Any]]:
    """What a page that is opened now is told first."""
    return [event for event in one.state()["planned"] if event["kind"] == kind]


def until(one: Editor, kind: str) -> dict[str, Any]:
    """The first event of a kind."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if found := events(one, kind):
            return found[0]
        time.sleep(0.1)
    raise AssertionError(f"no event {kind}")


def page_of(one: Editor) -> int:
    """The process that serves the page."""
    (page,) = [pid for pid in one.children() if b"api.edit.watching" in Path(f"/proc/{pid}/cmdline").read_bytes()[:400]
               and b"ensemble_ctrl.cli" not in Path(f"/proc/{pid}/cmdline").read_bytes()]  # fmt: skip
    return page


def test_steps_say_what_the_loop_knows_and_every_place_once() -> None:
    problem = ec.load_text(SMALL)
    settings = problem.online or OnlineSettings()
    fleet = settings.simulated(problem)
    loop = Receding(problem, settings.options)
    steps, told = Steps(loop.problem), []
    outcome = drive(loop, fleet, fleet, listener=lambda step, _: told.append(steps(loop, step)))
    assert len(told) == len(loop.history)
    assert {event["proof"] for event in told} <= {"whole", "period", "none"}
    told.append(steps.end(loop, outcome))
    robot = next(iter(fleet.robots.values()))
    past = [place for event in told for one in event["robots"].values() for place in one["past"]]
    times = [place["time"] for place in past]
    assert times == pytest.approx([k * problem.step for k in range(problem.steps + 1)])
    # the true place of the simulated robot is within every circle
    lead = loop.options.lead(problem.step)
    for place in past[1:]:
        x, y = robot.track[round(place["time"] / problem.step + lead) * FINE][:2]
        assert ((x - place["at"][0]) ** 2 + (y - place["at"][1]) ** 2) ** 0.5 <= place["away"] + 1e-9
    json.dumps(_plain(told), allow_nan=False)


def test_what_moves_on_the_map_is_where_it_may_be() -> None:
    problem = ec.load_text(SMALL + CART)
    settings = problem.online
    assert settings is not None
    fleet, scene = settings.simulated(problem), SimulatedScene(settings.obstacles)
    loop = Receding(problem, settings.options)
    steps, told = Steps(loop.problem), []

    def advance(now: float) -> None:
        scene.advance(loop, now, np.array([robot.pose[:2] for robot in fleet.robots.values()]))

    def listen(step: Step, _: Any) -> None:
        latest = max(len(tracker.past) - 1 for tracker in loop.trackers.values()) * problem.step
        told.append((latest, steps(loop, step)["obstacles"]))

    drive(loop, fleet, fleet, listener=listen, scene=advance)
    here = [(time, found["cart"]) for time, found in told if "cart" in found]
    assert len(here) >= 3
    assert "cart" not in told[0][1]
    assert "cart" not in told[-1][1]
    truth = scene.obstacles["cart"].truth
    for moment, cart in here:
        assert 0.03 <= cart["away"] <= 0.09 + 1e-9
        (corners,) = cart["outlines"]["0,1"]
        away = np.min(corners, axis=0) - (np.array([2.2, 1.2]) + truth.at(moment))
        assert np.hypot(*away) <= cart["away"] + 1e-9
    # what is gone is drawn no more
    loop.remove_obstacle("post")
    assert steps._obstacles(loop)["post"]["outlines"] == {}
    json.dumps(_plain(steps._obstacles(loop)), allow_nan=False)


def test_what_is_not_finite_is_nothing() -> None:
    assert _plain({"a": [1.0, float("inf")], "b": {"c": float("nan")}, "d": (1, "x", None, True)}) == {
        "a": [1.0, None], "b": {"c": None}, "d": [1, "x", None, True],
    }  # fmt: skip


def test_a_page_that_is_opened_late_is_told_everything(file: Path) -> None:
    with watched("run", file) as one:
        until(one, "done")
        (plan,) = events(one, "plan")
        assert plan["verdict"].startswith("plan found, proven for every member")
        assert plan["class"] == "good"
        phases = [event["phase"] for event in events(one, "phase")]
        assert phases[0] == "guess"
        assert {"solve", "certify", "replay"} <= set(phases)
        (candidates,) = events(one, "candidates")
        assert [found["outcome"] for found in candidates["found"]].count("kept") == 1
        assert one.request("GET", "/api/state", token="no")[0] == 401
        assert one.request("POST", "/api/edit", {})[0] == 404
    assert json.loads((file.parent / "out" / "summary.json").read_text())["status"] == "planned"


def test_the_page_ends_with_the_command_however_it_ends(file: Path) -> None:
    with watched("run", file) as one:
        page = page_of(one)
        one.process.send_signal(signal.SIGKILL)
        one.process.wait(30)
        end = time.monotonic() + 30
        while not gone(page):
            assert time.monotonic() < end
            time.sleep(0.1)


def test_a_page_that_dies_is_no_reason_to_fail(file: Path) -> None:
    with watched("online", file) as one:
        os.kill(page_of(one), signal.SIGKILL)
        assert one.process.wait(PATIENCE) == 0
    assert (file.parent / "out" / "outcome.json").exists()


def test_no_browser_needs_a_page(file: Path) -> None:
    for command in ("run", "online"):
        done = subprocess.run(
            [sys.executable, "-m", "ensemble_ctrl.cli", command, str(file), "--no-browser"],
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip
        assert done.returncode == 2
        assert "--no-browser: expected --watch with it" in done.stderr


@needs_browser
def test_a_search_is_seen_with_its_candidates(tab: Page, file: Path) -> None:
    with watched("run", file) as one:
        visit(tab, one)
        wait(tab, "editor.part.plan !== null && document.querySelectorAll('#map .path').length === 15")
        wait(tab, "document.querySelectorAll('#map .candidate.kept').length === 1")
        assert tab.run("document.getElementById('verdict').textContent").startswith("Plan found, proven")
        wait(tab, "editor.part.done === true")
        assert "kept" in tab.run("document.querySelector('#shown table').textContent")
        asks_nobody(tab, one)


@needs_browser
def test_a_loop_is_seen_and_the_command_ends_with_its_last_page(tab: Page, file: Path) -> None:
    file.write_text(SMALL + CART.replace("      vanishes: 3 s\n", ""), encoding="utf-8")
    with watched("online", file) as one:
        visit(tab, one)
        wait(tab, "document.querySelectorAll('#map .may-be').length === 1")
        wait(tab, "editor.part.ending !== null")
        wait(tab, "document.querySelectorAll('#map .robot').length === 1")
        assert tab.run("document.getElementById('verdict').textContent") == "Success: done, and proven"
        assert tab.run("document.querySelectorAll('.proof.good').length === editor.part.steps.length")
        assert "traction" in tab.run("document.getElementById('shown').textContent")
        assert tab.run("document.querySelectorAll('#map .known').length") > 20
        tab.screen(390, 800, dark=True)
        assert tab.run("document.documentElement.scrollWidth") <= 390
        tab.screen(1280, 900)
        asks_nobody(tab, one)
        tab.visit("about:blank")
        assert one.process.wait(PATIENCE) == 0
