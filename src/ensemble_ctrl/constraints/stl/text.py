"""Read a formula from text.

From loose to tight::

    formula = implied ["iff" formula]                  also "xor"
    implied = or ["=>" implied]
    or      = and {"or" and}
    and     = until {"and" until}
    until   = unary ["U" [window] until]
    unary   = "not" unary
            | ("F" | "G") [window] unary
            | "(" formula ")" | "mean" "(" formula ")" | "share" "(" number "," formula ")"
            | "in" "(" place ")" | "avoid" "(" place ")" | "apart" "(" number [unit] ")" | "true" | "false"
            | sum compare sum {compare sum}            compare is ">=", "<=", ">" or "<"
            | state "within" angle "of" ["+" | "-"] angle    whole turns aside
    window  = "[" time ("," | ":") time "]"            without one, the rest of the horizon
    time    = number [unit] | "T" ["-" number [unit]]  T is the duration; "inf)" may end a window
    sum     = ["+" | "-"] product {("+" | "-") product}
    product = factor {("*" | "/") factor}              linear in the states
    factor  = angle | state | "(" sum ")" | "abs" "(" sum ")"
    angle   = number ["deg" | "rad"]

Other spellings of the words and symbols are in `_tokens.SPELLINGS`. So ``F[0,5] a and b`` is ``(F[0,5] a) and b``,
and ``iff``, ``=>`` and ``U`` group to the right. A state is a letter and then letters, digits and ``_``; a place may
have ``.`` and ``-`` too, and be a word of the language.
"""

from __future__ import annotations

import math

from ensemble_ctrl.constraints.stl._build import Operand, Operator, Sum, built
from ensemble_ctrl.constraints.stl._tokens import FormulaError, Token, Tokens
from ensemble_ctrl.constraints.stl._window import read_window
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.constraints.stl.leaves import Apart, Avoid, Inside, Known, Within
from ensemble_ctrl.core.errors import ProblemError, shortened
from ensemble_ctrl.core.values import expect

__all__ = ["FormulaError", "parse"]

LEVELS = {"iff": 1, "xor": 1, "=>": 2, "or": 3, "and": 4, "U": 5, "not": 6, "F": 6, "G": 6} | {
    "compare": 7,
    "sign": 8,
    "times": 9,
}
"""How tightly an operator binds; open brackets are at 0."""

UNARY, COMPARE, SIGN = LEVELS["not"], LEVELS["compare"], LEVELS["sign"]
_LISTS = ("and", "or", "=>", "compare")
"""Operators that become one with more operands where they follow each other."""

_BINARY = ("and", "or", "=>", "iff", "xor", "U")
_AT_TOP, _IN_BRACKET = (*_BINARY, "end"), (*_BINARY, ")")
_SUMS = ("sum(", "abs")
"""Open brackets that hold a sum."""

WORDS = {
    "compare": "'>=', '<='",
    "sign": "'+'",
    "times": "'*'",
    "and": "'and'",
    "or": "'or'",
    "=>": "'=>'",
    "U": "'U'",
    ")": "')'",
    "end": "the end",
}


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
    Time and memory grow in proportion to the text: one pass over the tokens, by operator precedence, with
    stacks of its own in place of recursion.

    Examples
    --------
    >>> str(parse("eventually[1, T] x + 2*y <= 3 => !in(goal)"))
    'not F[1,T] -x - 2*y >= -3 or not in(goal)'
    """
    if not expect("formula", text, str, "text").strip():
        raise FormulaError(1, "a formula", "an empty text")
    return _Parser(text).formula()


class _Parser:
    """What was read: operands, and the operators and brackets that wait for their last operand."""

    def __init__(self, text: str) -> None:
        self._tokens = Tokens(text)
        self._operands: list[Operand] = []
        self._waiting = [Operator("end", 0, 1, 1)]
        self._brackets = 0

    def formula(self) -> Formula:
        """The whole text's formula."""
        while self._waiting:
            self._read_operand()
            while self._waiting and not self._read_operator():
                pass
        (result,) = self._operands
        if isinstance(result, Known):
            fact = "true" if result.value > 0 else "false"
            raise FormulaError(1, "a formula about a state or a place", f"one that is always {fact}")
        assert isinstance(result, Formula)
        return result

    def _read_operand(self) -> None:
        """Read up to the end of a leaf, a number or a state, with the operators and brackets before it."""
        while True:
            token, before = self._tokens.next(), self._waiting[-1]
            kind, column = token.kind, token.column
            whole = before.level <= UNARY and before.kind not in _SUMS  # the place takes any formula
            if kind == "name" or kind == "number":
                self._operands.append(_factor(token, self._tokens))
                return
            if kind == "(":
                self._wait(Operator("(" if whole else "sum(", 0, column, 1))
            elif kind == "sign" and before.level < SIGN:
                self._wait(Operator(kind, SIGN, column, 1, token.text))
            elif whole and (kind == "in" or kind == "avoid"):
                self._operands.append(self._place(kind))
                return
            elif whole and kind == "apart":
                self._operands.append(self._apart())
                return
            elif kind == "abs":
                self._tokens.take("(", "'('")
                self._wait(Operator(kind, 0, column, 1))
            elif whole and (kind == "true" or kind == "false"):
                self._operands.append(Known(math.inf if kind == "true" else -math.inf))
                return
            elif whole and kind in ("not", "F", "G", "mean", "share"):
                self._wait(self._prefix(token))
            else:
                raise token.refused(_operand_words(before, token, whole))

    def _place(self, kind: str) -> Formula:
        """The rest of a leaf about a place."""
        self._tokens.take("(", "'('")
        place = self._tokens.place()
        self._tokens.take(")", "')'")
        return (Inside if kind == "in" else Avoid)(place.text, column=place.column)

    def _apart(self) -> Formula:
        """The rest of ``apart(distance)``."""
        self._tokens.take("(", "'('")
        number = self._tokens.take("number", "a distance")
        distance = float(number.text) * self._tokens.length_unit()
        self._tokens.take(")", "')', or a unit (m, cm, mm)")
        if not 0 < distance < math.inf:
            raise FormulaError(number.column, "a distance above 0 m", number.text)
        return Apart(distance, column=number.column)

    def _prefix(self, token: Token) -> Operator:
        """An operator in front of a formula, with its window, or its share and bracket."""
        operator = Operator(token.kind, LEVELS.get(token.kind, 0), token.column, 1)
        if token.kind == "F" or token.kind == "G":
            operator.window = read_window(self._tokens)
        elif token.kind != "not":
            self._tokens.take("(", "'('")
        if token.kind == "share":
            p = self._tokens.take("number", "a number")
            operator.share = float(p.text)
            if not 0 < operator.share <= 1:
                hint = f"write {operator.share / 100:g}, if percent is meant" if 1 < operator.share <= 100 else ""
                raise FormulaError(p.column, "a share above 0 and up to 1", p.text, hint)
            self._tokens.take(",", "','")
        return operator

    def _read_operator(self) -> bool:
        """Read what may follow an operand; whether another operand has to follow that."""
        token = self._tokens.next()
        kind, possible = token.kind, self._possible()
        if kind not in possible:
            raise token.refused(_listed([word for name, word in WORDS.items() if name in possible]))
        if kind == ")" or kind == "end":
            self._combine(1)
            self._brackets -= 1
            self._apply(self._waiting.pop())
            return False
        if kind == "within":
            self._combine(COMPARE + 1)
            self._operands[-1] = self._within(token)
            return False
        level = LEVELS[kind]
        self._combine(level if level > COMPARE else level + 1)  # and, or, => become one list; U groups right
        if kind == self._waiting[-1].kind and kind in _LISTS:
            self._waiting[-1].chain(token)
            return True
        operator = Operator(kind, level, token.column, 2, token.text)
        if kind == "U":
            operator.window = read_window(self._tokens)
        elif kind == "compare":
            left = self._operands[-1]
            assert isinstance(left, Sum)
            operator.column = left.column
        self._wait(operator)
        return True

    def _within(self, token: Token) -> Within:
        """The rest of ``state within angle of angle``."""
        angle = self._operands[-1]
        assert isinstance(angle, Sum)
        if list(angle.terms.values()) != [1.0] or angle.offset or angle.bars:
            raise FormulaError(angle.column, "the name of one angle before 'within'", "an expression")
        (state,) = angle.terms
        number = self._tokens.take("number", "a number")
        half = float(number.text) * self._tokens.angle_unit()
        of = self._tokens.next()
        if of.text != "of":
            raise of.refused("'of', or a unit (deg, rad)", "write  heading within 10 deg of 90 deg")
        sign = self._tokens.skip("sign")
        centre = float(self._tokens.take("number", "a number").text) * self._tokens.angle_unit()
        if sign is not None and sign.text == "-":
            centre = -centre
        try:
            return Within(state, half, centre, column=angle.column)
        except ProblemError as error:
            wanted, _, came = str(error).partition(": expected ")[2].rpartition(", got ")
            raise FormulaError(number.column, wanted, came, _plain_degrees(number, half)) from None

    def _possible(self) -> tuple[str, ...]:
        """The kinds of token that may follow what was read last."""
        after_formula = _IN_BRACKET if self._brackets else _AT_TOP
        if not isinstance(self._operands[-1], Sum):
            return after_formula
        place = -1
        while self._waiting[place].level > COMPARE:
            place -= 1
        match self._waiting[place].kind:
            case "compare":
                return ("compare", "sign", "times", *after_formula)
            case "sum(" | "abs":
                return ("sign", "times", ")")
            case "(":
                return ("compare", "sign", "times", "within", ")")
        return ("compare", "sign", "times", "within")

    def _wait(self, operator: Operator) -> None:
        """Keep an operator or an open bracket until its last operand is read."""
        self._brackets += operator.level == 0
        self._waiting.append(operator)

    def _combine(self, level: int) -> None:
        """Apply the waiting operators that bind at least this tightly."""
        while self._waiting[-1].level >= level:
            self._apply(self._waiting.pop())

    def _apply(self, operator: Operator) -> None:
        """Put an operator on the operands read last."""
        self._operands[-operator.count :] = [built(operator, self._operands[-operator.count :])]


def _plain_degrees(number: Token, half: float) -> str:
    """A hint for what may be degrees without their unit."""
    plain = half == float(number.text) and math.pi <= half < 180
    return f"write {number.text} deg, if degrees are meant" if plain else ""


def _factor(token: Token, tokens: Tokens) -> Sum:
    """A number, with the unit of an angle if there is one, or a state."""
    if token.kind == "name":
        return Sum({token.text: 1.0}, 0.0, token.column)
    value = float(token.text) * tokens.angle_unit()
    if math.isinf(value):
        raise FormulaError(token.column, "a finite number", shortened(token.text))
    return Sum({}, value, token.column)


def _operand_words(before: Operator, token: Token, whole: bool) -> str:
    """What should have been in an operand's place."""
    if not whole:
        return "a number, a state, '(' or '+'" if before.level < SIGN else "a number, a state or '('"
    if token.text == "T":
        return "a state's name"
    return "a formula or '['" if before.kind in ("F", "G", "U") and before.window is None else "a formula"


def _listed(words: list[str]) -> str:
    """Alternatives for a person."""
    return " or ".join(words) if len(words) < 3 else ", ".join(words[:-1]) + " or " + words[-1]
