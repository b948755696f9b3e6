"""Checks of a formula against its problem: names, and windows against the horizon."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches

from ensemble_ctrl.constraints.stl.formula import Always, Eventually, Formula, Release, Until
from ensemble_ctrl.constraints.stl.leaves import Avoid, Inside, Predicate, Within
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES, leaves, resolve
from ensemble_ctrl.constraints.stl.text import FormulaError
from ensemble_ctrl.core.errors import MOST_LETTERS, MOST_LISTED, shortened

Temporal = Eventually | Always | Until | Release


def check_names(formula: Formula, regions: Iterable[str], obstacles: Iterable[str], states: Iterable[str]) -> None:
    """Check that every name is known.

    Raises
    ------
    FormulaError
        For the first that isn't, with its column and the most similar known name; `name_errors` gives all.
    """
    for error in name_errors(formula, regions, obstacles, states):
        raise error


def name_errors(
    formula: Formula, regions: Iterable[str], obstacles: Iterable[str], states: Iterable[str]
) -> list[FormulaError]:
    """One error for each unknown name, in the order of the text; the first of them with what was meant, perhaps."""
    unknown = list(_unknown_names(formula, list(regions), list(obstacles), list(states)))
    shapes = set(obstacles)
    return [_unknown(*found, shapes, guess=place < MOST_LISTED) for place, found in enumerate(unknown)]


def _unknown_names(
    formula: Formula, regions: list[str], obstacles: list[str], states: list[str]
) -> Iterator[tuple[int, str, str, list[str]]]:
    """Column, kind and name of every unknown name, and the names that are known there."""
    avoidable = [ALL_OBSTACLES, *obstacles, *regions]
    inside, outside, coordinates = set(regions), set(avoidable), set(states)
    for leaf in leaves(formula):
        match leaf:
            case Inside(name=name) if name not in inside:
                yield leaf.column, "a region", name, regions
            case Avoid(name=name) if name not in outside:
                yield leaf.column, "an obstacle or region", name, avoidable
            case Predicate():
                for name, _ in leaf.coefficients:
                    if name not in coordinates:
                        yield leaf.column, "a state", name, states
            case Within(state=name) if name not in coordinates:
                yield leaf.column, "a state", name, states


def _unknown(column: int, kind: str, name: str, known: list[str], obstacles: set[str], guess: bool) -> FormulaError:
    """An error that suggests the most similar name, or lists what there is."""
    close = get_close_matches(name[:MOST_LETTERS], known, n=1) if guess else []
    listed = ", ".join(map(shortened, known[:12])) or "there is none"
    meant = f"did you mean {close[0]!r}?" if close else listed
    hint = f"{name} is an obstacle: to be outside of it is  avoid({name})" if name in obstacles else ""
    return FormulaError(column, f"the name of {kind} ({meant})", shortened(repr(name)), hint)


def check_windows(formula: Formula, duration: float) -> float:
    """Check that every window ends within the plan, and compute the formula's horizon.

    Parameters
    ----------
    formula : Formula
    duration : float
        Seconds; stands for ``T``.

    Returns
    -------
    float
        The formula's horizon, in seconds. An operator without a window adds nothing to its operand's.

    Raises
    ------
    FormulaError
        With the column of the first operator that can reach past the end.
    """
    formula = resolve(formula, duration)
    for node, end in _window_ends(formula, 0.0):
        if end > duration + 1e-9:
            wanted = f"a window that ends by {duration:g} s, the plan's duration"
            raise FormulaError(node.column, wanted, f"{node} reaching {end:g} s")
    return horizon(formula)


def horizon(formula: Formula) -> float:
    """How many seconds after its time of evaluation a formula can depend on, with ``T`` resolved."""
    below = max((horizon(part) for part in formula.parts), default=0.0)
    return below + (formula.b or 0.0 if isinstance(formula, Temporal) else 0.0)


def _window_ends(formula: Formula, start: float) -> Iterator[tuple[Temporal, float]]:
    """Every temporal operator with the latest time that its own window can reach, outermost first."""
    if isinstance(formula, Temporal):
        start += formula.b or 0.0
        yield formula, start
    for part in formula.parts:
        yield from _window_ends(part, start)
