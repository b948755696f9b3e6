"""What a plan tolerates of each kind of error, as bars."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ensemble_ctrl.report.canvas import save
from ensemble_ctrl.report.text import literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ensemble_ctrl.planning.tolerance import Tolerance

PROVEN, BROKEN = "#1b7837", "#b2182b"
"""What is tolerated, and what an attack needs."""


def draw_tolerance(name: str, found: Tolerance, ax: Axes) -> Axes:
    """A bar for each kind, as a share of the bound that an attack needs, or full where none was looked for."""
    kinds = [*found.kinds, found.mix][::-1]
    for k, one in enumerate(kinds):
        share = 1.0 if not one.broken else one.bound / one.broken
        if one.broken:
            ax.barh(k, 1.0, color=BROKEN, alpha=0.25, height=0.6)
            ax.text(1.01, k, f"broken at {one.amount(one.broken)}", va="center", fontsize=7, color=BROKEN)
        ax.barh(k, share, color=PROVEN, height=0.6)
        words = f"{one.amount(one.bound)}" + (f", then {one.ends}" if one.ends and one.beyond is not None else "")
        ax.text(0.01, k, literal(words), va="center", fontsize=8, color="white" if share > 0.35 else "black")
    ax.set_yticks(range(len(kinds)), [literal(one.kind) for one in kinds], fontsize=8)
    ax.set_xticks([])
    ax.set_xlim(0.0, 1.35)
    for side in ("top", "right", "bottom"):
        ax.spines[side].set_visible(False)
    scale = "bars: share of what breaks it" if any(one.broken for one in kinds) else "bars have no scale"
    ax.set_title(literal(f"{name}: tolerated of each kind of error, alone ({scale})"), fontsize=10, loc="left", x=-0.4)
    return ax


def write_tolerance(name: str, found: Tolerance, path: Path) -> Path:
    """The bars in a file, of the format that its name ends in."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 0.45 * len(found.kinds) + 1.4), layout="constrained")
    draw_tolerance(name, found, figure.add_subplot())
    save(figure, path, path.suffix[1:].lower())
    return path
