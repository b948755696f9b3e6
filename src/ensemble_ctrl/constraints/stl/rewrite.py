"""Formulas to formulas: negations to the leaves, ``T`` to seconds, places to linear predicates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import is_
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.disc import disc_of
from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.constraints.polyhedron import Polyhedron
from ensemble_ctrl.constraints.stl._text import resolved_time
from ensemble_ctrl.constraints.stl.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Mean,
    Not,
    Or,
    Release,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl.leaves import Avoid, Inside, Known, Predicate, Within
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import rest_of

SOME_TURNS = (-16 * math.pi, 16 * math.pi)
"""Radians between which an angle is looked for whose range is not known."""
ALL_OBSTACLES = "obstacles"
"""The name of all obstacles together in a task."""

Map = Mapping[str, Obstacle | Sequence[Obstacle]]


def leaves(formula: Formula) -> Iterator[Formula]:
    """The leaves from left to right."""
    if not formula.parts:
        yield formula
    for part in formula.parts:
        yield from leaves(part)


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """The parts of a formula that must all hold."""
    return formula.parts if isinstance(formula, And) else (formula,)


def kept_out(part: Formula) -> tuple[Formula, ...]:
    """The leaves of ``G (avoid(a) and not in(b) and ...)``, none for any other formula."""
    if not isinstance(part, Always):
        return ()
    kept = conjuncts(part.child)
    outside = (isinstance(leaf, Avoid) or (isinstance(leaf, Not) and isinstance(leaf.child, Inside)) for leaf in kept)
    return kept if all(outside) else ()


def reads_fleet(formula: Formula) -> bool:
    """Whether a formula depends on the fleet as a whole, by ``mean`` or ``share``."""
    return isinstance(formula, Mean | Share) or any(reads_fleet(part) for part in formula.parts)


def rebuilt(formula: Formula, parts: Iterable[Formula]) -> Formula:
    """The same operator over other parts; the same formula, if they are the same."""
    parts = tuple(parts)
    if len(parts) == len(formula.parts) and all(map(is_, parts, formula.parts)):
        return formula
    match formula:
        case And() | Or():
            return type(formula)(parts)
        case Eventually() | Always() | Not() | Mean() | Share():
            (child,) = parts
            return replace(formula, child=child)
        case Until() | Release():
            left, right = parts
            return replace(formula, left=left, right=right)
    return formula


def map_leaves(formula: Formula, change: Callable[[Formula], Formula]) -> Formula:
    """Replace every leaf."""
    if not formula.parts:
        return change(formula)
    return rebuilt(formula, [map_leaves(part, change) for part in formula.parts])


def negation_normal_form(formula: Formula, negate: bool = False) -> Formula:
    """Push negations down to the leaves.

    Parameters
    ----------
    formula : Formula
    negate : bool
        Whether to return the negation of `formula`.

    Returns
    -------
    Formula
        With the same robustness, and `Not` only around `Inside`, `Avoid` and `Within`; a predicate takes the sign
        into its coefficients.
    """
    match formula:
        case Not(child=child):
            return negation_normal_form(child, not negate)
        case Predicate():
            return formula.negated() if negate else formula
        case Inside() | Avoid() | Within():
            return Not(formula) if negate else formula
        case Known(value=value):
            return Known(-value) if negate else formula
    parts = tuple(negation_normal_form(part, negate) for part in formula.parts)
    return _dual(formula, parts) if negate else rebuilt(formula, parts)


def _dual(formula: Formula, parts: tuple[Formula, ...]) -> Formula:
    """The operator that a negation turns this one into, over negated parts."""
    # not F f = G not f, not (f U g) = not f R not g
    match formula:
        case And():
            return Or(parts)
        case Or():
            return And(parts)
        case Eventually():
            return Always(parts[0], formula.a, formula.b, formula.column)
        case Always():
            return Eventually(parts[0], formula.a, formula.b, formula.column)
        case Until():
            return Release(parts[0], parts[1], formula.a, formula.b, formula.column)
        case Release():
            return Until(parts[0], parts[1], formula.a, formula.b, formula.column)
        # not (at least p do f) = more than 1 - p do not f
        case Share():
            return Share(rest_of(formula.p), parts[0], strict=not formula.strict)
    return rebuilt(formula, parts)


def resolve(formula: Formula, duration: float) -> Formula:
    """Put the plan's duration, in seconds, where a window has ``T``.

    Raises
    ------
    ProblemError
        If that makes a window run backwards, or begin before now.
    """
    parts = [resolve(part, duration) for part in formula.parts]
    formula = rebuilt(formula, parts)
    if isinstance(formula, Eventually | Always | Until | Release):
        a, b = (resolved_time(time, duration) for time in (formula.a, formula.b))
        return formula if a is formula.a and b is formula.b else replace(formula, a=a, b=b)
    return formula


def ground(
    formula: Formula,
    regions: Mapping[str, Polyhedron],
    obstacles: Map,
    *,
    position: Sequence[str] = ("x", "y"),
    radius: float = 0.0,
    angles: Callable[[str], tuple[float, float]] = lambda state: SOME_TURNS,
    zones: Map = MappingProxyType({}),
) -> Formula:
    """Replace named places and wrapped angles by linear predicates, so that predicates are the only leaves.

    Parameters
    ----------
    formula : Formula
    regions : mapping of str to Polyhedron
    obstacles : mapping of str to Obstacle, or to a sequence of them (the convex pieces of one)
        ``avoid(obstacles)`` means all of them; ``avoid(name)`` may name a region too.
    position : sequence of str
        Names of the states in a place's columns.
    radius : float
        Metres by which what is avoided grows.
    angles : callable
        From the name of an angle to the radians that it is between; up to eight turns either way if not given.

    zones : mapping of str to sequence of Obstacle
        What ``avoid(name)`` may name besides; ``avoid(obstacles)`` does not mean them.

    Returns
    -------
    Formula
        ``in(r)`` as the conjunction of the faces of `r`, with robustness `Polyhedron.margin`; ``avoid(o)`` as
        a disjunction over the facets of every piece, with robustness `Obstacle.facet_clearance` minus
        `radius`, or, under a negation, minus so much that all within
        it is closer than `radius`; ``angle within a of b`` as a disjunction over whole turns.

    Raises
    ------
    ProblemError
        For a name that isn't known, or a place in other dimensions than `position`.
    """

    def change(leaf: Formula, negated: bool) -> Formula:
        match leaf:
            case Inside(name=name):
                # inside of G x <= h: min_i (h_i - g_i x); outside of a disc: that of the rows around it
                region = _place(regions, name, "region")
                G, h = region.outer_rows() if negated else region.inner_rows()
                _, slack = _sharp(region, 0.0)
                return _joined(And, [_face(-g, bound, leaf, position, slack) for g, bound in zip(G, h, strict=True)])
            case Avoid():
                parts = []
                for piece in _avoided(leaf, regions, obstacles, zones):
                    rows, (within, slack) = piece.inner_rows() if negated else piece.outer_rows(), _sharp(piece, radius)
                    parts.append(_outside(*rows, leaf, position, within if negated else radius, slack))
                return _joined(And, parts)
            case Within():
                return _joined(Or, [And(pair) for pair in leaf.turns(*angles(leaf.state))])
        return leaf

    return _grounded(formula, change, False)


def _grounded(formula: Formula, change: Callable[[Formula, bool], Formula], negated: bool) -> Formula:
    """Replace every leaf, by what it is and whether it is within an odd number of negations."""
    if not formula.parts:
        return change(formula, negated)
    negated ^= isinstance(formula, Not)
    return rebuilt(formula, [_grounded(part, change, negated) for part in formula.parts])


def _avoided(leaf: Avoid, regions: Mapping[str, Polyhedron], obstacles: Map, zones: Map) -> list[Obstacle | Polyhedron]:
    """The convex pieces that a leaf avoids."""
    if leaf.name == ALL_OBSTACLES and leaf.name not in obstacles:
        found = [piece for entry in obstacles.values() for piece in _pieces(entry)]
        return [*found]
    if leaf.name in obstacles:
        return [*_pieces(obstacles[leaf.name])]
    if leaf.name in zones:
        return [*_pieces(zones[leaf.name])]
    return [_place(regions, leaf.name, "obstacle or region")]


def _pieces(entry: Obstacle | Sequence[Obstacle]) -> Sequence[Obstacle]:
    """One obstacle's convex pieces."""
    return [entry] if isinstance(entry, Obstacle) else entry


def _place(regions: Mapping[str, Polyhedron], name: str, kind: str) -> Polyhedron:
    """Look a region up."""
    if name not in regions:
        raise ProblemError(f"formula: expected the name of a {kind}, got {name!r}")
    return regions[name]


def _sharp(place: Obstacle | Polyhedron, radius: float) -> tuple[float, float]:
    """What sharp corners change of a place grown by a radius, or of a disc: two numbers of metres.

    The first is a radius by which sides may move outwards and stay in the place grown with round corners. The second
    is by how much a side may be violated where the round shape is not.
    """
    disc = disc_of(place)
    size = radius + (0.0 if disc is None else disc.radius)
    if size == 0.0 or place.A.shape[1] == 1:
        return radius, 0.0
    # sides moved by s meet s / sin(alpha / 2) from a corner of angle alpha; 0 where corners are not known
    share = 0.0
    if place.A.shape[1] == 2 and (isinstance(place, Obstacle) or place.is_bounded) and len(place.vertices) > 2:
        along = np.diff(place.vertices, axis=0, append=place.vertices[:1])
        long = np.hypot(*along.T)
        along = along / long[:, None]
        # half the turn from one side to the next, pi / 2 - alpha / 2, less the rounding of corners
        cosine = (along * np.roll(along, 1, axis=0)).sum(axis=1).min()
        wrong = 1e-9 + 1e-15 * float(np.abs(place.vertices).max() / long.min())
        share = max(0.0, float(np.sqrt(max(0.0, (1.0 + cosine) / 2))) - wrong)
    spare = 1e-12 * float(np.abs(place.vertices).max()) if share else 0.0
    return radius * share, size * (1.0 - share) + spare


def _outside(
    G: NDArray[np.float64],
    h: NDArray[np.float64],
    leaf: Avoid,
    position: Sequence[str],
    radius: float,
    slack: float,
) -> Formula:
    """On the free side of some facet, a radius away from its line."""
    # outside of G x <= h: max_i (g_i x - h_i - radius)
    return _joined(Or, [_face(g, -bound - radius, leaf, position, slack) for g, bound in zip(G, h, strict=True)])


def _face(g: Iterable[float], offset: float, leaf: Inside | Avoid, position: Sequence[str], slack: float) -> Formula:
    """``g x + offset >= 0``."""
    row = [float(value) for value in g]
    if len(row) != len(position):
        raise ProblemError(f"{leaf}: expected a place in {len(position)} dimensions, got one in {len(row)}")
    return Predicate(tuple(zip(position, row, strict=True)), float(offset), str(leaf), leaf.column, slack)


def _joined(kind: type[And] | type[Or], parts: list[Formula]) -> Formula:
    """The conjunction or disjunction; a single part is returned as it is."""
    if not parts:
        raise ProblemError("formula: expected a place with a face, or at least one obstacle, got none")
    return parts[0] if len(parts) == 1 else kind(tuple(parts))
