"""What is proven of some commands, and what a proof that fell short lacked."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

from ensemble_ctrl.certificate.remaining import SetCertificate
from ensemble_ctrl.core.deferred import dataclass

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
    until : float
        The control step, counted from the start of the loop, before which nothing is hit, by this proof.
    tried : SetCertificate or None
        The last proof of the rest of the task that was tried, or, where even that of a period fell short, this one.
    """

    proof: Proof = "none"
    clearance: float = -math.inf
    robustness: float = -math.inf
    until: float = -math.inf
    tried: SetCertificate | None = None

    @classmethod
    def whole(cls, certificate: SetCertificate, until: float) -> Evidence:
        """Of the rest of the task."""
        return cls("whole", certificate.clearance, certificate.robustness, until, certificate)

    @classmethod
    def period(cls, certificate: SetCertificate, until: float, rest: SetCertificate) -> Evidence:
        """Of a period only; the proof of the rest fell short."""
        return cls("period", certificate.clearance, until=until, tried=rest)

    def of_a_period(self) -> Evidence:
        """What is left of it for a task that reaches further than the one that it is of."""
        return NOTHING if self.proof == "none" else replace(self, proof="period", robustness=-math.inf)


NOTHING = Evidence()
