"""The task language as others write it: what is clear is read, and what is not says what to write instead."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import And, Formula, FormulaError, Or, StateSignals, check_windows, parse, resolve
from ensemble_ctrl.core.errors import ProblemError

from .stl_spelling import spelled
from .stl_strategies import NAMES, formulas, naive, predicates, signals, texts


@given(spelled(texts()))
def test_every_spelling_is_the_same_formula(both: tuple[Formula, str]) -> None:
    formula, text = both
    assert parse(text) == formula
    assert parse(str(formula)) == formula


def unordered(formula: Formula) -> object:
    """A formula in which the order of a conjunction and of a disjunction doesn't count."""
    if isinstance(formula, And | Or):
        return type(formula), frozenset(map(unordered, formula.parts))
    return ordered(formula)


def ordered(formula: Formula) -> object:
    """A formula's operator with its window, over what is below it."""
    if not formula.parts:
        return formula
    window = getattr(formula, "a", None), getattr(formula, "b", None)
    return type(formula), window, tuple(map(unordered, formula.parts))


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("always[0:5] in(a)", "G[0,5] in(a)"),
        ("G_[0,5] in(a) && F_{[1,2]} in(b)", "G[0,5] in(a) and F[1,2] in(b)"),
        ("F[0 s, 500 ms] in(a)", "F[0,0.5] in(a)"),
        ("F[1 min, 0.05 h] in(a)", "F[60,180] in(a)"),
        ("F[0, 500 ms] in(a)", "F[0,0.5] in(a)"),
        ("in(a) implies in(b)", "not in(a) or in(b)"),
        ("in(a) -> in(b)", "not in(a) or in(b)"),
        ("in(a) iff in(b)", "(not in(a) or in(b)) and (in(a) or not in(b))"),
        ("in(a) <-> in(b)", "(not in(a) or in(b)) and (in(a) or not in(b))"),
        ("in(a) iff in(b) => in(c)", "(not in(a) or (in(b) => in(c))) and (in(a) or not (in(b) => in(c)))"),
        ("in(a) xor in(b)", "(in(a) or in(b)) and (not in(a) or not in(b))"),
        ("~in(a)", "not in(a)"),
        ("<>[] in(a)", "F G in(a)"),
        ("[](x >= 1 -> <>_[0,2] y >= 1)", "G (x >= 1 => F[0,2] y >= 1)"),
        ("finally globally in(a)", "F G in(a)"),
        ("¬in(a) ∧ ◇ in(b) ∨ □ x ≤ −1", "not in(a) and F in(b) or G x <= -1"),
        ("in(a) /\\ in(b) \\/ in(c)", "in(a) and in(b) or in(c)"),
        ("G[0, inf) in(a)", "G in(a)"),
        ("G[2, inf) in(a)", "G[2,T] in(a)"),
        ("G[2, ∞) in(a)", "G[2,T] in(a)"),
        ("G[0, inf) F[0,2] in(a)", "G F[0,2] in(a)"),
        ("NOT in(a) AND Eventually in(b)", "not in(a) and F in(b)"),
        ("1 <= x <= 3", "1 <= x and x <= 3"),
        ("3 > x >= y > 0", "3 > x and x >= y and y > 0"),
        ("abs(x) <= 1", "x <= 1 and x >= -1"),
        ("abs(x - 2) >= 1", "x >= 3 or x <= 1"),
        ("1 >= abs(x)", "x <= 1 and x >= -1"),
        ("-abs(x) >= -2 + 1", "x <= 1 and x >= -1"),
        ("abs(-3)*x >= 3", "3*x >= 3"),
        ("0 <= abs(x) <= 1", "(x >= 0 or x <= 0) and x <= 1 and x >= -1"),
        ("true U[0,4] in(a)", "F[0,4] in(a)"),
        ("in(a) U[2,4] true", "G[0,2] in(a)"),
        ("in(a) U true", "in(a)"),
        ("G (true => in(a))", "G in(a)"),
        ("in(a) and not false", "in(a)"),
        ("in(a) iff true", "in(a)"),
        ("in(a) xor true", "not in(a)"),
    ],
)
def test_what_is_clear_is_read(text: str, plain: str) -> None:
    read, wanted = parse(text), parse(plain)
    assert unordered(read) == unordered(wanted)
    assert parse(str(read)) == read


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("once[0,5] in(a)", "there are no past operators"),
        ("O in(a)", "not g U f"),
        ("historically[0,5] x >= 1", "G[0,b] f"),
        ("H x >= 1", "G[0,b] f"),
        ("x >= 1 since y >= 2", "G (g => G f)"),
        ("x >= 1 S[0,2] y >= 2", "G (g => G f)"),
        ("next in(a)", "F[0.1,0.1] f"),
        ("X in(a)", "F[0.1,0.1] f"),
        ("prev(x >= 1)", "F[0.1,0.1] f"),
        ("rise(x >= 1)", "there are no edges"),
        ("in(a) W in(b)", "(f U g) or G f"),
        ("in(a) unless in(b)", "(f U g) or G f"),
        ("in(a) R in(b)", "not (not f U not g)"),
        ("in(a) release in(b)", "not (not f U not g)"),
        ("alw_[0,5] x >= 1", "'always' is  G"),
        ("ev_[0,5] x >= 1", "'eventually' is  F"),
        ("x == 1", "abs(x - 1) <= 0.1"),
        ("x = 1", "abs(x - 1) <= 0.1"),
        ("x != 1", "abs(x - 1) >= 0.1"),
        ("x*y >= 1", "in(region)"),
        ("x^2 + y^2 <= 1", "in(region)"),
        ("x**2 <= 1", "in(region)"),
        ("sqrt(x) <= 1", "in(region)"),
        ("norm(x) <= 1", "in(region)"),
        ("min(x, y) >= 1", "a >= 1 and b >= 1"),
        ("x >= 50 cm", "50 cm is 0.5"),
        ("2 x >= 1", "2*x"),
        ("F(0,5) in(a)", "square brackets"),
        ("F{0,5} in(a)", "square brackets"),
        ("G[0,5) in(a)", "[a,b]"),
        ("F[T/2, T] in(a)", "T minus a number"),
        ("F[0, T + 1] in(a)", "no time is later than T"),
        ("F[1, 500 ms] in(a)", "window's end of 1 or later"),
        ("F[1, 5 min] in(a)", "a unit of time at both ends"),
        ("F[500 ms, 2] in(a)", "a unit of time at both ends"),
        ("F[0, 5 m] in(a)", "a unit of time (s, ms, min, h)"),
        ("F goal", "in(goal)"),
        ("F in goal", "write  in(goal)"),
        ("G avoid obstacles", "write  avoid(obstacles)"),
        ("share(95 %, in(a))", "write 0.95"),
        ("reach(goal)", "in(place)"),
        ("outside(o1)", "avoid(place)"),
        ("speed(x) >= 1", "speed is no function"),
        ("x[t] >= 1", "write x alone"),
        ("1 <= x >= 0", "'and' between them"),
        ("abs(abs(x)) <= 1", "another abs"),
        ("true", "always true"),
        ("G (in(a) or true)", "always true"),
        ("false U in(a)", "always false"),
        (" + ".join(f"abs(x - {i})" for i in range(9)) + " <= 1", "at most 6 absolute values"),
    ],
)
def test_what_is_not_says_what_to_write(text: str, words: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert words in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("text", ["in(goal", "in(goal and x >= 1", "share(0.95 in(a))", "share(250, in(a))"])
def test_no_hint_is_better_than_one_that_misleads(text: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert not caught.value.hint


def test_a_chain_of_equivalences_does_not_grow_without_end() -> None:
    with pytest.raises(FormulaError, match="at most 1000 predicates and places around 'iff'"):
        parse(" iff ".join(["x >= 1"] * 60))
    assert len(str(parse("x >= 1 iff x >= 2 iff x >= 3"))) < 500


def read_or_none(text: str, words: str) -> Formula | None:
    """A formula; None if it is refused in these words."""
    try:
        return parse(text)
    except FormulaError as error:
        if words not in str(error):
            raise
        return None


sums = st.tuples(*[st.sampled_from([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0])] * 3)


@given(sums, st.lists(st.tuples(st.sampled_from([-2.0, -0.5, 1.0, 3.0]), sums), min_size=1, max_size=3), st.booleans())
def test_absolute_values_are_what_they_are(outside: tuple[float, ...], bars: list, up: bool) -> None:  # type: ignore[type-arg]
    """The sign of the robustness is the truth of the comparison, on a grid of points."""

    def text(terms: tuple[float, ...]) -> str:
        a, b, c = terms
        return f"({a})*x + ({b})*y + ({c})".replace("(-", "(0-")

    whole = " + ".join([text(outside), *(f"({w})*abs({text(e)})".replace("((-", "((0-") for w, e in bars)])
    whole = whole.replace("(-", "(0-")
    formula = read_or_none(f"{whole} {'>=' if up else '<='} 0.25", "at least one state")
    if formula is None:
        return
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-3, 3, 7), np.linspace(-3, 3, 7)))
    value = outside[0] * x + outside[1] * y + outside[2]
    for weight, (a, b, c) in bars:
        value = value + weight * np.abs(a * x + b * y + c)
    short = value - 0.25 if up else 0.25 - value
    found = naive(formula, StateSignals(np.stack([x, y], axis=-1)[:, None, :], NAMES, 1.0), 0)
    clear = np.abs(short) > 1e-9
    assert ((found > 0) == (short > 0))[clear].all()


HUGE = 1e12
LEVELS = {"true": f"x >= -{HUGE:.0f}", "false": f"x >= {HUGE:.0f}"}
leaf_or_constant = predicates() | st.sampled_from([parse(text) for text in LEVELS.values()])


@given(formulas(leaf_or_constant, st.sampled_from([0.0, 0.5, 1.0])))
def test_constants_are_predicates_that_nothing_reaches(formula: Formula) -> None:
    text = str(formula)
    for word, level in LEVELS.items():
        text = text.replace(str(parse(level)), word)
    data = signals(1, steps=8)
    try:
        wanted = naive(formula, data, 0)
    except ValueError:  # windows that don't fit
        return
    found = read_or_none(text, "always true" if (wanted > HUGE / 2).all() else "always false")
    if found is None:
        return
    assert (abs(wanted) < HUGE / 2).all()
    try:
        robust = naive(found, data, 0)
    except ValueError:
        return
    assert np.allclose(robust, wanted)


def test_windows_are_counted_from_the_end() -> None:
    formula = parse("G[T-2, T] in(a)")
    assert str(formula) == "G[T-2,T] in(a)" != str(parse("G[T-3,T] in(a)"))
    assert formula != parse("G[T-3, T] in(a)")
    assert formula != parse("G[T, T] in(a)")
    assert str(resolve(formula, 16.0)) == "G[14,16] in(a)"
    assert hash(formula) == hash(copy.deepcopy(formula)) == hash(pickle.loads(pickle.dumps(formula)))
    assert parse("G[T-2,5] in(a)") == pickle.loads(pickle.dumps(parse("G[T - 2000 ms, 5 s] in(a)")))
    assert check_windows(formula, 16.0) == 16.0
    with pytest.raises(ProblemError, match="0 <= a <= b"):
        resolve(formula, 1.5)
    with pytest.raises(ProblemError, match="ends after it starts"):
        resolve(parse("G[T-2,5] in(a)"), 16.0)
    assert math.isinf(parse("F[T-1,T] in(a)").a)  # type: ignore[attr-defined]
