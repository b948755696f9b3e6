"""A certificate as plain data, and back from data to what it claims."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

from ensemble_ctrl.certificate.certify import Certificate

CLOSE = 1e-6
"""Metres by which a bound in a file may differ from the same bound computed again."""


def as_data(certificate: Certificate) -> dict[str, Any]:
    """The body of ``certificate.json``."""
    return {
        "proven": certificate.proven,
        "ranges": {name: list(ends) for name, ends in certificate.ranges.items()},
        "clearance": certificate.clearance,
        "robustness": certificate.robustness,
        "clearances": [asdict(b) for b in certificate.clearances],
        "parts": [asdict(b) for b in certificate.parts],
        "counter_example": None if certificate.counter_example is None else asdict(certificate.counter_example),
        "boxes": certificate.boxes,
        "seconds": certificate.seconds,
        "inputs_sha256": certificate.inputs,
    }


def differences(claimed: dict[str, Any], certificate: Certificate) -> list[str]:
    """How a file's claim differs from the certificate computed again; empty if it does not."""
    found = []
    fresh = as_data(certificate)
    if claimed.get("inputs_sha256") != certificate.inputs:
        found.append("it was made for other controls or another problem (inputs_sha256 differs)")
    for name in ("proven", "ranges"):
        if claimed.get(name) != fresh[name]:
            found.append(f"it says {name} {claimed.get(name)!r}, computed again: {fresh[name]!r}")
    for name in ("clearances", "parts"):
        for old, new in zip(_bounds(claimed.get(name)), _bounds(fresh[name]), strict=False):
            if old != new and (old is None or new is None or abs(old - new) > CLOSE):
                found.append(f"it claims {old} m in {name}, computed again: {new} m")
    return found


def _bounds(entries: Any) -> list[float | None]:
    """The proven numbers of a list of bounds."""
    if not isinstance(entries, list):
        return [None]
    numbers = [entry.get("proven") if isinstance(entry, dict) else None for entry in entries]
    return [float(n) if isinstance(n, int | float) and isfinite(n) else None for n in numbers] or [None]
