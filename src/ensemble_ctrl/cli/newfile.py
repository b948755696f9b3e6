"""Files that the command makes for a user: never over one that is there, never half of one."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.core.storage import put_file


def write_new(path: Path, content: str | bytes) -> None:
    """Write a new file.

    Raises
    ------
    EnsembleError
        If it is there already, or can't be written.
    """
    try:
        put_file(path, content, new=True)
    except FileExistsError:
        kind = "a folder of this name" if path.is_dir() else "this file"
        raise EnsembleError(f"{path}: {kind} exists already; nothing was written") from None
    except (OSError, ValueError) as error:
        raise EnsembleError(f"{path}: can't be written ({getattr(error, 'strerror', None) or error})") from None
