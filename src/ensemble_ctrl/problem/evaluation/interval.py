"""The interval of a share, from a count."""

from __future__ import annotations

import math


def wilson(kept: int, count: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval for a share of which `kept` of `count` independent draws are; (0, 1) without any.

    Parameters
    ----------
    kept, count : int
        Draws that are of the share, and all of them.
    z : float
        Standard deviations of the normal distribution: 1.96 for a confidence of 95 %.

    Notes
    -----
    E. B. Wilson, Probable inference, the law of succession, and statistical inference, 1927.

    Examples
    --------
    >>> [round(end, 4) for end in wilson(100, 100)]
    [0.963, 1.0]
    """
    if not count:
        return 0.0, 1.0
    # Wilson 1927: (p + z^2 / 2n +- z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)
    p = kept / count
    middle, spread = p + z**2 / (2 * count), z * math.sqrt(p * (1 - p) / count + z**2 / (4 * count**2))
    scale = 1 + z**2 / count
    return max(0.0, (middle - spread) / scale), min(1.0, (middle + spread) / scale)
