"""Among many pieces, only near ones are looked at closely; the bound is that of looking at all."""

from __future__ import annotations

import numpy as np
import pytest

from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.clearance import TIGHT, Prover
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.problem.evaluation.sampled import replay

TEXT = """
fleet:
  model: unicycle
  parameters: PARAMETERS
  start: {position: [0, 0], heading: 20 deg}
horizon: {duration: 4 s, steps: 16}
obstacles:
  field: BOXES
motions: MOTIONS
task: G avoid(field)
"""


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("parameters", "motions"),
    [
        ("{traction: {range: [0.8, 1.2]}}", "{}"),
        ("{traction: {range: [0.9, 1.1]}, start_x: {range: [-0.1, 0.1]}}", "{}"),
        ("{traction: {range: [0.9, 1.1]}}", "{field: {velocity: [0.3, -0.2]}}"),
    ],
)
def test_a_field_is_as_far_as_its_nearest_piece(parameters: str, motions: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-4, 4, (25, 2))
    corners = corners[np.linalg.norm(corners + 0.15, axis=1) > 0.7]
    boxes = [{"box": [[x, x + 0.3], [y, y + 0.3]]} for x, y in corners.tolist()]
    text = (
        TEXT.replace("PARAMETERS", parameters).replace("BOXES", str(boxes).replace("'", "")).replace("MOTIONS", motions)
    )
    problem = load_text(text)
    controls = rng.uniform([0, -1], [1, 1], (16, 2))
    [found] = certify(problem, controls).clearances
    prover = Prover(Flow.of(problem, controls), problem.fleet.names)
    spans, motion = Spans.whole(np.arange(16)), problem.motions.get("field")
    each = [prover.bound("field", piece, spans, 0.0, motion) for _, piece in problem.pieces]
    assert found.proven == pytest.approx(min(b.proven for b in each), abs=2 * TIGHT)
    assert found.sampled == pytest.approx(min(b.sampled for b in each), abs=2 * TIGHT)
    assert found.proven <= found.sampled + 1e-12
    closest = replay(problem, controls, members=300, substeps=20).clearances[0].distance
    assert found.proven <= closest
