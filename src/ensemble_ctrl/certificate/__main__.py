"""``python -m ensemble_ctrl.certificate PLAN``: a results folder is proven again, with NumPy and Python alone.

Reads ``proof_input.json`` and ``certificate.json`` of the folder, and nothing else.  Exit code 0: proven, and the
certificate says what was proven here.  4: not proven, or the certificate says something else.  2: a file is missing or
is no such file.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ensemble_ctrl.certificate import Certificate, certify, differences
from ensemble_ctrl.certificate.record import claims_each
from ensemble_ctrl.core.errors import EnsembleError, ProblemError
from ensemble_ctrl.core.storage import read_regular
from ensemble_ctrl.core.values import numbers
from ensemble_ctrl.problem.plain import problem_of

MOST_BYTES = 50_000_000
"""Largest file that is read."""
PROVEN, WRONG, OTHERWISE = 0, 2, 4


def main(words: Sequence[str]) -> int:
    """Prove again, and compare; returns the exit code."""
    if len(words) != 1 or words[0] in ("-h", "--help"):
        print("usage: python -m ensemble_ctrl.certificate PLAN   (a results folder)", file=sys.stderr)
        return PROVEN if words and words[0] in ("-h", "--help") else WRONG
    try:
        certificate, claimed = checked(Path(words[0]))
    except EnsembleError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG
    found = differences(claimed, certificate)
    print("\n".join(_report(certificate, found)))
    return PROVEN if certificate.proven == "yes" and not found else OTHERWISE


def checked(folder: Path) -> tuple[Certificate, Any]:
    """What is proven here of the folder's controls, and what its certificate claims.

    Raises
    ------
    ProblemError
        If a file is missing, or is no such file.
    """
    given, claimed = _read(folder / "proof_input.json"), _read(folder / "certificate.json")
    if not isinstance(given, dict) or given.keys() != {"problem", "controls"}:
        raise ProblemError(f"{folder / 'proof_input.json'}: expected an object with problem and controls")
    problem = problem_of(given["problem"])
    controls = problem.fleet.checked_controls(numbers("controls", given["controls"]))
    return certify(problem, controls, each=claims_each(claimed)), claimed


def _read(path: Path) -> Any:
    """What a JSON file says."""
    try:
        return json.loads(read_regular(path, MOST_BYTES).decode("utf-8"), object_pairs_hook=_object)
    except (OSError, ValueError, RecursionError) as error:
        raise ProblemError(f"{path}: can't be read ({getattr(error, 'strerror', None) or error})") from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object with each name once: readers of a file do not agree which of two counts."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"a name is given twice, among {', '.join(found)}")
    return found


def _report(certificate: Certificate, found: Sequence[str]) -> list[str]:
    """What was proven, in a few lines."""
    ranges = ", ".join(f"{name} {low:g}..{high:g}" for name, (low, high) in certificate.ranges.items())
    errors = ", every disturbance within the bounds" if certificate.uncertainty else ""
    lines = [f"proven: {certificate.proven}, for {ranges or 'the one member'}, every instant{errors}"]
    lines += [f"clearance >= {certificate.clearance:.6g} m, rest of the task >= {certificate.robustness:.6g}"]
    lines += [certificate.reason] if certificate.reason else []
    agree = "certificate.json says the same" if not found else "certificate.json says something else:"
    return [*lines, f"inputs sha256 {certificate.inputs}", agree, *(f"  {text}" for text in found)]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
