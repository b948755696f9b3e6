"""A small part of the campaign, what the page prints of the whole, and the campaign's own robots."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.examples import quick

from . import run
from .configs import FILES
from .controls import CONTROLS
from .judge import judge
from .robot import Adversary, Body, bounced, moved
from .scene import late, make
from .tables import page

CHUNKS, SIZE = 4, 4
UNCERTAIN = 5
"""Batches of five robots with errors of the model."""
LATE = 5
"""Batches of two whose commands may be late, and on terrain."""
QUICK = (
    "drift and errors of the model left out",
    "a held heading taken for exact",
    "half the noise",
    "the past where the robot is now",
)
"""Margins whose lack shows in a few loops."""


@pytest.mark.parametrize("chunk", quick(range(CHUNKS), 0))
def test_what_loops_say_is_so(chunk: int) -> None:
    for index in range(chunk * SIZE, (chunk + 1) * SIZE):
        judged = run.one(7, index).judged
        assert judged is None or judged.faults == (), f"loop 7:{index}"


@pytest.mark.parametrize("chunk", quick(range(UNCERTAIN), 0))
def test_what_loops_say_of_robots_with_errors_of_the_model_is_so(chunk: int) -> None:
    scenes = [scene for index in range(250) if (scene := make(7, index)).family == "uncertainty"]
    for scene in scenes[chunk * 5 : (chunk + 1) * 5]:
        judged = judge(scene)
        assert judged is not None
        assert judged.faults == (), scene


@pytest.mark.parametrize("chunk", quick(range(LATE), 0))
def test_what_loops_say_of_robots_that_are_late_or_on_terrain_is_so(chunk: int) -> None:
    for index in range(chunk * 2, chunk * 2 + 2):
        judged = judge(late(7, index))
        assert judged is None or judged.faults == (), index


def test_a_measurement_after_more_than_a_horizon_breaks_nothing() -> None:
    """The plan that is left keeps its length, whatever the horizon has moved by: the robot stops, or goes on proven."""
    judged = run.one(0, 1710).judged
    assert judged is not None
    assert judged.faults == ()
    assert judged.ending == "stopped" or (judged.ending == "success" and set(judged.proofs) == {"whole"})


@pytest.mark.parametrize("name", QUICK)
def test_a_loop_with_its_margin_taken_out_is_caught(name: str) -> None:
    assert run.caught(name, 0, 12) is not None


def test_the_page_prints_what_was_found() -> None:
    told = json.loads(run.RESULTS.read_text(encoding="utf-8"))
    assert page(told) in run.PAGE.read_text(encoding="utf-8")
    assert told["faults"] == []
    assert {path.stem for path in FILES} <= set(told["families"])
    assert set(told["controls"]) == set(CONTROLS)
    assert None not in told["controls"].values()


def test_robots_move_on_arcs() -> None:
    quarter = moved(np.zeros(3), np.pi / 2, np.pi / 2, 1.0)
    assert quarter == pytest.approx([1.0, 1.0, np.pi / 2])
    assert moved(np.zeros(3), 2.0, 0.0, 1.5) == pytest.approx([3.0, 0.0, 0.0])
    whole = moved(np.array([0.3, 0.2, 0.1]), 1.0, 1.0, 2 * np.pi)
    assert whole == pytest.approx([0.3, 0.2, 0.1 + 2 * np.pi])


def test_factors_drift_at_the_rate_and_within_their_range() -> None:
    errors = {"position": 0.0, "heading": 0.0, "drift": 0.1}
    for drift in ("up", "down", "back", "fall", "still"):
        body = Body(Adversary({"traction": 1.05}, drift), {"traction": (0.9, 1.1)}, errors, 0.1, np.zeros(3))
        values = np.array([body.parameter("traction", t) for t in np.arange(0.0, 5.0, 1e-3)])
        assert values.min() >= 0.9 - 1e-12
        assert values.max() <= 1.1 + 1e-12
        assert np.abs(np.diff(values)).max() <= 1e-4 + 1e-12
    assert bounced(1.0, 5.0, 1.0, 1.0) == 1.0


def test_scenes_are_made_again_from_their_numbers() -> None:
    assert make(3, 5) == make(3, 5)
    assert make(3, 5) != make(3, 6)
