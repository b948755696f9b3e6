"""Checks of a formula against its problem: names, and windows against the horizon."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches

from ensemble_ctrl.constraints.stl.formula import Always, Eventually, Formula, Release, Until
from ensemble_ctrl.constraints.stl.leaves import Avoid, Inside, Predicate
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES, leaves, resolve
from ensemble_ctrl.constraints.stl.text import FormulaError

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
    """One error for each unknown name, in the order of the text."""
    known_regions, known_states = list(regions), list(states)
    avoidable = [ALL_OBSTACLES, *obstacles, *known_regions]
    errors = []
    for leaf in leaves(formula):
        match leaf:
            case Inside(name=name) if name not in known_regions:
                errors.append(_unknown(leaf.column, "a region", name, known_regions))
            case Avoid(name=name) if name not in avoidable:
                errors.append(_unknown(leaf.column, "an obstacle or region", name, avoidable))
            case Predicate():
                wrong = [name for name, _ in leaf.coefficients if name not in known_states]
                errors += [_unknown(leaf.column, "a state", name, known_states) for name in wrong]
    return errors


def _unknown(column: int, kind: str, name: str, known: list[str]) -> FormulaError:
    """An error that suggests the most similar name, or lists what there is."""
    close = get_close_matches(name, known, n=1)
    if close:
        return FormulaError(column, f"the name of {kind} (did you mean {close[0]!r}?)", repr(name))
    listed = ", ".join(known[:12]) or "there is none"
    return FormulaError(column, f"the name of {kind} ({listed})", repr(name))


def check_windows(formula: Formula, duration: float) -> float:
    """Check that every window ends within the plan, and say how far the formula looks ahead.

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
        With the column of the first operator that can look past the end.
    """
    formula = resolve(formula, duration)
    for node, end in _window_ends(formula, 0.0):
        if end > duration + 1e-9:
            wanted = f"a window that ends by {duration:g} s, the plan's duration"
            raise FormulaError(node.column, wanted, f"{node} reaching {end:g} s")
    return horizon(formula)


def horizon(formula: Formula) -> float:
    """How many seconds after its time of evaluation a formula can look, with ``T`` resolved."""
    below = max((horizon(part) for part in formula.parts), default=0.0)
    return below + (formula.b or 0.0 if isinstance(formula, Temporal) else 0.0)


def _window_ends(formula: Formula, start: float) -> Iterator[tuple[Temporal, float]]:
    """Every temporal operator with the latest time that its own window can reach, outermost first."""
    if isinstance(formula, Temporal):
        start += formula.b or 0.0
        yield formula, start
    for part in formula.parts:
        yield from _window_ends(part, start)
