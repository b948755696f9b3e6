"""The log of the package on stderr: decisions with ``-v``, everything with ``-vv``."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

NAME = "ensemble_ctrl"
LEVELS = {1: logging.INFO, 2: logging.DEBUG}


@contextmanager
def shown_log(verbosity: int, stream: TextIO) -> Iterator[None]:
    """Within: ``logging.getLogger("ensemble_ctrl")`` writes to a stream.

    Parameters
    ----------
    verbosity : int
        0 shows nothing, 1 what the planner decides, 2 and above everything.
    stream : text stream
        Where to.
    """
    if not verbosity:
        yield
        return
    handler, logger = logging.StreamHandler(stream), logging.getLogger(NAME)
    handler.setFormatter(logging.Formatter("log: %(message)s"))
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(LEVELS.get(verbosity, logging.DEBUG))
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
