"""Read a formula from text.

From loose to tight: ``=>``, ``or``/``|``, ``and``/``&``, ``U``, then ``not``/``!``, ``F``, ``G``; so
``F[0,5] a and b`` is ``(F[0,5] a) and b``. ``=>`` and ``U`` group to the right. A window is ``[a,b]`` in
seconds, ``T`` is the duration, no window is the whole horizon. The grammar is in ``grammar.lark``.
"""

from __future__ import annotations

import math
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.errors import ProblemError

if TYPE_CHECKING:
    from lark import Lark

WORDS = {
    "NUMBER": "a number",
    "TIME": "T",
    "NAME": "a state",
    "PLACE": "a name",
    "_LPAR": "'('",
    "_LSQB": "'['",
    "_RSQB": "']'",
    "_COMMA": "','",
    "COMPARE": "'>=', '<='",
    "SIGN": "'+'",
    "TIMES": "'*'",
    "_AND": "'and'",
    "_OR": "'or'",
    "IMPLIES": "'=>'",
    "UNTIL": "'U'",
    "_RPAR": "')'",
    "$END": "the end",
}
OPERAND = frozenset({"NOT", "EVENTUALLY", "ALWAYS", "IN", "AVOID", "MEAN", "SHARE"})


class FormulaError(ProblemError):
    """A task's text can't be read, or a name in it is unknown.

    Attributes
    ----------
    column : int
        1-based place in the text, counted over line ends too; 0 for a formula that was built in Python.
    expected : str
        What would have been right there, in words.
    """

    def __init__(self, column: int, expected: str, came: str) -> None:
        self.column, self.expected, self.came = column, expected, came
        where = f"column {column}: " if column else ""
        super().__init__(f"{where}expected {expected}, got {came}")

    def __reduce__(self) -> tuple[type[FormulaError], tuple[int, str, str]]:
        return type(self), (self.column, self.expected, self.came)


def parse(text: str) -> Formula:
    """Read a formula.

    Parameters
    ----------
    text : str
        For example ``"F[14, 16] in(goal) and G[0, 16] avoid(obstacles)"``.

    Returns
    -------
    Formula
        With the columns of `text` in its leaves and temporal operators.

    Raises
    ------
    FormulaError
        With the column of the first mistake and what would have been right there.

    Notes
    -----
    Time and memory grow in proportion to the text (LALR(1)).

    Examples
    --------
    >>> str(parse("eventually[1, T] x + 2*y <= 3 => !in(goal)"))
    'not F[1,T] -x - 2*y >= -3 or not in(goal)'
    """
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    if not text.strip():
        raise FormulaError(1, "a formula", "an empty text")
    try:
        result = _parser().parse(text)
    except UnexpectedToken as error:
        at_end = error.token.type == "$END"
        column = len(text.rstrip()) + 1 if at_end else (error.token.start_pos or 0) + 1
        came = "the end of the text" if at_end else repr(str(error.token))
        raise FormulaError(column, _in_words(error.accepts or error.expected), came) from None
    except UnexpectedCharacters as error:
        place = error.pos_in_stream or 0
        raise FormulaError(place + 1, _in_words(error.allowed or set()), repr(text[place])) from None
    assert isinstance(result, Formula)
    return result


@cache
def _parser() -> Lark:
    """The parser, built at its first use."""
    from lark import Lark

    from ensemble_ctrl.constraints.stl._build import Builder

    grammar = resources.files(__package__).joinpath("grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", start="formula", transformer=Builder(), maybe_placeholders=True)


def _in_words(terminals: set[str]) -> str:
    """The terminals a parser would accept, for a person; none are left once a formula is whole."""
    names = set(terminals) or {"$END"}
    words = []
    if names >= OPERAND:
        words.append("a formula")
        names -= OPERAND | {"NUMBER", "NAME", "SIGN", "_LPAR"}
    words += [word for name, word in WORDS.items() if name in names]
    return " or ".join(words) if len(words) < 3 else ", ".join(words[:-1]) + " or " + words[-1]


def time_value(text: str) -> float:
    """Seconds, or infinity for ``T``."""
    return math.inf if text == "T" else float(text)
