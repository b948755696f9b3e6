"""One step of the loop: what it did, and what it has tried so far."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Literal, Protocol

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.online import Timer
from ensemble_ctrl.planning.online.evidence import NOTHING, Evidence, Proof

Source = Literal["new", "kept", "stopped", "recovered"]


class Known(Protocol):
    """A set of poses or states."""

    @property
    def away(self) -> float:
        """Its radius, metres."""

    @property
    def turn(self) -> float:
        """Radians either way."""


@dataclass(frozen=True)
class Step:
    """What one step of the loop did.

    Attributes
    ----------
    begin, end : int
        The commands are for the control steps ``begin .. end - 1``, counted from the start of the loop.
    source : {"new", "kept", "stopped", "recovered"}
        Whose commands they are: of a new plan, of the last one, of none, or of a plan made while standing.
    proof : {"whole", "period", "none"}
        What is proven of them for the whole set of states: the rest of the task; or that nothing is hit until the next
        plan takes over, nor by standing after that; or nothing, for a robot that stands.
    clearance, robustness : float
        Proven of these commands, and of those planned after them as far as the proof goes (`Evidence`), metres; those
        of a ``kept`` plan are of its own proof.
    ranges : dict of str to (float, float)
        What is known of the parameters; of several robots, each is named after its robot, as in ``red.traction``.
    away, turn : float
        Size of the largest set of poses at the last measurement, metres and radians; infinite without one.
    seconds, solve_seconds, certify_seconds : float
        What it took.
    iterations : int
        Quadratic programs.
    status : str
        How solving ended.
    events : tuple of str
        What was out of the ordinary.
    """

    begin: int
    end: int
    source: Source
    proof: Proof
    clearance: float
    robustness: float
    ranges: dict[str, tuple[float, float]]
    away: float
    turn: float
    seconds: float
    solve_seconds: float
    certify_seconds: float
    iterations: int
    status: str
    events: tuple[str, ...]


@dataclass(eq=False)
class Work:
    """What a step has tried so far."""

    timer: Timer
    began: float = field(init=False)
    solve_seconds: float = 0.0
    certify_seconds: float = 0.0
    iterations: int = 0
    status: str = ""
    source: Source = "stopped"
    evidence: Evidence = NOTHING

    def __post_init__(self) -> None:
        self.began = self.timer()

    @property
    def seconds(self) -> float:
        """Since the step began."""
        return self.timer() - self.began

    def ended(self, source: Source, evidence: Evidence) -> None:
        """Note whose commands are sent, and what is proven of them."""
        self.source, self.evidence = source, evidence

    def step(
        self,
        begin: int,
        end: int,
        ranges: dict[str, tuple[float, float]],
        poses: Mapping[str, Known],
        events: tuple[str, ...],
    ) -> Step:
        """What was done, for the commands of the control steps ``begin .. end - 1``."""
        evidence = self.evidence
        return Step(
            begin=begin,
            end=end,
            source=self.source,
            proof=evidence.proof,
            clearance=evidence.clearance,
            robustness=evidence.robustness,
            ranges=ranges,
            away=max((pose.away for pose in poses.values()), default=math.inf),
            turn=max((pose.turn for pose in poses.values()), default=math.inf),
            seconds=self.seconds,
            solve_seconds=self.solve_seconds,
            certify_seconds=self.certify_seconds,
            iterations=self.iterations,
            status=self.status,
            events=events,
        )
