"""Small obstacles far from the origin are as large as near: coordinates of a map in metres of a national grid."""

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify

TEXT = """
fleet:
  model: unicycle
  parameters: {{traction: {{range: [0.99, 1.01]}}}}
  start: {{position: [0, {y}], heading: 0 deg, heading_from: x}}
horizon: {{duration: 4 s, steps: 8}}
obstacles: {{post: {{polygon: {corners}}}}}
task: G avoid(post)
"""


def straight(count: int, radius: float, y: float, beside: float) -> ec.Problem:
    """A regular polygon beside a way of 4 m along x."""
    angles = 2 * np.pi * np.arange(count) / count
    corners = np.array([2.0, y + beside]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return ec.load_text(TEXT.format(y=y, corners=corners.tolist()))


@pytest.mark.parametrize(
    ("count", "radius", "y", "beside"),
    [(24, 0.045, 5e6, 0.0), (24, 0.1, 1e7, 0.0), (6, 0.05, 5e6, 0.2477), (6, 0.05, 5e6, 0.0), (8, 0.01, 1e7, 0.1)],
)
def test_a_bound_is_never_above_the_distance_of_the_polygon_near_the_origin(
    count: int, radius: float, y: float, beside: float
) -> None:
    controls = np.column_stack([np.ones(8), np.zeros(8)])
    far = certify(straight(count, radius, y, beside), controls).clearances[0]
    near = certify(straight(count, radius, 0.0, beside), controls).clearances[0]
    assert far.proven <= near.sampled + 1e-8
    assert far.proven == pytest.approx(near.proven, abs=2e-5)
