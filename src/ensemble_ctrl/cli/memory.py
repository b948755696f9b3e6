"""The memory that planning needs: below it a solver hangs or ends the process, which nothing here could catch."""

from __future__ import annotations

from ensemble_ctrl.core.errors import EnsembleError

LEAST = 750_000_000
"""Bytes of address space (``ulimit -v``) that the examples are planned and drawn in, of which 160 MB are used."""


class MemoryLimitError(EnsembleError):
    """There is less memory than planning needs, or it ran out."""


def require_memory() -> None:
    """Refuse to plan below `LEAST`.

    Raises
    ------
    MemoryLimitError
        With the limit of this process.
    """
    limit = _limit()
    if limit is not None and limit < LEAST:
        raise MemoryLimitError(
            f"planning needs at least {LEAST // 1_000_000} MB of address space, but this process is limited to "
            f"{limit // 1_000_000} MB (ulimit -v)"
        )


def _limit() -> int | None:
    """The limit of this process's address space in bytes, if there is one."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit
