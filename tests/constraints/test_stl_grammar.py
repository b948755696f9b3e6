"""The parser against lark with ``grammar.lark``: the same texts, the same trees, errors no later."""

import re
from collections.abc import Callable

from hypothesis import example, given
from hypothesis import strategies as st

from ensemble_ctrl.constraints.stl import Formula, FormulaError, parse
from tests.examples import examples

from . import lark_oracle
from .stl_strategies import texts

OPERANDS = ["x >= 1", "x<y", "in(goal)", "avoid ( a-b.c )", "(x)", "x", "2", "1.5e3*y > - x", "mean(x>1)"]
TOKENS = re.findall(
    r"\S+",
    "x y x1 and or not U F G T in avoid mean share until always eventually goal a-b.c ç _ 0 1 2.5 .5 1e3 "
    "1e999 ( ( ( ) ) ) [ ] , : [0,1] [0:T] _[0,1] [T-1,T] [1ms,2] ms min [2,1] >= <= > < = == => -> "
    "<-> iff xor implies finally globally <> [] ~ /\\ \\/ ! & && | || + - * / share( in( mean( $ .",
)
BINARY = (" and ", "&", "&& ", " or ", "|", " ||", "=>", " -> ", " implies ", " iff ", " <-> ", "<=>", " xor ")
soups = st.lists(st.sampled_from([*TOKENS, *OPERANDS]), min_size=1, max_size=14)
blanks = st.sampled_from([" ", "", "\n", "\t "])


@st.composite
def token_soups(draw: st.DrawFn) -> str:
    """Tokens in any order."""
    return "".join(token + draw(blanks) for token in draw(soups))


@st.composite
def near_formulas(draw: st.DrawFn) -> str:
    """A formula's text with a few tokens taken out, doubled or put in."""
    words = str(draw(texts())).replace("(", " ( ").replace(")", " ) ").split(" ")
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.integers(0, len(words) - 1))
        words[place : place + draw(st.integers(0, 1))] = draw(st.lists(st.sampled_from(TOKENS), max_size=2))
        words = words or [""]
    return draw(blanks).join(words)


@st.composite
def sentences(draw: st.DrawFn) -> str:
    """Texts from the grammar, with every spelling."""

    def pick(*words: str) -> str:
        return draw(st.sampled_from(words))

    def some() -> range:
        return range(draw(st.sampled_from([0, 0, 0, 1, 2])))

    def window() -> str:
        return pick("", "", "[0,1]", "[ 0.5 , T ]", "_[T,T]", "[1,.5]", "[T-2:T]", "[1 s, 2min]", "[0,500ms]", "[1,3h]")

    def factor(depth: int) -> str:
        if depth and draw(st.booleans()):
            return f"({total(depth - 1)})"
        return pick("x", "y", "z_1", "2", "0.5", "3e0", "1", "(x)", "(-2)")

    def product(depth: int) -> str:
        more = [pick("*", "/", " * ") + pick("2", "1.5", factor(depth)) for _ in some()]
        return "".join([factor(depth), *more])

    def total(depth: int) -> str:
        more = [pick("+", " - ") + product(depth) for _ in some()]
        return "".join([pick("", "", "-", "+ "), product(depth), *more])

    def formula(depth: int) -> str:
        if not depth:
            comparison = total(2) + pick(">=", "<=", " > ", "<") + total(1) + pick("", "", ">y", "<= 2")
            return pick("x>=1", "y < 2", "in(goal)", "avoid(U)", comparison)
        left, right = formula(depth - 1), formula(depth - 1)
        return pick(
            left,
            left + pick(*BINARY) + right,
            left + pick(" U", " until") + window() + " " + right,
            pick("F", "G ", "always", "eventually", "finally", "globally", "<>", "[]") + window() + " " + left,
            pick("not ", "!", "~") + left,
            pick("mean(", "share(0.5,", "share( 1 ,", "(", " ( ", "(") + left + ")",
        )

    return formula(draw(st.integers(0, 3)))


def outcome(read: Callable[[str], Formula], text: str) -> Formula | FormulaError:
    try:
        return read(text)
    except FormulaError as error:
        return error


def shape(formula: Formula) -> tuple[object, ...]:
    """Everything there is in a formula, columns included."""
    return type(formula), getattr(formula, "column", None), str(formula), *map(shape, formula.parts)


@examples(200)
@given(token_soups() | near_formulas() | sentences())
@example("x >= 1 -> x >= 2")
@example("((x + 1)) * 2 >= (1) => ((x > 1))")
@example("-(x >= 1)")
@example("x >= (y >= 1)")
@example("(x) and x >= 1")
@example("mean(x)")
@example("x * -1 >= 2")
@example("x - > 1")
@example("F[0,1")
@example("share(1,x>=1")
@example("in(")
def test_lark_agrees(text: str) -> None:
    wanted, got = outcome(lark_oracle.parse, text), outcome(parse, text)
    if isinstance(wanted, Formula):
        assert isinstance(got, Formula), f"{text!r}: {got}"
        assert got == wanted
        assert shape(got) == shape(wanted)
        return
    assert isinstance(got, FormulaError), f"{text!r} was read as {got}, but lark says: {wanted}"
    assert got.column >= 1
    if isinstance(wanted, lark_oracle.SyntaxProblem):
        assert got.column <= wanted.column  # a word that can't be a state is refused at once
