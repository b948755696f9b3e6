"""Which of several members is named as the worst."""

from __future__ import annotations

import numpy as np

from ensemble_ctrl.certificate.bound import last_lowest


def test_rounding_does_not_choose_among_members_that_are_equally_low() -> None:
    """Members alike but for a rounding, which another machine has elsewhere."""
    assert last_lowest(np.array([0.5 - 1e-15, 0.5, 0.7])) == last_lowest(np.array([0.5, 0.5 - 1e-15, 0.7])) == 1
    assert last_lowest(np.array([0.4, 0.5])) == 0


def test_members_without_a_value_are_not_the_lowest() -> None:
    """Nothing is known of them."""
    assert last_lowest(np.array([np.nan, 0.5, 0.7])) == 1
    assert last_lowest(np.array([np.nan, np.nan])) in (0, 1)
