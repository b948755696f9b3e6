"""Mutants that no case can find, with the reason: by their names, or by what their names begin with."""

from __future__ import annotations

FINER = "chooses what is looked at more closely; every choice gives true bounds"
BOX = "chooses the box of members that is tried; what is proven of it is proven whichever it is"
SPARE = "far below the rounding term, which has room for it"

REASONS: dict[str, str] = {
    "certificate/clearance.py:Prover.nearness": "the order in which pieces are looked at",
    "certificate/clearance.py:Prover._widths": FINER,
    "certificate/task.py:_bending": FINER,
    "certificate/share.py:_values": BOX,
    "certificate/share.py:_largest": BOX,
    "certificate/share.py:_peeled": BOX,
    "certificate/enclosure.py:Flow.remainder_at: (A * (B * I1 + G * I0) + self.fastest / 2 * quadratic) * (1 +": SPARE,
    "certificate/enclosure.py:Flow.growth: span ** 2 / 8 * np.abs(self.v[n] * self.omega[n]) * size * (1 +": SPARE,
}


def reason_of(name: str) -> str:
    """Why a mutant may survive; empty for one that may not."""
    return next((reason for begin, reason in REASONS.items() if name.startswith(begin)), "")


def stale(names: list[str]) -> list[str]:
    """Reasons for mutants that aren't there any more."""
    return [begin for begin in REASONS if not any(name.startswith(begin) for name in names)]
