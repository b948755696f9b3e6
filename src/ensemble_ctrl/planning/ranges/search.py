"""The largest number that works, by growth and bisection."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil

GROWTH = 1.5
"""Factor by which a number grows until it does not work."""

NEARER = 0.4
"""Where between one that works and one that does not the next is tried."""


def grown(good: float) -> float:
    """The number to try above one that works."""
    return good * GROWTH


def largest(
    works: Callable[[float], bool],
    first: float,
    limit: float,
    tolerance: float,
    *,
    whole: bool = False,
    above: Callable[[float], float] = grown,
) -> tuple[float, float]:
    """Bracket the largest number that works, where all smaller ones do, too.

    Parameters
    ----------
    works : callable
        Called with each number tried, once.
    first : float
        The number tried first, above 0 and at most `limit`; halved until one works, or grown until one does not.
    limit : float
        No larger number is tried.
    tolerance : float
        How far apart the two results may be; numbers up to half of it are not tried.
    whole : bool
        Whether only whole numbers are tried; the others are then whole, too.
    above : callable
        The next number to try above the largest one that worked, which is larger; between that and one that did not
        work, a nearer one may be tried.

    Returns
    -------
    good, bad : float
        The largest number that worked, 0 without any, and the smallest above it that did not; both are `limit` where
        that worked.

    Examples
    --------
    >>> good, bad = largest(lambda x: x <= 10, 1.0, 100.0, 0.5)
    >>> good <= 10 < bad <= good + 0.5
    True
    >>> largest(lambda x: x <= 7, 8, 32, 1, whole=True)
    (7, 8)
    """
    rounded: Callable[[float], float] = ceil if whole else float
    bad, tried = float("inf"), first
    # bracket: halved until one works, or grown by GROWTH until one does not
    while not works(tried):
        bad, tried = tried, tried // 2 if whole else tried / 2
        if tried <= tolerance / 2:
            return 0.0, bad
    good = tried
    while bad > limit and good < limit:
        tried = min(rounded(above(good)), limit)
        good, bad = (tried, bad) if works(tried) else (good, tried)
    bad = min(bad, limit)
    # bisection to the tolerance, nearer to what worked: a number that does not work costs more to try
    while bad - good > tolerance:
        middle = rounded(min(above(good), good + NEARER * (bad - good)))
        good, bad = (middle, bad) if works(middle) else (good, middle)
    return good, bad
