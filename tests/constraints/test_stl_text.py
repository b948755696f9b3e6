import copy
import math
import pickle
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    FormulaError,
    Inside,
    Mean,
    Not,
    Or,
    Predicate,
    Share,
    Until,
    Within,
    check_names,
    leaves,
    name_errors,
    negation_normal_form,
    parse,
    resolve,
)
from ensemble_ctrl.core.errors import ProblemError
from tests.examples import quick

from .stl_strategies import texts

X, Y = Predicate((("x", 1.0),), -1.0), Predicate((("y", 1.0),))
GOAL = Inside("goal")


@given(texts())
def test_the_text_of_a_formula_reads_back(formula: Formula) -> None:
    assert parse(str(formula)) == formula
    normal = negation_normal_form(formula)
    assert negation_normal_form(parse(str(normal))) == normal or "share" in str(formula)


def error_of(text: str) -> FormulaError | None:
    try:
        parse(text)
    except FormulaError as error:
        return error
    return None


@given(st.text(alphabet="xyFGUT[](),.;>=<!&|*/+-01 \nin", max_size=40))
def test_any_text_gives_a_formula_or_a_formula_error(text: str) -> None:
    error = error_of(text)
    if error is not None:
        assert 1 <= error.column <= len(text) + 1
        assert error.expected
        assert f"column {error.column}" in str(error)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("F[14, 16] in(goal)", Eventually(GOAL, 14, 16)),
        ("eventually in(goal)", Eventually(GOAL)),
        ("always[0,T] avoid(obstacles)", Always(Avoid("obstacles"), 0, math.inf)),
        ("x >= 1 and y >= 0 or in(goal)", Or((And((X, Y)), GOAL))),
        ("x >= 1 or y >= 0 & in(goal)", Or((X, And((Y, GOAL))))),
        ("F x >= 1 and y >= 0", And((Eventually(X), Y))),
        ("not F x >= 1", Not(Eventually(X))),
        ("!x >= 1 | y >= 0", Or((Not(X), Y))),
        ("x >= 1 U[0,2] y >= 0 and in(goal)", And((Until(X, Y, 0, 2), GOAL))),
        ("x >= 1 until y >= 0 U in(goal)", Until(X, Until(Y, GOAL))),
        ("F x >= 1 U y >= 0", Until(Eventually(X), Y)),
        ("x >= 1 => y >= 0 => in(goal)", Or((Not(X), Not(Y), GOAL))),
        ("(x >= 1 => y >= 0) => in(goal)", Or((Not(Or((Not(X), Y))), GOAL))),
        ("mean(F in(goal))", Mean(Eventually(GOAL))),
        ("share(0.95, F in(goal)) and x>=1", And((Share(0.95, Eventually(GOAL)), X))),
        ("2*x + y <= 3", Predicate((("x", -2.0), ("y", -1.0)), 3.0)),
        ("-(x - 2*(y+1))/4 > 1e-1*5", Predicate((("x", -0.25), ("y", 0.5)), 0.0)),
        ("1 <= x", X),
        ("Fx >= 0", Predicate((("Fx", 1.0),))),
        ("in(until) and avoid(a-b.c)", And((Inside("until"), Avoid("a-b.c")))),
        ("F\n[0,\t1]\nin(goal)", Eventually(GOAL, 0, 1)),
    ],
)
def test_precedence_and_words(text: str, formula: Formula) -> None:
    assert parse(text) == formula


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("", 1, "a formula, got an empty text"),
        (" \n ", 1, "empty"),
        ("F[14,16 in(goal)", 9, "']', got 'in'"),
        ("(x>=1", 6, "')', got the end"),
        ("x>=1)", 5, "the end, got ')'"),
        ("F[5,2] x>=1", 5, "a window's end of 5 or later, got 2"),
        ("F[T,2] x>=1", 5, "a window's end of T or later, got 2"),
        ("F[-1,2] x>=0", 3, "a number or T, got '-'"),
        ("share(1.5, x>=1)", 7, "a share above 0 and up to 1, got 1.5"),
        ("share(0, x>=1)", 7, "a share above 0"),
        ("x >= 1 and", 11, "a formula, got the end"),
        ("x $ 1", 3, "got '$'"),
        ("x == 1", 3, "'>=', '<='"),
        ("x*y >= 1", 3, "linear"),
        ("x/0 >= 1", 3, "not zero"),
        ("y>=0 and 1>=2", 10, "at least one state"),
        ("x - x >= 1", 1, "at least one state"),
        ("T >= 1", 1, "a state's name, got 'T'"),
        ("x >= 1e999", 6, "a finite number"),
        ("in goal", 4, "'(', got 'goal'"),
        ("x >= 1 y >= 2", 8, "'and', 'or'"),
    ],
)
def test_errors_have_a_column_and_say_what_was_expected(text: str, column: int, words: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert caught.value.column == column
    assert words in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("text", ["!" * 300 + "x>=1", "F " * 5000 + "x>=1", "x>=1 U " * 5000 + "x>=1", "mean(" * 300])
def test_deep_texts_are_refused(text: str) -> None:
    with pytest.raises(FormulaError):
        parse(text)


@pytest.mark.parametrize("operator", quick([" and ", " or ", " => ", " and x>=2 or "], " => "))
def test_a_text_of_10000_operators(operator: str) -> None:
    formula = parse(operator.join(["x>=1"] * 10_001))
    assert parse(str(formula)) == formula
    assert len({formula, copy.deepcopy(formula)}) == 1
    negation_normal_form(formula, negate=True)


def test_brackets_and_sums_may_be_long() -> None:
    assert parse("(" * 5000 + "x>=1" + ")" * 5000) == X
    assert parse("+".join(["x"] * 5000) + ">=5000").normalised() == X.normalised()  # type: ignore[attr-defined]


def test_formulas_in_python() -> None:
    formula = (X & Y & GOAL) | ~X.until(Y, 0, 2).eventually().always(1, 2)
    assert formula == parse("x>=1 and y>=0 and in(goal) or not G[1,2] F (x>=1 U[0,2] y>=0)")
    assert X.implies(Y) == parse("x>=1 => y>=0")
    many: Formula = X
    for _ in range(2000):
        many = many & Y
    assert many.depth == 2
    deepest = X
    for _ in range(199):
        deepest = Not(deepest)  # type: ignore[assignment]
    assert parse(str(deepest)) == deepest
    assert negation_normal_form(deepest) == X.negated()
    with pytest.raises(ProblemError, match="nested deeper than"):
        Not(deepest)
    assert sys.getrecursionlimit() >= 1000


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: X and Y, "f & g"),
        (
            lambda: X & 3,  # type: ignore[operator]
            "expected a formula, got int",
        ),
        (lambda: And((X,)), "two or more"),
        (lambda: X.eventually(2, 1), "ends after it starts"),
        (lambda: X.eventually(2), "or none"),
        (lambda: X.always(-1, 1), "0 <= a"),
        (lambda: Share(1.5, X), "share"),
        (lambda: Predicate((("not", 1.0),)), "state's name"),
        (lambda: Predicate((("x", math.nan),)), "finite"),
        (lambda: Inside("two words"), "a name of letters"),
    ],
)
def test_wrong_formulas_are_refused(make, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ProblemError, match=message):
        make()


def test_columns_are_kept_and_not_compared() -> None:
    formula = parse("F[0,1] in(goal) and  x >= 1 or avoid(o1)")
    assert [leaf.column for leaf in leaves(formula)] == [11, 22, 38]  # type: ignore[attr-defined]
    assert formula == parse("(F[0,1]in(goal) and x>=1)or avoid(o1)")


def test_names_are_checked_with_a_suggestion() -> None:
    formula = parse("F in(gaol) and avoid(block2) and avoid(obstacles) and avoid(goal) and x + z >= 1")
    with pytest.raises(FormulaError, match="did you mean 'goal'") as caught:
        check_names(formula, ["goal"], ["block1"], ["x", "y"])
    assert caught.value.column == 6
    found = name_errors(formula, ["goal"], ["block1"], ["x", "y"])
    assert [error.column for error in found] == [6, 22, 71]
    assert "did you mean 'block1'" in str(found[1])
    assert "(x, y), got 'z'" in str(found[2])
    check_names(parse("F in(goal)"), ["goal"], [], [])


def test_the_end_of_the_horizon_is_put_in() -> None:
    formula = resolve(parse("F[14,T] in(goal) and x>=1 U[T,T] y>=0"), 16.0)
    assert str(formula) == "F[14,16] in(goal) and x >= 1 U[16,16] y >= 0"
    with pytest.raises(ProblemError, match="ends after it starts"):
        resolve(parse("F[14,T] in(goal)"), 10.0)


@pytest.mark.parametrize(
    ("text", "half", "centre"),
    [
        ("heading within 10 deg of 90 deg", np.radians(10), np.radians(90)),
        ("heading within 0.1 of -3 rad", 0.1, -3.0),
        ("heading within 33.3333 deg of + 1", 33.3333 * (np.pi / 180), 1.0),
    ],
)
def test_angles_are_read_and_printed_with_or_without_their_unit(text: str, half: float, centre: float) -> None:
    formula = parse(text)
    assert formula == Within("heading", half, centre)
    assert parse(str(formula)) == formula
    assert parse("heading <= 10 deg") == parse(f"heading <= {10 * (np.pi / 180)!r}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "heading within 10 of 90 deg",
            "column 16: .*below 180 deg, got 572.958 deg; write 10 deg, if degrees are meant",
        ),
        ("2*heading within 1 of 2", "column 1: expected the name of one angle before 'within', got an expression"),
        (
            "G heading within 10 deg 90",
            "column 25: expected 'of', or a unit .*; write  heading within 10 deg of 90 deg",
        ),
        ("heading within 10 m of 90", "column 19: expected 'of', or a unit"),
        ("heading within 10 deg of x", "column 26: expected a number, got 'x'"),
        ("heading within 10 deg of 900 deg", "column 16: expected an angle from -360 deg to 360 deg, got 900 deg"),
        ("x >= y within 3 of 2", "column 8: expected .*, got 'within'"),
    ],
)
def test_angles_that_are_written_wrong_are_refused_at_their_column(text: str, message: str) -> None:
    with pytest.raises(FormulaError, match=message):
        parse(text)
