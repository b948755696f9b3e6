"""What decides a result besides the unit: this package's own code, and the libraries that compute."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ensemble_ctrl.core.version import __version__

LIBRARIES = ("casadi", "numpy", "scipy", "shapely")


@cache
def versions() -> dict[str, str]:
    """Versions here, with a hash of the package's source files: two checkouts may bear the same number."""
    found = {"ensemble_ctrl": __version__, "code": _code(), "python": platform.python_version()}
    return found | {name: _installed(name) for name in LIBRARIES}


def differing(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """How other versions differ from ours, in words; empty if they do not.

    Examples
    --------
    >>> differing({"numpy": "2.1", "scipy": "1.15"}, {"numpy": "2.0", "scipy": "1.15"})
    'numpy 2.0, here 2.1'
    """
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    return "; ".join(f"{name} {theirs.get(name, 'none')}, here {ours.get(name, 'none')}" for name in names)


def digest(found: Mapping[str, str]) -> str:
    """Versions in one word."""
    return hashlib.sha256(repr(sorted(found.items())).encode()).hexdigest()[:16]


def _code() -> str:
    """A hash of the package's source files."""
    root = Path(__file__).parents[2]
    content = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        content.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return content.hexdigest()[:16]


def _installed(name: str) -> str:
    """An installed version."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"
