"""No text of a picture is cut by the edge of its page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.report import figures, plot
from ensemble_ctrl.report.figures import write_figures
from ensemble_ctrl.report.plot import KINDS, write_plot
from tests.examples import quick

from .plans import GOAL, HORIZON, POST, QUICK, TASK, made, ode_made

RANGES = ["[0.9, 1.1]", "[0.999, 1.001]", "[0.25, 1.75]", "[0.8765, 0.8768]", "[1, 12.5]"]
ROUTES: list[dict[str, Any]] = [
    {"corners": [[0, 0], [1, y], [3, 0]], "feasible": True, "outcome": outcome, "name": "", "length": 3.0}
    for y, outcome in ((0.2, "kept"), (0.3, "dropped"))
]


def cut(figure: Figure) -> list[float]:
    """How far something drawn reaches beyond the page at the left, below, at the right and above, in inches."""
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    beyond = (-box.x0, -box.y0, box.x1 - width, box.y1 - height)
    return [round(float(much), 3) for much in beyond] if max(beyond) > 0 else []


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures that were to be written to files."""
    found: list[Figure] = []

    def keep(figure: Figure, path: Path, kind: str = "png") -> None:
        found.append(figure)

    monkeypatch.setattr(figures, "save", keep)
    monkeypatch.setattr(plot, "save", keep)
    return found


def of_range(text: str) -> Plan:
    """The plain plan for another range of the parameter."""
    start = "start: {position: [0, 0], heading: 0}"
    fleet = f"fleet: {{model: unicycle, parameters: {{traction: {{range: {text}}}}}, {start}}}\n"
    return replace(made("plain"), problem=load_text(fleet + HORIZON + GOAL + POST + TASK + QUICK, name="plain"))


@pytest.mark.parametrize("name", quick(["plain", "several", "equal", "long", "bicycle", "mean"], "several", "long"))
def test_of_every_plan(name: str, written: list[Figure], tmp_path: Path) -> None:
    plan = made(name)
    write_figures(plan.problem, plan.controls, tmp_path, routes=ROUTES)
    for kind in KINDS:
        write_plot(plan, kind, tmp_path / "x.png")
    assert len(written) == 10
    assert not [beyond for figure in written if (beyond := cut(figure))]


@pytest.mark.parametrize("text", quick(RANGES, RANGES[0], RANGES[-1]))
def test_of_every_range(text: str, written: list[Figure], tmp_path: Path) -> None:
    plan = of_range(text)
    write_figures(plan.problem, plan.controls, tmp_path)
    write_plot(plan, "trajectories", tmp_path / "x.png")
    assert len(written) == 3
    assert not [beyond for figure in written if (beyond := cut(figure))]


@pytest.mark.parametrize("name", quick(["plane", "space", "line"], "space"))
def test_of_other_systems(name: str, written: list[Figure], tmp_path: Path) -> None:
    plan = ode_made(name)
    write_figures(plan.problem, plan.controls, tmp_path)
    write_plot(plan, "trajectories", tmp_path / "x.png")
    assert not [beyond for figure in written if (beyond := cut(figure))]
