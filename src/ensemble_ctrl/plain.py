"""Plain data as strict JSON: numbers that JSON lacks become null."""

from __future__ import annotations

import json
import math
from typing import Any


def to_json(data: Any, indent: int | None = None) -> str:
    """Strict JSON text.

    Examples
    --------
    >>> to_json({"clearance": float("inf"), "cells": (1, 2)})
    '{"clearance": null, "cells": [1, 2]}'
    """
    return json.dumps(_finite(data), indent=indent, allow_nan=False)


def _finite(data: Any) -> Any:
    """The same data with infinite and undefined numbers as None."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
