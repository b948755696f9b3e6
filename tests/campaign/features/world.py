"""A case with the features that came later: a fleet's case, and what is added to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from ..model import Case, Node, Polygon, children, conjuncts
from ..model import text as plain_text

Disc = tuple[float, float, float]
"""Centre and radius, metres."""
Shape = Polygon | Disc


@dataclass(frozen=True)
class Zone:
    """An area with a largest speed; None for one that is kept out of."""

    shapes: tuple[Shape, ...]
    speed: float | None


@dataclass(frozen=True)
class Patch:
    """An area in which parameters may be anything between a member's own value and these ranges."""

    shapes: tuple[Shape, ...]
    ranges: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Errors:
    """Bounds of what moves a robot beside its model, in SI units; nothing by default."""

    place: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    first: float = 0.0
    second: float = 0.0
    share: float = 0.0
    varies: dict[str, float] = field(default_factory=dict)
    delay: float = 0.0
    jitter: float = 0.0
    hold: float | None = None

    def __bool__(self) -> bool:
        return self != Errors(hold=self.hold)


@dataclass(frozen=True)
class Featured:
    """A case with more: its task has the leaves ``("signal", ((name, factor), ...), offset)`` and
    ``("within", name, half, centre)`` too, and ``("G", a, b, ("apart", distance))``.
    """

    base: Case
    discs: dict[str, Disc] = field(default_factory=dict)
    footprint: Polygon = ()
    zones: dict[str, Zone] = field(default_factory=dict)
    terrain: dict[str, Patch] = field(default_factory=dict)
    errors: Errors = Errors()
    starts: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def shapes(self) -> dict[str, tuple[Shape, ...]]:
        """Everything that can be avoided, by name."""
        zones = {name: zone.shapes for name, zone in self.zones.items()}
        return {**self.base.obstacles, **{name: (disc,) for name, disc in self.discs.items()}, **zones}

    @property
    def parts(self) -> tuple[Node, ...]:
        """The parts of the task that must all hold, with the rules of the zones."""
        return (*conjuncts(self.base.task), *self.rules())

    def rules(self) -> Iterator[Node]:
        """What zones ask for."""
        for name, zone in self.zones.items():
            outside: Node = ("avoid", name)
            if zone.speed is None:
                yield ("G", None, None, outside)
            else:
                slow = (("signal", (("v", sign),), zone.speed) for sign in (1.0, -1.0))
                yield ("G", None, None, ("or", outside, ("and", *slow)))

    def at(self, start: str) -> Featured:
        """The members of one start alone."""
        (x, y), (dx, dy) = self.base.position, self.starts[start]
        parts = [part for part in conjuncts(self.base.task) if not is_apart(part)]
        base = replace(self.base, position=(x + dx, y + dy), task=("and", *parts))
        return replace(self, base=base, starts={})


def is_apart(part: Node) -> bool:
    """Whether a part keeps members of different starts from each other."""
    return bool(part[0] == "G" and part[3][0] == "apart")


def duties_of(part: Node) -> tuple[str, ...]:
    """What is kept out of throughout a window, if a part says nothing else."""
    if part[0] != "G":
        return ()
    kept = conjuncts(part[3])
    return tuple(leaf[1] for leaf in kept) if all(leaf[0] == "avoid" for leaf in kept) else ()


def below(node: Node) -> tuple[Node, ...]:
    """The operands of a formula."""
    return () if node[0] in ("signal", "within", "apart") else children(node)


def leaves(node: Node) -> Iterator[Node]:
    """The leaves of a formula."""
    if not below(node):
        yield node
    for part in below(node):
        yield from leaves(part)


def text(node: Node) -> str:
    """The formula in the task language."""
    match node[0]:
        case "signal":
            terms = " + ".join(f"{factor!r}*{name}" for name, factor in node[1])
            return f"({terms} >= {-node[2]!r})".replace("+ -", "- ")
        case "within":
            return f"({node[1]} within {node[2]!r} of {node[3]!r})"
        case "apart":
            return f"apart({node[1]!r} m)"
        case "pred" | "in" | "avoid":
            return plain_text(node)
        case "not":
            return f"not ({text(node[1])})"
        case "and" | "or":
            return "(" + f" {node[0]} ".join(text(part) for part in node[1:]) + ")"
    window = "" if node[1] is None else f"[{node[1]!r}, {node[2]!r}]"
    if node[0] == "U":
        return f"(({text(node[3])}) U{window} ({text(node[4])}))"
    return f"{node[0]}{window} ({text(node[3])})"
