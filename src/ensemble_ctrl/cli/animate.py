"""``ensemble-plan animate``: the fleet of a saved plan on its way, and the same for a new plan."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl import planfile
from ensemble_ctrl.api import Plan
from ensemble_ctrl.cli.streams import say


def animate_plan(path: Path, output: Path | None, seconds: float) -> None:
    """Write the animation and say where it is."""
    plan = Plan.load(path)
    file = planfile.path_of(path)
    beside = file.with_name("animation.gif") if file.name == "plan.npz" else file.with_suffix(".gif")
    say(str(plan.animate(output or beside, seconds)))
