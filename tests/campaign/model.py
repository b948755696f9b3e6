"""A case as plain numbers: what is given to the certificate, and to the oracle that judges it.

Nothing here is of the package, so that a mistake there can't enter the oracle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Long = np.longdouble
Longs = NDArray[np.longdouble]
Floats = NDArray[np.float64]
Node = tuple[Any, ...]
"""A formula: its operator, then what it takes.

``("pred", cx, cy, d)`` is ``cx x + cy y + d >= 0``; ``("in", name)``, ``("avoid", name)``; ``("not", f)``,
``("and", f, g, ...)``, ``("or", f, g, ...)``; ``("F", a, b, f)``, ``("G", a, b, f)``, ``("U", a, b, f, g)``, with a and
b None where there is no window; ``("mean", f)``, ``("share", p, f)``.
"""
Distribution = tuple[Any, ...]
"""``("uniform", low, high)``, ``("beta", low, high, a, b)``, ``("normal", low, high, mean, deviation)``,
``("samples", values)`` or ``("mixture", ((distribution, weight), ...))``."""
Polygon = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Case:
    """A fleet, a map, a task, and controls."""

    family: str
    system: str
    heading_from: str
    wheelbase: float
    parameters: dict[str, Distribution]
    position: tuple[float, float]
    heading: float
    radius: float
    duration: float
    controls: tuple[tuple[float, float], ...]
    task: Node
    obstacles: dict[str, tuple[Polygon, ...]] = field(default_factory=dict)
    regions: dict[str, tuple[tuple[float, float], tuple[float, float]]] = field(default_factory=dict)
    motions: dict[str, tuple[tuple[float, ...], tuple[tuple[float, float], ...]]] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] | None = None
    cloud: tuple[str, ...] = ()

    @property
    def distributions(self) -> dict[str, Distribution]:
        """The distributions that the claim is about: those of the fleet, but for ranges that were asked for."""
        return {**self.parameters, **{name: ("uniform", *ends) for name, ends in (self.ranges or {}).items()}}

    @property
    def conjuncts(self) -> tuple[Node, ...]:
        """The parts of the task that must all hold."""
        return conjuncts(self.task)


def ends_of(distribution: Distribution) -> tuple[float, float]:
    """The range of a distribution."""
    if distribution[0] == "samples":
        return min(distribution[1]), max(distribution[1])
    if distribution[0] == "mixture":
        ends = [ends_of(part) for part, _ in distribution[1]]
        return min(low for low, _ in ends), max(high for _, high in ends)
    return distribution[1], distribution[2]


def children(node: Node) -> tuple[Node, ...]:
    """The operands of a formula."""
    match node[0]:
        case "pred" | "in" | "avoid":
            return ()
        case "not" | "and" | "or" | "mean":
            return node[1:]
        case "share":
            return node[2:]
    return node[3:]


def conjuncts(node: Node) -> tuple[Node, ...]:
    """The parts of a formula that must all hold."""
    return tuple(inner for part in node[1:] for inner in conjuncts(part)) if node[0] == "and" else (node,)


def reach(node: Node) -> np.longdouble:
    """How long after its time of evaluation a formula looks, seconds; a missing window adds nothing."""
    below = max((reach(part) for part in children(node)), default=Long(0))
    return below + (Long(node[2]) if node[0] in "FGU" and node[2] is not None else Long(0))


def instants(node: Node, begin: frozenset[Long] = frozenset({Long(0)})) -> Iterator[np.longdouble]:
    """Times at which windows begin or end, counted from time 0."""
    if node[0] in ("F", "G", "U") and node[2] is not None and len(begin) < 64:
        begin = frozenset(t + Long(end) for t in begin for end in (node[1], node[2]))
        yield from begin
    for part in children(node):
        yield from instants(part, begin)


def text(node: Node) -> str:
    """The formula in the task language."""
    match node[0]:
        case "pred":
            _, cx, cy, d = node
            return f"({cx!r}*x + {cy!r}*y >= {-d!r})".replace("+ -", "- ")
        case "in" | "avoid":
            return f"{node[0]}({node[1]})"
        case "not":
            return f"not ({text(node[1])})"
        case "and" | "or":
            return "(" + f" {node[0]} ".join(text(part) for part in node[1:]) + ")"
        case "mean":
            return f"mean({text(node[1])})"
        case "share":
            return f"share({node[1]!r}, {text(node[2])})"
        case "U":
            return f"(({text(node[3])}) U{_window(node)} ({text(node[4])}))"
    return f"{node[0]}{_window(node)} ({text(node[3])})"


def _window(node: Node) -> str:
    """A window, if there is one."""
    return "" if node[1] is None else f"[{node[1]!r}, {node[2]!r}]"
