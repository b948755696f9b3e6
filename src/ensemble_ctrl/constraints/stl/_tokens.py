"""A task's text in tokens, and the error for what can't be read."""

from __future__ import annotations

import re
from typing import NamedTuple

from ensemble_ctrl.errors import ProblemError

_TOKEN = re.compile(
    r"""\s* (?: ( (?:\d+\.?\d*|\.\d+) (?:[eE][+-]?\d+)? )
              | ( [^\W\d]\w* | => | -> | >= | <= | \|\|? | &&? | [-+*/()\[\],!<>] )
              | ( \S ) | )""",
    re.VERBOSE,
)
_GROUPS = ("", "number", "", "other")
_PLACE = re.compile(r"\s*([^\W\d][\w.-]*)")
_SPELLINGS = {
    "=>": "=> ->",
    "or": "or | ||",
    "and": "and & &&",
    "U": "U until",
    "not": "not !",
    "F": "F eventually",
    "G": "G always",
    "compare": ">= <= > <",
    "sign": "+ -",
    "times": "* /",
}
_KINDS = {text: kind for kind, texts in _SPELLINGS.items() for text in texts.split()} | {
    text: text for text in ["in", "avoid", "mean", "share", "T", *"()[],"]
}


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


class Token(NamedTuple):
    """One token.

    Attributes
    ----------
    kind : str
        A word or bracket of the language in its shortest spelling, ``number``, ``name``, ``place``,
        ``compare``, ``sign``, ``times``, ``end``, or ``other`` for what is no token.
    text : str
        As it was written.
    column : int
        1-based.
    """

    kind: str
    text: str
    column: int

    def refused(self, expected: str) -> FormulaError:
        """The error that something else should have been here."""
        return FormulaError(self.column, expected, "the end of the text" if self.kind == "end" else repr(self.text))


class Tokens:
    """The tokens of a text, one by one."""

    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0

    def next(self) -> Token:
        """The next token; ``end`` at the end, as often as it is asked for."""
        match = _TOKEN.match(self._text, self._at)
        if match is None or match.lastindex is None:
            return Token("end", "", len(self._text.rstrip()) + 1)
        start, self._at = match.span(match.lastindex)
        text = self._text[start : self._at]
        kind = _GROUPS[match.lastindex] or _KINDS.get(text, "name")
        return Token(kind, text, start + 1)

    def take(self, kind: str, expected: str) -> Token:
        """The next token, which has to be of a kind."""
        token = self.next()
        if token.kind != kind:
            raise token.refused(expected)
        return token

    def skip(self, kind: str) -> bool:
        """Whether the next token is of a kind; only then it is passed."""
        before = self._at
        found = self.next().kind == kind
        if not found:
            self._at = before
        return found

    def place(self) -> Token:
        """The name of a place, which may be a word of the language."""
        match = _PLACE.match(self._text, self._at)
        if match is None:
            raise self.next().refused("a name")
        self._at = match.end()
        return Token("place", match[1], match.start(1) + 1)
