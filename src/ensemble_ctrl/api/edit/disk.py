"""The file of an editor: read, watched, and written only over what was read."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ensemble_ctrl.core.errors import ConfigError, EnsembleError
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config.source import Text, read_bytes, text_of
from ensemble_ctrl.files.config.tree import TextError

_BOM = b"\xef\xbb\xbf"


class DiskChangedError(EnsembleError):
    """The file was changed by someone else since it was read."""


class Disk:
    """A file, with what was last read of it or written to it.

    Parameters
    ----------
    path : Path
        Links are followed once, here.

    Attributes
    ----------
    changed : bool
        Whether it holds something else now, as far as was looked.
    missing : bool
        Whether it is not there now, though it was.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self.changed = self.missing = False
        self._known: str | None = None
        self._crlf = self._bom = False

    def read(self) -> str:
        """Its text, with plain line ends.

        Raises
        ------
        ConfigError
            If it can't be read, or is no text of a problem file's size.
        """
        try:
            content = read_bytes(self.path)
            text = text_of(content)
        except TextError as error:
            raise ConfigError(f"{self.path.name}: {error.message}") from None
        self._known, self.changed, self.missing = _digest(content), False, False
        self._crlf, self._bom = b"\r\n" in content, content.startswith(_BOM)
        return Text(self.path.name, text, self.path.parent).content

    def look(self) -> bool:
        """Whether it holds something else than what was read or written last."""
        now = self._digest()
        self.missing = now is None and self._known is not None
        self.changed = now != self._known
        return self.changed

    def write(self, text: str, force: bool = False) -> None:
        """Write it as a whole, with the line ends that it had.

        Raises
        ------
        DiskChangedError
            If it holds something else than what was read or written last, unless `force`.
        OSError
            If it can't be written.
        """
        if self.look() and not self.missing and not force:
            raise DiskChangedError(f"{self.path.name} was changed on disk meanwhile: load that, or overwrite it")
        content = (text.replace("\n", "\r\n") if self._crlf else text).encode("utf-8")
        content = _BOM + content if self._bom else content
        put_file(self.path, content)
        self._known, self.changed, self.missing = _digest(content), False, False

    def _digest(self) -> str | None:
        """What it holds now, in one word; None without a file."""
        try:
            return _digest(read_bytes(self.path))
        except TextError:
            return None


def _digest(content: bytes) -> str:
    """Bytes in one word."""
    return hashlib.sha256(content).hexdigest()
