"""Figures with places for their parts in inches, so that drawing takes one pass and no search for a layout."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.storage import whole_file
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.text import literal, parameter_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN = 3.5
"""Width in inches of a column of a paper."""
PAPER: Any = {
    "font.size": 8,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}
"""Style of text and lines in a column."""
FORMATS = ("png", "pdf", "svg")


def new_figure(size: tuple[float, float], dpi: float = 150) -> Figure:
    """A figure of its own, outside pyplot, so that nothing has to be closed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def placed_axes(figure: Figure, left: float, right: float, bottom: float, top: float) -> Axes:
    """New axes with so many inches around them."""
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    place_axes(ax, left, right, bottom, top)
    return ax


def place_axes(ax: Axes, left: float, right: float, bottom: float, top: float) -> None:
    """Leave so many inches around axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    # inches to shares of the figure
    width, height = figure.get_size_inches().tolist()
    ax.set_position((left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height))


def draw_scale(problem: Problem, ax: Axes) -> None:
    """Which colour is which value of the first parameter, beside the map; nothing where all are equal."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    fleet = problem.fleet
    if not fleet.names or fleet.upper[0] <= fleet.lower[0]:
        return
    figure = ax.get_figure(root=True)
    assert figure is not None
    colours = ScalarMappable(Normalize(fleet.lower[0], fleet.upper[0]), "viridis")
    place = ax.inset_axes((1.03, 0.0, 0.035, 1.0))
    place.set_title("", y=1.0)
    bar = figure.colorbar(colours, cax=place)
    bar.locator = MaxNLocator(nbins=5)  # few and round: labels so short that the name beside them stays on the page
    bar.set_label(literal(parameter_label(problem, fleet.names[0])))


def shown_axes(size: tuple[float, float]) -> Axes:
    """Axes on a new figure of pyplot's, so that a notebook or a later ``show`` shows it."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=size, layout="compressed")
    return figure.subplots()


def save(figure: Figure, path: Path, kind: str = "png") -> None:
    """Write a figure, whole or not at all; PNG in one pass, where `Figure.savefig` takes two."""
    if kind not in FORMATS:
        raise ProblemError(f"format: expected one of {', '.join(FORMATS)}, got {kind!r}")
    with whole_file(path) as file:
        if kind == "png":
            _write_png(figure, file)
        else:
            figure.savefig(file, format=kind)


def _write_png(figure: Figure, file: IO[bytes]) -> None:
    """Draw once, and write the pixels without transparency."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "PNG", compress_level=4, dpi=(figure.dpi, figure.dpi))
