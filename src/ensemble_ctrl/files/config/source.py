"""Where a problem's text comes from: a file, stdin, or an open file."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import IO

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.storage import NotRegular, read_regular
from ensemble_ctrl.core.values import shown
from ensemble_ctrl.files.config.errors import FieldError, show, suggestion
from ensemble_ctrl.files.config.tree import Place, TextError

MAX_BYTES = 1_000_000
MAX_MAP_BYTES = 5_000_000
_LINE_ENDS = re.compile("\r\n|[\r\x85\u2028\u2029]")
Source = str | os.PathLike[str] | IO[str] | IO[bytes]


@dataclass(frozen=True)
class Text:
    """A problem's text with plain line ends, what to call it, and where its relative file names start."""

    name: str
    content: str
    folder: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "content", _LINE_ENDS.sub("\n", self.content))


def name_of(source: Source) -> str:
    """What messages call a source."""
    if isinstance(source, str | os.PathLike):
        return "<stdin>" if source == "-" else os.fspath(source)
    name = getattr(source, "name", "<text>")
    return name if isinstance(name, str) else "<text>"


def read_source(source: Source) -> Text:
    """The text of a source; ``-`` is stdin.

    Raises
    ------
    TextError
        If it can't be read, is too large, or is not text.
    """
    if not isinstance(source, str | os.PathLike) and not hasattr(source, "read"):
        raise ProblemError(f"problem: expected the path of a file, or an open file, got {shown(source)}")
    name = name_of(source)
    if isinstance(source, str | os.PathLike) and source != "-":
        path = Path(source)
        return Text(name, text_of(read_bytes(path)), path.parent)
    stream = _stdin() if isinstance(source, str | os.PathLike) else source
    try:
        content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise TextError(f"can't be read: {error}") from None
    return Text(name, text_of(content if isinstance(content, bytes) else content.encode()), Path(name).parent)


def _stdin() -> IO[bytes]:
    """The bytes of standard input."""
    if sys.stdin is None:  # it was closed before this program began
        raise TextError("standard input is closed")
    return sys.stdin.buffer


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """The first bytes of a file, one more than are allowed if it has them."""
    try:
        return read_regular(path, most)
    except NotRegular as error:
        hint = "give a program's output as - (standard input), or put it into a file first"
        raise TextError(f"can't be read: {error.strerror}", hint=hint) from None
    except FileNotFoundError:
        raise TextError("no such file", hint=_similar(path)) from None
    except IsADirectoryError:
        raise TextError("this is a folder", hint="name a file in it") from None
    except (OSError, ValueError) as error:
        raise TextError(f"can't be read: {getattr(error, 'strerror', None) or error}") from None


def checked_path(folder: Path, name: str) -> Path:
    """The path of a file that another one in `folder` names: in that folder or below it, links followed.

    Raises
    ------
    FieldError
        If it is elsewhere.
    """
    path = folder / name
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
        readable = path.is_file() or path.is_dir() or not path.exists()
    except (OSError, ValueError, RuntimeError) as error:
        raise FieldError(f"expected the name of a file, got {show(name)} ({error})") from None
    if not inside:
        raise FieldError(f"expected a file in the same folder or below, got {show(name)}", "copy it there")
    if not readable:  # a pipe would keep us waiting
        raise FieldError(f"expected the name of a file, got {show(name)}, which is none")
    return path


def text_of(content: bytes, most: int = MAX_BYTES) -> str:
    """Bytes as text."""
    if len(content) > most:
        limit = most // 1_000_000
        hint = "put large shapes in a `file` of their own" if most == MAX_BYTES else "cut out what you need"
        raise TextError(f"expected at most {limit} MB, got more", hint=hint)
    if b"\0" in content[:10_000] and not content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise TextError("expected a text file, got a binary one")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TextError("expected UTF-8", _place(content, error.start), "save the file with that encoding") from None
    return text


def _place(content: bytes, index: int) -> Place:
    """Line and column of a byte."""
    before = content[:index]
    return Place(before.count(b"\n") + 1, index - before.rfind(b"\n"))


def _similar(path: Path) -> str:
    """A file of a similar name in the same folder, as a hint."""
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return ""
    return suggestion(path.name, names)
