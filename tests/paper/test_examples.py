"""Numbers that the paper prints (Arias et al., One Ring to Rule Them All), through the public classes."""

import numpy as np
import pytest

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.moments import LegendreBasis


@pytest.mark.parametrize(
    ("k", "lower", "upper"),
    [
        (0, (-1.4142136, -2.8284271), (18.3847763, 2.8284271)),
        (1, (-8.5732141, -2.4494897), (8.5732141, 2.4494897)),
        (2, (-8.5201287, -2.4343225), (8.5201287, 2.4343225)),
    ],
)
def test_example_1_polyhedron(k: int, lower: tuple[float, ...], upper: tuple[float, ...]) -> None:
    region = Polyhedron(np.array([[2, 1], [0, 1]]), np.array([-1, -2]), np.array([13, 2]))
    low, high = region.moment_bounds(LegendreBasis(order=2))
    np.testing.assert_allclose(low[k], lower, atol=1e-6)
    np.testing.assert_allclose(high[k], upper, atol=1e-6)


def test_example_2_obstacle() -> None:
    block = Obstacle.box([[2, 6], [1, 3]])
    np.testing.assert_array_equal(block.A, [[1, 0], [0, -1], [-1, 0], [0, 1]])
    np.testing.assert_array_equal(block.b, [2, -3, -6, 1])
    bounds = block.big_m_bounds(LegendreBasis(order=2), M=20.0)
    np.testing.assert_allclose(bounds.lower[0], np.full(4, -28.2842712), atol=1e-6)
    np.testing.assert_allclose(bounds.switch, [28.2842712, 0, 0], atol=1e-6)
    np.testing.assert_allclose(bounds.upper[0], [31.1126984, 24.0416306, 19.7989899, 29.6984848], atol=1e-6)
