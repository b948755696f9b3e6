"""How long a problem takes that is allowed, but very large: reported before it begins."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import reads_fleet
from ensemble_ctrl.problem.checks.finding import Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

LOOK = 1e-8
"""Seconds for one sample of one member: less of robots on arcs among few obstacles, eight times that among hundreds."""
BUILD = 3e-7
"""Seconds to build the program, for the square of the steps: 100,000 steps take about 50 minutes, 5,000 about 7 s."""
LONG = 600.0
"""Seconds of replay from which on it is reported, however long the time limit is."""
STATE_BYTES = 20
"""Bytes of memory for a state of a member at a sampled time, where all members are held at once."""
MOST_BYTES = 8e9
"""Memory that a replay may take."""


def building_seconds(steps: int) -> float:
    """About how long one program of so many steps takes to build; nothing interrupts that."""
    return BUILD * float(steps) ** 2


def replay_seconds(members: int, substeps: int, steps: int) -> float:
    """About how long a replay takes."""
    return LOOK * float(members) * substeps * steps


def replay_bytes(problem: Problem) -> float:
    """About how much memory a replay takes: little, but for a task that reads the fleet as a whole."""
    if not reads_fleet(problem.task):
        return 0.0
    looks = float(problem.verify.members) * problem.verify.substeps * problem.steps
    return STATE_BYTES * len(problem.fleet.states) * looks


def work_findings(problem: Problem) -> Iterator[Finding]:
    """A program that takes longer to build than there is time, and a replay of many minutes."""
    limit, seconds = problem.solve.time_limit, building_seconds(problem.steps)
    if seconds > limit:
        message = f"{problem.steps} steps take {spoken(seconds)} to build, more than the time limit of {limit:g} s"
        hint = "the plan then is one of a coarse grid: fewer steps, or a longer solve.time_limit"
        yield Finding(("horizon", "steps"), message, hint, "warning")
    verify = problem.verify
    seconds, needed = replay_seconds(verify.members, verify.substeps, problem.steps), replay_bytes(problem)
    looks = f"{verify.members} members sampled {verify.substeps} times in each of {problem.steps} steps"
    if needed > MOST_BYTES:
        most = int(verify.members * MOST_BYTES / needed)
        message = f"expected at most {most} for a task that speaks of the fleet as a whole, got {looks}"
        yield Finding(("verify", "members"), f"{message}: {needed / 1e9:.0f} GB of memory, more than 8 GB")
    elif seconds > min(LONG, limit):
        hint = f"fewer of them; the replay ends with those run by the time limit of {limit:g} s"
        yield Finding(("verify", "members"), f"{looks} take {spoken(seconds)}", hint, "warning")


def spoken(seconds: float) -> str:
    """A long time in words.

    Examples
    --------
    >>> spoken(3000), spoken(11200), spoken(20)
    ('about 50 min', 'about 3 h', 'about 20 s')
    """
    if seconds < 120:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 7200 else f"about {seconds / 3600:.0f} h"
