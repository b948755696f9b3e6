"""The section on errors of the model: what it reads, what it refuses, and that plans keep it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.results import summary
from ensemble_ctrl.certificate import claim, differences
from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.report.text import summary_lines

TEXT = """fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0}
  uncertainty:
    disturbance: {position: 2 mm/s, heading: 0.1 deg/s, x: 0}
    actuators: {v: 1 %, omega: {share: 2 %, absolute: 0.5 deg/s}}
    quantisation: {v: 1 cm/s}
    varies: {traction: 0.5 %}
    delay: 50 ms
    jitter: 5 ms
    heading_hold: true
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1, 3], [-0.5, 0.5]]}}
obstacles: {block: {box: [[0.8, 1.2], [0.3, 0.5]]}}
task: F[3, 4] in(goal) and G avoid(block)
verify: {members: 50}
"""
STRAIGHT = np.array([[0.5, 0.0]] * 20)


def test_every_field_is_read_in_its_unit() -> None:
    bounds = ec.load_text(TEXT).fleet.uncertainty
    assert bounds.disturbance["position"] == 0.002
    assert bounds.disturbance["heading"] == pytest.approx(np.radians(0.1))
    assert dict(bounds.shares) == {"v": 0.01, "omega": 0.02}
    assert dict(bounds.actuators) == {"omega": pytest.approx(np.radians(0.5))}
    assert dict(bounds.quantisation) == {"v": 0.01}
    assert dict(bounds.varies) == {"traction": 0.005}
    assert (bounds.delay, bounds.jitter, bounds.heading_hold) == (0.05, 0.005, 1.0)


def test_what_is_written_back_is_the_same_claim(tmp_path: Path) -> None:
    problem = ec.load_text(TEXT)
    again = ec.load_text(dump(problem))
    assert again.fleet.uncertainty.data() == problem.fleet.uncertainty.data()
    assert ec.certify(again, STRAIGHT).inputs == ec.certify(problem, STRAIGHT).inputs
    plan = ec.Plan(problem, STRAIGHT, "planned", {})
    plan.save(tmp_path / "plan.npz")
    loaded = ec.Plan.load(tmp_path / "plan.npz")
    proof = loaded.certify()
    assert proof.uncertainty == problem.fleet.uncertainty.data()
    assert differences(json.loads(to_json(claim(ec.certify(problem, STRAIGHT)))), proof) == []


def test_a_claim_about_other_errors_is_seen() -> None:
    problem = ec.load_text(TEXT)
    proof = ec.certify(problem, STRAIGHT)
    for change in (Uncertainty(), problem.fleet.uncertainty.scaled(0.5)):
        other = ec.certify(problem.with_(fleet=problem.fleet.with_(uncertainty=change)), STRAIGHT)
        found = differences(json.loads(to_json(claim(other))), proof)
        assert any("inputs_sha256" in text for text in found)
        assert any("uncertainty" in text for text in found)
    forged = json.loads(to_json(claim(proof)))
    forged["uncertainty"]["delay"] = 0.5
    assert differences(forged, proof) == ["it says uncertainty.delay 0.5, computed again: 0.05"]


def test_replays_and_summaries_say_that_members_are_disturbed() -> None:
    plan = ec.Plan(ec.load_text(TEXT), STRAIGHT, "planned", {})
    run = plan.replay()
    assert run.disturbed
    assert not plan.replay(parameters=[{"traction": 1.0}]).disturbed
    told = ec.Plan(plan.problem, STRAIGHT, "planned", {}, run, plan.certify())
    assert summary(told)["replay"]["disturbed"] is True
    lines = " ".join(" ".join(summary_lines(told)).split())
    assert "50 members, each with a sampled disturbance" in lines
    assert "every disturbance within the bounds" in lines
    assert "v in steps of 0.01 m/s" in lines
    missed = "\n".join(summary_lines(ec.Plan(plan.problem, STRAIGHT, "infeasible", {})))
    assert "  try        smaller errors of the model (fleet.uncertainty), a longer horizon, " in missed


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "heading: 0.1 deg/s",
            "heading: 1 mm/s",
            r"5:46: error: fleet.uncertainty.disturbance.heading: expected a turn",
        ),
        ("varies: {traction", "varies: {tracton", r"fleet.uncertainty.varies.tracton: unknown name"),
        (
            "v: 1 %,",
            "v: 140 %,",
            r"fleet.uncertainty.actuators.v: expected a share up to 1, or a percentage, got '140 %'",
        ),
        (
            "jitter: 5 ms",
            "jitter: 150 ms",
            r"fleet.uncertainty.jitter: expected at most half a step, 0.1 s, got 0.15 s",
        ),
        ("delay: 50 ms", "delay: -1 s", r"fleet.uncertainty.delay: expected a time in s"),
        ("heading_hold: true", "heading_hold: 0 s", r"heading_hold: expected true, false, or a time above 0 .*'0 s'"),
        (
            "heading_hold: true",
            "heading_hold: maybe",
            r"heading_hold: expected true, false, or a time .*'maybe'",
        ),
        ("delay: 50 ms", "delay: 5 s", r"delay: expected at most the horizon, 4 s, got 5 s"),
        ("position: 2 mm/s", "position: 2 mm", r"expected a speed in m/s, cm/s or km/h, got '2 mm', which is a length"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(old: str, new: str, message: str) -> None:
    with pytest.raises(ec.ConfigError, match=message):
        ec.load_text(TEXT.replace(old, new))
