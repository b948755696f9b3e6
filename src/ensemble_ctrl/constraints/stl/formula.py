"""Formulas of Signal Temporal Logic as trees of small immutable values.

Semantics (Arias et al., One Ring to Rule Them All, the commented ``RecursiveRho``), times relative to the
time t of evaluation::

    rho(sum c_i x_i + d >= 0) = (c . x + d) / |c|           so in metres when the states are positions
    rho(not f) = -rho(f)      rho(f and g) = min             rho(f or g) = max
    rho(F[a,b] f) = max over t' in [t+a, t+b] of rho(f, t')  rho(G[a,b] f) = min
    rho(f U[a,b] g) = max over t' in [t+a, t+b] of min(rho(g, t'), min over [t, t'] of rho(f))

A window without numbers is the rest of the horizon: from t to the last time at which the operand still fits
in it. In a window, ``math.inf`` stands for ``T``, the duration of the plan, and ``BeforeEnd(2)`` for ``T - 2``.
A formula is read for every member of the fleet; ``Mean`` reads it for the mean state, ``Share`` for a share of
the members.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import ClassVar

from ensemble_ctrl.constraints.stl._text import backwards, number, window_text
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import exact, rest_of

MAX_DEPTH = 200


@dataclass(frozen=True, slots=True)
class Formula:
    """Base of all formulas: ``f & g``, ``f | g``, ``~f``, and the temporal operators as methods.

    Raises
    ------
    ProblemError
        By any constructor, for a part that is not a formula, a window that runs backwards, a share outside
        (0, 1], or more than 200 levels; by ``f and g``, which Python can't turn into a formula.
    """

    depth: int = field(init=False, compare=False, repr=False)
    binding: ClassVar[int] = 5

    def __and__(self, other: Formula) -> Formula:
        return And((self, other))

    def __or__(self, other: Formula) -> Formula:
        return Or((self, other))

    def __invert__(self) -> Formula:
        return Not(self)

    def __bool__(self) -> bool:
        raise ProblemError("formula: expected f & g, f | g, ~f, got and, or, not, which Python evaluates itself")

    def eventually(self, a: float | None = None, b: float | None = None) -> Formula:
        """At some time in [a, b] seconds from now; without a window, before the horizon ends."""
        return Eventually(self, a, b)

    def always(self, a: float | None = None, b: float | None = None) -> Formula:
        """At all times in [a, b] seconds from now; without a window, until the horizon ends."""
        return Always(self, a, b)

    def until(self, other: Formula, a: float | None = None, b: float | None = None) -> Formula:
        """Hold up to and including a time in [a, b] seconds from now at which `other` holds."""
        return Until(self, other, a, b)

    def implies(self, other: Formula) -> Formula:
        """``not self or other``."""
        return Or((Not(self), other))

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The formulas directly below this one."""
        return ()


@dataclass(frozen=True, slots=True)
class Not(Formula):
    """The child does not hold."""

    child: Formula
    binding: ClassVar[int] = 4

    def __post_init__(self) -> None:
        _seal(self, (self.child,))

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The child."""
        return (self.child,)

    def __str__(self) -> str:
        return f"not {_within(self.child, 4)}"


@dataclass(frozen=True, slots=True)
class _Nary(Formula):
    """Two or more children; children of the same kind are merged into one list."""

    children: tuple[Formula, ...]
    word: ClassVar[str] = ""

    def __post_init__(self) -> None:
        children = tuple(self.children)
        if len(children) < 2:
            raise ProblemError(f"{type(self).__name__}: expected two or more formulas, got {len(children)}")
        _seal(self, children)
        flat: list[Formula] = []
        for child in children:
            flat.extend(child.parts if type(child) is type(self) else (child,))
        object.__setattr__(self, "children", tuple(flat))

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The children."""
        return self.children

    def __str__(self) -> str:
        return f" {self.word} ".join(_within(child, self.binding + 1) for child in self.children)


@dataclass(frozen=True, slots=True)
class And(_Nary):
    """Every child holds."""

    word: ClassVar[str] = "and"
    binding: ClassVar[int] = 2


@dataclass(frozen=True, slots=True)
class Or(_Nary):
    """Some child holds."""

    word: ClassVar[str] = "or"
    binding: ClassVar[int] = 1


@dataclass(frozen=True, slots=True)
class _Unary(Formula):
    """A temporal operator on one child, over [a, b] seconds from the time of evaluation."""

    child: Formula
    a: float | None = None
    b: float | None = None
    column: int = field(default=0, compare=False, repr=False)
    letter: ClassVar[str] = ""
    binding: ClassVar[int] = 4

    def __post_init__(self) -> None:
        _seal(self, (self.child,))
        _check_window(self, self.a, self.b)

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The child."""
        return (self.child,)

    def __str__(self) -> str:
        return f"{self.letter}{window_text(self.a, self.b)} {_within(self.child, 4)}"


@dataclass(frozen=True, slots=True)
class Eventually(_Unary):
    """The child holds at some time of the window."""

    letter: ClassVar[str] = "F"


@dataclass(frozen=True, slots=True)
class Always(_Unary):
    """The child holds at every time of the window."""

    letter: ClassVar[str] = "G"


@dataclass(frozen=True, slots=True)
class _Binary(Formula):
    """A temporal operator on two children."""

    left: Formula
    right: Formula
    a: float | None = None
    b: float | None = None
    column: int = field(default=0, compare=False, repr=False)

    def __post_init__(self) -> None:
        _seal(self, (self.left, self.right))
        _check_window(self, self.a, self.b)

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The left and the right child."""
        return (self.left, self.right)


@dataclass(frozen=True, slots=True)
class Until(_Binary):
    """`right` holds at some time of the window, and `left` from now up to and including that time."""

    binding: ClassVar[int] = 3

    def __str__(self) -> str:
        return f"{_within(self.left, 4)} U{window_text(self.a, self.b)} {_within(self.right, 3)}"


@dataclass(frozen=True, slots=True)
class Release(_Binary):
    """The dual of until, ``not (not left U not right)``; only `negation_normal_form` makes it."""

    binding: ClassVar[int] = 4

    def __str__(self) -> str:
        return f"not ({Until(Not(self.left), Not(self.right), self.a, self.b)})"


@dataclass(frozen=True, slots=True)
class Mean(Formula):
    """The child, read for the mean state of the fleet."""

    child: Formula

    def __post_init__(self) -> None:
        _seal(self, (self.child,))

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The child."""
        return (self.child,)

    def __str__(self) -> str:
        return f"mean({self.child})"


@dataclass(frozen=True, slots=True)
class Share(Formula):
    """At least a share `p` of the members satisfy the child; `strict` (by negation), more than it."""

    p: float
    child: Formula
    strict: bool = False

    def __post_init__(self) -> None:
        low = 0.0 if not self.strict else -math.ulp(0.0)
        if not low < self.p <= 1:
            raise ProblemError(f"share: expected a share above 0 and up to 1, got {self.p}")
        _seal(self, (self.child,))

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The child."""
        return (self.child,)

    def rank(self, members: int) -> int:
        """How many members have to satisfy the child."""
        asked = exact(self.p) * members
        count = math.floor(asked) + 1 if self.strict else math.ceil(asked)
        return min(max(count, 1), members)

    def __str__(self) -> str:
        if self.strict:
            return f"not {Share(rest_of(self.p), Not(self.child))}"
        return f"share({number(self.p)}, {self.child})"


def _within(child: Formula, least: int) -> str:
    """A child's text, in brackets where it binds less tightly than its place needs."""
    return str(child) if child.binding >= least else f"({child})"


def _seal(node: Formula, children: Iterable[Formula]) -> None:
    """Check the children and set the depth; children of the same n-ary kind don't add a level."""
    depth = 0
    for child in children:
        if not isinstance(child, Formula):
            raise ProblemError(f"{type(node).__name__}: expected a formula, got {type(child).__name__}")
        merged = isinstance(node, _Nary) and type(child) is type(node)
        depth = max(depth, child.depth - 1 if merged else child.depth)
    if depth >= MAX_DEPTH:
        raise ProblemError(
            f"{type(node).__name__}: expected at most {MAX_DEPTH} levels, got one nested deeper than that"
        )
    object.__setattr__(node, "depth", depth + 1)


def _check_window(node: Formula, a: float | None, b: float | None) -> None:
    """Check that a window is absent, or runs forwards from no earlier than now."""
    name = type(node).__name__
    if a is None and b is None:
        return
    if a is None or b is None or math.isnan(a) or math.isnan(b) or a < 0:
        raise ProblemError(f"{name}: expected a window [a, b] with 0 <= a <= b, or none, got [{a}, {b}]")
    if backwards(a, b):
        raise ProblemError(f"{name}: expected a window that ends after it starts, got {window_text(a, b)}")
