"""One plan in one ``.npz`` file, without pickle: controls, problem file and facts."""

from __future__ import annotations

import io
import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl._version import __version__
from ensemble_ctrl.errors import ProblemError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Saved:
    """What a file holds.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
        Commands of every step.
    problem : str
        The problem file's text.
    status : str
        How the search ended.
    details : dict
        What the search did.
    """

    controls: Floats
    problem: str
    status: str
    details: dict[str, Any]


def path_of(path: str | os.PathLike[str]) -> Path:
    """The file meant by the name of a file, of a file without ``.npz``, or of a results folder."""
    path = Path(path)
    if path.is_dir():
        return path / "plan.npz"
    longer = path.with_name(path.name + ".npz") if path.name else path
    return longer if not path.exists() and longer.exists() else path


def write(path: Path, saved: Saved) -> None:
    """Write one plan; a failed write leaves neither a part of a file nor an earlier file changed."""
    facts = json.dumps({"version": __version__, "status": saved.status, "details": saved.details})
    content = io.BytesIO()
    np.savez(content, controls=saved.controls, problem=np.array(saved.problem), facts=np.array(facts))
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(content.getbuffer())
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def read(path: Path) -> Saved:
    """Read one plan.

    Raises
    ------
    ProblemError
        If the file is missing, or is not a whole plan.
    """
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        found = "a folder without one" if path.name == "plan.npz" and path.parent.is_dir() else "no such file"
        raise ProblemError(f"{path}: expected a saved plan, found {found}") from None
    except (OSError, ValueError) as error:
        raise ProblemError(f"{path}: can't be read ({getattr(error, 'strerror', None) or error})") from None
    try:
        return _parsed(content)
    except Exception:  # NumPy and zipfile raise whatever comes on damaged bytes
        raise ProblemError(f"{path}: expected a plan.npz of this package, got another file or a damaged one") from None


def _parsed(content: bytes) -> Saved:
    """The plan in a file's bytes."""
    with np.load(io.BytesIO(content), allow_pickle=False) as data:
        facts = json.loads(str(data["facts"]))
        return Saved(
            np.asarray(data["controls"], dtype=float),
            str(data["problem"]),
            str(facts["status"]),
            dict(facts["details"]),
        )
