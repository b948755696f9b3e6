"""CasADi's warnings of evaluations that are no number, kept for the solver's log: none of them is for a terminal.

CasADi writes to ``sys.stderr``, a warning in many pieces from its stamp to the end of its line.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

STAMP = "CasADi - "
"""What a warning begins with."""
MOST = 500
"""Warnings that are kept of one solve; the others are counted."""


class Sieve:
    """A stream that keeps warnings and passes everything else on.

    Parameters
    ----------
    through : text stream or None
        Where everything else goes; nowhere without it.
    """

    def __init__(self, through: Any) -> None:
        self.through = through
        self.lines: list[str] = []
        self.count = 0
        self._line = ""

    def write(self, text: str) -> int:
        """Keep a piece of a warning, or pass a text on."""
        if not self._line and not text.startswith(STAMP):
            return len(text) if self.through is None else int(self.through.write(text))
        self._line += text
        if text.endswith("\n"):
            self.count += 1
            if self.count <= MOST:
                self.lines.append(self._line)
            self._line = ""
        return len(text)

    def flush(self) -> None:
        """Flush the stream behind."""
        if self.through is not None:
            self.through.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.through, name)

    def text(self) -> str:
        """The warnings, and how many more there were."""
        more = self.count - len(self.lines)
        return "".join(self.lines) + (f"... and {more} more warnings\n" if more else "")


@contextmanager
def kept_warnings(log: Path | None) -> Iterator[None]:
    """Within: warnings are kept, and appended to `log` in the end, as far as the disk holds them."""
    before = sys.stderr
    sieve: Any = Sieve(before)
    sys.stderr = sieve
    try:
        yield
    finally:
        if sys.stderr is sieve:
            sys.stderr = before
        if log is not None and sieve.count:
            with suppress(OSError), log.open("a", encoding="utf-8") as file:
                file.write(sieve.text())
