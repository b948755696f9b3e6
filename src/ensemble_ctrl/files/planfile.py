"""One plan in one ``.npz`` file, without pickle: controls, problem file and facts."""

from __future__ import annotations

import io
import json
import os
from math import prod
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.storage import put_file, read_regular
from ensemble_ctrl.core.values import numbers
from ensemble_ctrl.core.version import __version__

Floats = NDArray[np.float64]

MOST_BYTES = 50_000_000
"""Largest file, and largest array in it once it is unpacked: ten times what the largest problem takes."""
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


RENAMED = {"soonest": "minimum_time"}
"""Details that files of an earlier version have under another name, and their name today."""


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
    put_file(path, content.getvalue())


def read(path: Path) -> Saved:
    """Read one plan.

    Raises
    ------
    ProblemError
        If the file is missing, or is not a whole plan.
    """
    try:
        content = read_regular(path, MOST_BYTES)
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
    with ZipFile(io.BytesIO(content)) as archive:
        controls, problem, facts = (_array(archive, name) for name in ("controls", "problem", "facts"))
    read = json.loads(str(facts))
    details = {RENAMED.get(name, name): value for name, value in read["details"].items()}
    return Saved(numbers("controls", controls), str(problem), str(read["status"]), details)


def _array(archive: ZipFile, name: str) -> NDArray[Any]:
    """One array of an archive; its size is known, and judged, before any of it is unpacked."""
    size = archive.getinfo(f"{name}.npy").file_size
    if size > MOST_BYTES:
        raise ValueError(f"{name}: expected at most {MOST_BYTES} bytes, got {size}")
    with archive.open(f"{name}.npy") as packed:
        raw = io.BytesIO(packed.read(MOST_BYTES))
    shape, _, kind = _HEADERS[np.lib.format.read_magic(raw)](raw)
    if prod(shape) * kind.itemsize != size - raw.tell():
        raise ValueError(f"{name}: expected {shape} values, got other bytes")
    raw.seek(0)
    return np.asarray(np.lib.format.read_array(raw, allow_pickle=False))
