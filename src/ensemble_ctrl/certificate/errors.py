"""What ends a proof without a bound."""

from __future__ import annotations

from threading import local


class Unenclosed(ArithmeticError):
    """No enclosure of a system can be given; the message says why, and the verdict is "undecided".

    Every one is remembered until `take_refusal`, so that a right-hand side that catches it is refused all the same.

    Attributes
    ----------
    piece : int or None
        Which of the pieces treated at once it is about, if it is about one.
    states : tuple of int
        The states on which what is refused depends, where that is known.
    """

    def __init__(self, message: str, piece: int | None = None, states: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.piece, self.states = piece, states
        _LAST.refusal = self


class NotSmooth(Unenclosed):
    """The right-hand side asks for something that has no derivative, such as a comparison of states."""


def take_refusal() -> Unenclosed | None:
    """The last refusal of this thread since it was asked before, if any."""
    found: Unenclosed | None = getattr(_LAST, "refusal", None)
    _LAST.refusal = None
    return found


_LAST = local()
