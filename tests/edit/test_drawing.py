"""A plan as the page draws it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ensemble_ctrl.api.edit.drawing import drawing
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.problem.evaluation.sampled import replay

AHEAD = """\
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[3, 5], [-0.5, 0.5]]}}
obstacles: {block: {box: [[1.5, 2], [%s, 1]]}}
task: F[3, 4] in(goal) and G avoid(block)
verify: {members: 50}
"""


def driven(low: float) -> Plan:
    """Straight ahead, past a block or through it."""
    problem = load_text(AHEAD % low)
    controls = np.tile([1.0, 0.0], (20, 1))
    return Plan(problem, controls, "planned", {}, replay(problem, controls), certify(problem, controls))


def test_a_proven_plan_is_drawn_in_metres_as_strict_json() -> None:
    found = json.loads(json.dumps(drawing(driven(0.2)), allow_nan=False))
    (view,) = found["views"]
    ways = np.array(view["ways"])
    assert found["proven"]
    assert found["class"] == "good"
    assert ways.shape == (15, len(found["times"]), 2)
    assert ways[0, 0].tolist() == [0, 0]
    assert ways[:, -1, 0].min() == pytest.approx(3.6)
    assert ways[:, -1, 0].max() == pytest.approx(4.4)
    rings = np.concatenate([np.array(ring) for slice_ in view["tube"] for ring in slice_["rings"]])
    assert rings[:, 0].max() >= 4.4
    assert view["counter"] is None
    assert view["marks"] == []


def test_what_violates_the_task_is_drawn_with_its_place() -> None:
    found = drawing(driven(-1))
    (view,) = found["views"]
    assert not found["proven"]
    assert found["class"] == "bad"
    x, y = view["counter"]["at"]
    assert 1.5 <= x <= 2
    assert y == 0
    assert "block" in view["counter"]["text"]
    assert view["marks"]
