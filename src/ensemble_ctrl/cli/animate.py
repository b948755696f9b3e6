"""``ensemble-plan animate``: the fleet of a saved plan on its way, and the same for a new plan."""

from __future__ import annotations

from pathlib import Path

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.folder import require_free


def animate_plan(path: Path, output: Path | None, seconds: float, overwrite: bool = False) -> None:
    """Write the animation and say where it is."""
    file = planfile.path_of(path)
    video = output or (file.with_name("animation.gif") if file.name == "plan.npz" else file.with_suffix(".gif"))
    require_free(video, overwrite)
    say(str(Plan.load(path).animate(video, seconds)))
