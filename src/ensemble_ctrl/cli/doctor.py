"""``ensemble-plan doctor``: versions, those of extras too, and one tiny problem solved and replayed."""

from __future__ import annotations

import platform
import time

from ensemble_ctrl.api.results import LIBRARIES, installed_version
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.version import __version__

EXTRAS = {
    "starlette": ("edit", "ensemble-plan edit"),
    "ompl": ("ompl", "guesses that drive curves"),
    "distributed": ("cluster", "--cluster"),
    "pyarrow": ("parquet", "tables in Parquet"),
    "rosbags": ("ros", "bags of ROS"),
}
"""Libraries that are not required: the extra that installs each, and what it is for."""
TINY = """
name: doctor
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1.5, 2.5], [-0.5, 0.5]]}}
obstacles: {block: {box: [[0.8, 1.2], [-0.3, 0.1]]}}
task: F[3, 4] in(goal) and G avoid(block)
"""


def examine() -> int:
    """Print what was found; returns 0 if all works, else 1."""
    say(f"ensemble_ctrl {__version__}, Python {platform.python_version()}, {platform.platform()}")
    missing = [name for name in LIBRARIES if installed_version(name) is None]
    for name in LIBRARIES:
        say(f"  {name:<12}{installed_version(name) or 'MISSING'}")
    if missing:
        say(f"problem: {', '.join(missing)} not installed; install the package again")
        return codes.INTERNAL
    for name, (extra, purpose) in EXTRAS.items():
        say(f"  {name:<12}{installed_version(name) or f'not installed; for {purpose}: ensemble-ctrl[{extra}]'}")
    try:
        return _solve_tiny()
    except Exception as error:
        say(f"  planning    FAILED: {type(error).__name__}: {error}")
        say("problem: a tiny problem can't be planned here; install the package again in a new environment")
        return codes.INTERNAL


def _solve_tiny() -> int:
    """Plan for one small problem."""
    from ensemble_ctrl.api.planning import plan
    from ensemble_ctrl.files.config import load_text

    began = time.perf_counter()
    found = plan(load_text(TINY, "doctor"), check=False)
    seconds = time.perf_counter() - began
    good = found.status == "planned" and found.verified
    say(f"  planning    {'works' if good else 'FAILED'}: {found} in {seconds:.2f} s")
    say("all works" if good else "problem: the tiny plan fell short; see the line above")
    return codes.OK if good else codes.INTERNAL
