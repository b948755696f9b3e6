"""What is proven of some commands, and what a proof that fell short lacked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ensemble_ctrl.certificate.remaining import SetCertificate

Proof = Literal["whole", "period", "none"]


@dataclass(frozen=True)
class Evidence:
    """What is proven of some commands.

    Attributes
    ----------
    proof : {"whole", "period", "none"}
        The rest of the task; or that nothing is hit until the next plan takes over, nor by standing after that; or
        nothing.
    clearance, robustness : float
        Proven, metres: infinite where there is nothing to keep clear of or to do, minus infinity where nothing is
        proven. ``period`` proves no robustness.
    tried : SetCertificate or None
        The last proof of the rest of the task that was tried, or, where even that of a period fell short, this one.
    """

    proof: Proof = "none"
    clearance: float = -math.inf
    robustness: float = -math.inf
    tried: SetCertificate | None = None

    @classmethod
    def whole(cls, certificate: SetCertificate) -> Evidence:
        """Of the rest of the task."""
        return cls("whole", certificate.clearance, certificate.robustness, certificate)

    @classmethod
    def period(cls, certificate: SetCertificate, rest: SetCertificate) -> Evidence:
        """Of a period only; the proof of the rest fell short."""
        return cls("period", certificate.clearance, tried=rest)


NOTHING = Evidence()
