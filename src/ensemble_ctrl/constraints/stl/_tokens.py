"""A task's text in tokens, and the error for what can't be read."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from ensemble_ctrl.constraints.stl._hints import hint_for
from ensemble_ctrl.core.errors import ProblemError, shortened

_TOKEN = re.compile(
    r"""\s* (?: ( (?:\d+\.?\d*|\.\d+) (?:[eE][+-]?\d+)? )
              | ( [^\W\d]\w*?(?=_\s*\{?\s*\[) | [^\W\d]\w*
                | <-> | <=> | => | -> | >= | <= | == | != | <> | \[\] | /\\ | \\/ | \|\|? | &&? | \*\*
                | [-+*/^()\[\]{},:!~<>=] | [¬∧∨→⇒↔⇔□◇◊≤≥≠−·×∞] )
              | ( \S ) | )""",
    re.VERBOSE,
)
_GROUPS = ("", "number", "", "other")
_PLACE = re.compile(r"\s*([^\W\d][\w.-]*)")
_OPEN = re.compile(r"\s*(?:_\s*)?(\{?)\s*\[(?!\])")
SPELLINGS = {
    "iff": "iff <-> <=> ↔ ⇔",
    "xor": "xor",
    "=>": "=> -> implies → ⇒",
    "or": "or | || ∨ \\/",
    "and": "and & && ∧ /\\",
    "U": "U until",
    "not": "not ! ~ ¬",
    "F": "F eventually finally <> ◇ ◊",
    "G": "G always globally [] □",
    "compare": ">= <= > < ≥ ≤",
    "sign": "+ - −",
    "times": "* / · ×",
    "true": "true",
    "false": "false",
    "T": "T inf ∞",
}
"""Every spelling of a token, the one that is printed first."""

_KINDS: dict[str, str] = {text: kind for kind, texts in SPELLINGS.items() for text in texts.split()} | {
    text: text for text in ["in", "avoid", "apart", "mean", "share", "abs", "within", *"()[]{},:"]
}
_OPERATORS = {text for kind in SPELLINGS if kind not in ("T", "U", "F", "G") for text in SPELLINGS[kind].split()} | {
    *("until", "eventually", "finally", "always", "globally")
}
"""Words that may be written in capitals, too: ``AND``, ``Always``."""

_STRANGE = frozenset(["==", "!=", "=", "≠", "^", "**"])
"""Symbols that the language has no use for, but a hint."""

ANGLE_UNITS = {"deg": math.pi / 180, "rad": 1.0}
"""Units of an angle by name, with the factor to radians."""
TIME_UNITS = {"s": (1, 1), "ms": (1, 1000), "min": (60, 1), "h": (3600, 1)}
"""Units of time by name, with the factor to seconds as numerator and denominator (500 ms are 500 / 1000)."""

LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0}
"""Units of length by name, with the factor to metres."""

_SYMBOLS = {"−": "-", "·": "*", "×": "*", "≥": ">=", "≤": "<=", "∞": "inf"}
"""Symbols by their text."""

RESERVED = frozenset(text for text in _KINDS if text.isidentifier())
"""Words of the language, which can't be a state's name."""


class FormulaError(ProblemError):
    """A task's text can't be read, or a name in it is unknown.

    Attributes
    ----------
    column : int
        1-based place in the text, counted over line ends too; 0 for a formula that was built in Python.
    expected : str
        What would have been right there, in words.
    came : str
        What is there.
    hint : str
        What to write instead, where that is known.
    """

    def __init__(self, column: int, expected: str, came: str, hint: str = "") -> None:
        self.column, self.expected, self.came, self.hint = column, expected, came, hint
        where = f"column {column}: " if column else ""
        super().__init__(f"{where}expected {expected}, got {came}" + (f"; {hint}" if hint else ""))

    def __reduce__(self) -> tuple[type[FormulaError], tuple[int, str, str, str]]:
        return type(self), (self.column, self.expected, self.came, self.hint)


class Token(NamedTuple):
    """One token.

    Attributes
    ----------
    kind : str
        A word or bracket of the language in its shortest spelling, ``number``, ``name``, ``place``,
        ``compare``, ``sign``, ``times``, ``end``, or ``other`` for what is no token.
    text : str
        As it was written; a symbol such as ``≤`` as ``<=``.
    column : int
        1-based.
    before : str
        The token before it.
    """

    kind: str
    text: str
    column: int
    before: str = ""

    def refused(self, expected: str, hint: str = "") -> FormulaError:
        """The error that something else should have been here, with a hint of its own or what is known of the token."""
        came = "the end of the text" if self.kind == "end" else shortened(repr(self.text))
        after_name = self.before.isidentifier() and _kind(self.before) == "name"
        return FormulaError(self.column, expected, came, hint or hint_for(self.before, self.text, after_name))


class Tokens:
    """The tokens of a text, one by one."""

    def __init__(self, text: str) -> None:
        self._text, self._at, self._last = text, 0, ""

    def next(self) -> Token:
        """The next token; ``end`` at the end, on every further call."""
        match, before = _TOKEN.match(self._text, self._at), self._last
        if match is None or match.lastindex is None:
            return Token("end", "", len(self._text.rstrip()) + 1, before)
        start, self._at = match.span(match.lastindex)
        text = self._last = self._text[start : self._at]
        kind = _GROUPS[match.lastindex] or _kind(text)
        return Token(kind, _SYMBOLS.get(text, text), start + 1, before)

    def take(self, kind: str, expected: str) -> Token:
        """The next token, which has to be of a kind."""
        token = self.next()
        if token.kind != kind:
            raise token.refused(expected)
        return token

    def skip(self, kind: str) -> Token | None:
        """The next token if it is of a kind; only then it is passed."""
        before = self._at, self._last
        token = self.next()
        if token.kind == kind:
            return token
        self._at, self._last = before
        return None

    def angle_unit(self) -> float:
        """Pass the unit of an angle, if one comes next: its factor to radians, 1 without."""
        before = self._at, self._last
        token = self.next()
        if token.text in ANGLE_UNITS:
            return ANGLE_UNITS[token.text]
        self._at, self._last = before
        return 1.0

    def length_unit(self) -> float:
        """Pass the unit of a length, if one comes next: its factor to metres, 1 without."""
        before = self._at, self._last
        token = self.next()
        if token.text in LENGTH_UNITS:
            return LENGTH_UNITS[token.text]
        self._at, self._last = before
        return 1.0

    def window(self) -> str | None:
        """Pass the opening of a window, ``[``, ``_[`` or ``_{[``; returns what has to follow its closing bracket."""
        match = _OPEN.match(self._text, self._at)
        if match is None:
            return None
        self._at, self._last = match.end(), "["
        return "}" if match[1] else ""

    def place(self) -> Token:
        """The name of a place, which may be a word of the language."""
        match = _PLACE.match(self._text, self._at)
        if match is None:
            raise self.next().refused("a name")
        self._at, self._last = match.end(), ""
        return Token("place", match[1], match.start(1) + 1)


def _kind(text: str) -> str:
    """The kind of a word or symbol."""
    if text.lower() in _OPERATORS and text in (text.upper(), text.capitalize()):
        text = text.lower()
    return _KINDS.get(text, "other" if text in _STRANGE else "name")
