"""What ends a proof without a bound."""

from __future__ import annotations


class Unenclosed(ArithmeticError):
    """No enclosure of a system can be given; the message says why, and the verdict is "undecided"."""


class NotSmooth(Unenclosed):
    """The right-hand side asks for something that has no derivative, such as a comparison of states."""
