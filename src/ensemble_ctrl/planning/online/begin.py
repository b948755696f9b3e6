"""The loop that is for a problem and its system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numpy import float64
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.driver import Loop
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.options import OnlineOptions
from ensemble_ctrl.planning.online.published import PublishedLoop
from ensemble_ctrl.planning.online.state_loop import StateLoop
from ensemble_ctrl.problem import Problem

LOOPS: dict[str, Callable[..., Any]] = {"positions": Receding, "states": StateLoop}
"""Each loop with proofs by the transcription of the systems that it is for."""


def loop_for(
    problem: Problem, options: OnlineOptions | None, controls: NDArray[float64], robots: Sequence[str]
) -> Loop:
    """A loop that begins with a plan."""
    kind = (
        PublishedLoop
        if problem.solve.as_published and problem.fleet.system.on_arcs
        else LOOPS[problem.fleet.system.transcription]
    )
    made: Loop = kind(problem, options, controls, robots=robots)
    return made
