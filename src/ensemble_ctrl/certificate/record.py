"""A certificate as plain data, and the comparison of a file's claim with the certificate computed again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from ensemble_ctrl.certificate.certify import Certificate
from ensemble_ctrl.core.plain import to_json

CLOSE = 1e-6
"""Largest difference of a number in a file from the same one computed again: metres, seconds, or a parameter's unit."""
OVER = 1e-9
"""The same for a proven number that claims more than the one computed again: rounding of another machine's library."""
PROVEN = ("clearance", "robustness", "proven", "share")
"""Numbers of which a larger one claims more."""
EXACT = ("ranges", "uncertainty")
"""Numbers that are given, not computed."""
EFFORT = ("boxes", "seconds")
"""What a certificate took, which is no part of its claim."""


def as_data(certificate: Certificate) -> dict[str, Any]:
    """What is claimed, and what it took."""
    return {**claim(certificate), **{name: getattr(certificate, name) for name in EFFORT}}


def claim(certificate: Certificate) -> dict[str, Any]:
    """The body of ``certificate.json``: what can be computed again, and nothing else."""
    return {
        "proven": certificate.proven,
        "ranges": {name: list(ends) for name, ends in certificate.ranges.items()},
        "clearance": certificate.clearance,
        "robustness": certificate.robustness,
        "clearances": [asdict(b) for b in certificate.clearances],
        "enough": certificate.enough,
        "parts": [asdict(b) for b in certificate.parts],
        "reason": certificate.reason,
        "counter_example": None if certificate.counter_example is None else asdict(certificate.counter_example),
        "uncertainty": dict(certificate.uncertainty),
        "inputs_sha256": certificate.inputs,
    }


def claims_each(claimed: Any) -> bool:
    """Whether a file refines the bound of each obstacle, as those of earlier releases do without a word of it."""
    return isinstance(claimed, dict) and claimed.get("enough") is None


def differences(claimed: Any, certificate: Certificate) -> list[str]:
    """How a file's claim differs from the certificate computed again; empty if it does not.

    Notes
    -----
    *Guarantee*: every entry is compared, and there is no other one. Numbers may differ by `CLOSE`, but those that are
    proven may exceed the ones computed again by `OVER` at most.
    """
    found = []
    if not isinstance(claimed, dict) or claimed.get("inputs_sha256") != certificate.inputs:
        found.append("it was made for other controls or another problem (inputs_sha256 differs)")
    return [*found, *_differences(claimed, json.loads(to_json(claim(certificate))), (), CLOSE, CLOSE)]


def _differences(old: Any, new: Any, path: tuple[str, ...], over: float, under: float) -> Iterator[str]:
    """How an entry of a file differs; a number may exceed the one computed again by `over`, and lack `under`."""
    if isinstance(new, dict) and isinstance(old, dict):
        for name in dict.fromkeys([*new, *old]):
            where = (*path, name)
            if name not in old and not (new[name] is None or new[name] in ("", [], {})):
                yield f"it lacks {_at(where)}, computed again: {new[name]!r:.60}"
            elif name not in old:
                continue  # an entry that says nothing: releases before had none of that name
            elif name not in new:
                yield f"it has {_at(where)} {old[name]!r:.60}, which is no part of a certificate"
            elif name in EXACT:
                yield from _differences(old[name], new[name], where, 0.0, 0.0)
            else:
                yield from _differences(old[name], new[name], where, min(over, OVER) if name in PROVEN else over, under)
    elif isinstance(new, list) and isinstance(old, list) and len(new) == len(old):
        for k, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _differences(one, other, (*path, str(k)), over, under)
    elif not _alike(old, new, over, under):
        yield f"it says {_at(path) or 'all in all'} {old!r:.60}, computed again: {new!r:.60}"


def _alike(old: Any, new: Any, over: float, under: float) -> bool:
    """Whether two entries are the same, or numbers close to each other."""
    numbers = [isinstance(value, int | float) and not isinstance(value, bool) for value in (old, new)]
    if all(numbers):
        return bool(new - under <= old <= new + over)
    return type(old) is type(new) and bool(old == new)


def _at(path: tuple[str, ...]) -> str:
    """Where an entry stands, such as ``clearances[0].proven``."""
    return "".join(f"[{part}]" if part.isdigit() else f".{part}" for part in path).removeprefix(".")
