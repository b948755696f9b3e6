"""Pictures of a loop: planned and driven paths on the map, what was learnt, and how long planning took."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.storage import whole_file
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.problem.specification import AvoidConstraint
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.report.canvas import new_figure, placed_axes, save
from ensemble_ctrl.report.figures import MARGINS, draw_map, map_size, on_map
from ensemble_ctrl.report.map_content import MapContent, map_contents
from ensemble_ctrl.report.palette import CONTRAST, LINES, OBSTACLE, OBSTACLE_EDGE
from ensemble_ctrl.report.projections import draw_shapes
from ensemble_ctrl.report.raster import FINE, NARROW, Raster
from ensemble_ctrl.report.text import literal
from ensemble_ctrl.report.video import write_gif

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image, ImageDraw

Floats = NDArray[np.float64]

DRIVEN, PLANNED, FIRST = "#08306b", "#ef8a62", "#9aa5b1"
MEMBERS = 15
"""Members drawn under the first plan."""
FRAMES = 80
"""Frames of the animation at most."""
SEEN = 4
"""Times at which what came on the way is drawn."""
VIEW, VIEW_HEIGHT = 6.4, 3.6
"""Width of a view and its height, inches, for systems that are drawn in views."""
SIDE = 4.2
"""Inches beside the map."""


@dataclass(frozen=True, eq=False)
class Reported:
    """What is known of one step of a loop.

    Attributes
    ----------
    time : float
        When its commands begin, seconds.
    paths : mapping of str to ndarray of shape (times, 2)
        Where each robot is expected to go from the last measurement on, metres.
    ranges : mapping of str to (float, float)
        What was known of the parameters.
    seconds : float
        What planning took.
    source : str
        Whose commands were sent.
    """

    time: float
    paths: Mapping[str, Floats]
    ranges: Mapping[str, tuple[float, float]]
    seconds: float
    source: str


@dataclass(frozen=True, eq=False)
class Run:
    """A loop that has been run.

    Attributes
    ----------
    problem : Problem
    first : ndarray, shape (steps, n_u)
        The plan that it began with.
    reported : sequence of Reported
    measured : mapping of str to ndarray of shape (times, 2)
        Estimated places of each robot, metres.
    driven : mapping of str to ndarray of shape (times, 2)
        True places of simulated robots; empty if nobody knows them.
    seconds : float
        From the first to the last of `driven`.
    deadline : float
        Seconds that planning was allowed.
    truth : mapping of str to float
        True parameters of a simulated robot, where they stay the same.
    title : str
        How it ended.
    baseline : ndarray, shape (steps, n_u), or None
        Commands of the unconstrained baseline.
    came : sequence of AvoidConstraint
        What came, moved and went, and where it truly was in its windows.
    """

    problem: Problem
    first: Floats
    reported: Sequence[Reported]
    measured: Mapping[str, Floats]
    driven: Mapping[str, Floats]
    seconds: float
    deadline: float
    truth: Mapping[str, float] = field(default_factory=dict)
    title: str = ""
    baseline: Floats | None = None
    came: Sequence[AvoidConstraint] = ()


def draw_run(run: Run) -> Figure:
    """The map with planned and driven paths, the learnt ranges, and the time that each plan took."""
    left, _, below, above = MARGINS
    views = () if on_map(run.problem) else map_contents(run.problem, _of_fleet(run))
    width, height = (VIEW, VIEW_HEIGHT * len(views)) if views else map_size(run.problem, run.first)
    height = max(height, 4.4)
    figure = new_figure((width + SIDE, height))
    half = (height - 2 * below - above) / 2
    for k, content in enumerate(views):
        each = (height - above - len(views) * below) / len(views)
        top = above + k * (each + below)
        _draw_view(run, content, placed_axes(figure, left, SIDE + 0.2, height - top - each, top))
    if views:
        figure.suptitle(literal(run.title), fontsize=10)
    else:
        _draw_paths(run, placed_axes(figure, left, SIDE + 0.2, below, above))
    _draw_ranges(run, placed_axes(figure, width + 0.6, 0.2, 2 * below + half, above))
    _draw_seconds(run, placed_axes(figure, width + 0.6, 0.2, below, above + below + half))
    return figure


def write_run(run: Run, folder: Path, animated: bool = True) -> list[str]:
    """Write ``online.png`` and, if `animated`, ``online.gif`` into `folder`; returns their names."""
    save(draw_run(run), folder / "online.png")
    if not animated or not on_map(run.problem) or min((len(path) for path in _shown(run).values()), default=0) < 2:
        return ["online.png"]
    with whole_file(folder / "online.gif") as file:
        write_gif(_frames(run), file, (*_colours(run).values(), PLANNED))
    return ["online.png", "online.gif"]


def _shown(run: Run) -> Mapping[str, Floats]:
    """The path that each robot took, as well as it is known."""
    return run.driven or run.measured


def _colours(run: Run) -> dict[str, str]:
    """A colour for each robot."""
    names = list(_shown(run))
    return {name: DRIVEN if len(names) == 1 else LINES[k % len(LINES)] for k, name in enumerate(names)}


def _draw_paths(run: Run, ax: Axes) -> None:
    """The map with the fleet under the first plan, every plan, and what was driven."""
    problem = run.problem
    each = by_start(problem).values()
    fleet = [path for one in each for path in trajectories(one, run.first, one.fleet.spread(MEMBERS), 2)]
    shown, colours = _shown(run), _colours(run)
    draw_map(problem, ax, [*fleet, *shown.values()])
    _draw_came(run, ax)
    for i, path in enumerate(fleet):
        ax.plot(path[:, 0], path[:, 1], color=FIRST, linewidth=0.5, label=None if i else "fleet, first plan")
    if run.baseline is not None:
        middle = trajectories(problem, run.baseline, problem.fleet.center[None], 2)[0]
        ax.plot(middle[:, 0], middle[:, 1], "--", color=CONTRAST, linewidth=0.9, label="unconstrained")
    for i, step in enumerate(run.reported):
        for k, path in enumerate(step.paths.values()):
            ax.plot(*path.T, color=PLANNED, linewidth=0.7, alpha=0.6, label=None if i or k else "plans")
            ax.plot(*path[:1].T, ".", color=PLANNED, markersize=4)
    how = "driven" if run.driven else "measured"
    for name, path in shown.items():
        label = how if len(shown) == 1 else f"{name}, {how}"
        ax.plot(*path.T, color=colours[name], linewidth=1.8, label=literal(label))
        ax.plot(*path[-1:].T, "o", color=colours[name], markersize=5)
    ax.legend(loc="best", fontsize=8)
    ax.set_title(literal(run.title), fontsize=10, wrap=True)


def _draw_came(run: Run, ax: Axes) -> None:
    """What came on the way: where it was at a few times, fainter the earlier, and the way of its middle."""
    from matplotlib.patches import Polygon

    for avoid in run.came:
        times = np.linspace(avoid.begin, avoid.end, SEEN)
        for k, offset in enumerate(avoid.offsets(times)):
            for piece in avoid.pieces:
                shape = Polygon(piece.vertices + offset, closed=True, facecolor=OBSTACLE, edgecolor=OBSTACLE_EDGE)
                shape.set(alpha=0.15 + 0.45 * (k + 1) / SEEN)
                ax.add_patch(shape)
        fine = np.linspace(avoid.begin, avoid.end, 101)
        way = avoid.pieces[0].vertices.mean(axis=0) + avoid.offsets(fine)
        ax.plot(*way.T, ":", color=OBSTACLE_EDGE, linewidth=1.0)
        text = literal(f"{avoid.name}, {avoid.begin:.3g} to {avoid.end:.3g} s")
        top = max(float(np.ptp(piece.vertices[:, 1])) / 2 for piece in avoid.pieces)
        ax.annotate(text, (way[0, 0], way[0, 1] + top), (0, 2), textcoords="offset points", ha="center", fontsize=7)


def _of_fleet(run: Run) -> Floats:
    """The fleet under the first plan, shape (members, times, d), metres."""
    return trajectories(run.problem, run.first, run.problem.fleet.spread(MEMBERS), 2)


def _draw_view(run: Run, content: MapContent, ax: Axes) -> None:
    """One view of the same for a system that an ODE defines: two coordinates of the position, or one over time."""

    def seen(path: Floats, begin: float, end: float) -> Floats:
        if content.view is not None:
            return path[:, list(content.view)]
        return np.column_stack([np.linspace(begin, end, len(path)), path[:, 0]])

    draw_shapes(content, ax)
    end = run.problem.duration
    for i, path in enumerate(content.paths):
        ax.plot(*path.T, color=FIRST, linewidth=0.5, label=None if i else "fleet, first plan")
    for i, step in enumerate(run.reported):
        for path in step.paths.values():
            # a plan begins at the newest measurement, and ends with the horizon
            begin = end - (len(path) - 1) * run.problem.step
            ax.plot(*seen(path, begin, end).T, color=PLANNED, linewidth=0.7, alpha=0.6, label=None if i else "plans")
    for path in _shown(run).values():
        ax.plot(*seen(path, 0.0, run.seconds).T, color=DRIVEN, linewidth=1.8, label="driven")
    ax.margins(0.06, 0.16)
    ax.legend(loc="best", fontsize=8)


def _draw_ranges(run: Run, ax: Axes) -> None:
    """What is known of each parameter over time."""
    times, alone = [step.time for step in run.reported], len(_shown(run)) == 1
    names = list(run.reported[0].ranges) if run.reported else []
    # parameters of different units: as shares of what was known first
    shares = len(names) > 1 and not on_map(run.problem)
    for k, name in enumerate(names):
        ends, true = np.array([step.ranges[name] for step in run.reported]), run.truth.get(name)
        if shares:
            low, width = ends[0, 0], max(float(np.ptp(ends[0])), 1e-12)
            ends, true = (ends - low) / width, None if true is None else (true - low) / width
        colour = f"C{k}" if alone else LINES[k % len(LINES)]
        ax.fill_between(
            times,
            ends[:, 0],
            ends[:, 1],
            step="post",
            alpha=0.3,
            color=colour,
            label=literal(f"{name}: known range" if alone else name),
        )
        if true is not None:
            ax.axhline(
                true,
                linestyle="--",
                linewidth=1.0,
                color=colour,
                label=literal(f"{name}: true") if alone else None,
            )
    label = "share of the first range" if shares else "parameter" if alone else "known range, true value"
    ax.set(xlabel="t [s]", ylabel=label)
    ax.grid(alpha=0.3)
    if run.reported and run.reported[0].ranges:
        ax.legend(loc="best", fontsize=8)


def _draw_seconds(run: Run, ax: Axes) -> None:
    """How long each plan took; plans that were not used are marked."""
    times = np.array([step.time for step in run.reported])
    took = 1e3 * np.array([step.seconds for step in run.reported])
    new = np.array([step.source in ("new", "recovered") for step in run.reported], dtype=bool)
    width = 0.6 * float(np.diff(times).min(initial=1.0))
    ax.bar(times[new], took[new], width, color=DRIVEN, label="new plan")
    if not new.all():
        ax.bar(times[~new], took[~new], width, color=CONTRAST, label="last plan kept, or stopped")
    ax.axhline(1e3 * run.deadline, linestyle="--", linewidth=1.0, color="black", label="deadline")
    ax.set(xlabel="t [s]", ylabel="planning [ms]")
    ax.legend(loc="best", fontsize=8)
    ax.grid(alpha=0.3)


def _frames(run: Run) -> Iterator[Image.Image]:
    """The robots and their newest plan, moving over the map."""
    from PIL import ImageDraw

    shown, colours = _shown(run), list(_colours(run).values())
    count = min(len(path) for path in shown.values())
    driven = np.stack([path[:count] for path in shown.values()])
    planned = [path for step in run.reported for path in step.paths.values()]
    raster = Raster.of(run.problem, driven, NARROW, False, planned)
    (panel,) = raster.panels
    ground = raster.ground()
    if len(shown) > 1:
        _draw_names(raster, ImageDraw.Draw(ground), _colours(run))
    starts = np.array([step.time for step in run.reported])
    thick = round(1.5 * FINE)
    before = 0
    for k in np.unique(np.linspace(0, count - 1, FRAMES).astype(int)).tolist():
        now = run.seconds * k / (count - 1)
        newest = int(np.searchsorted(starts, now + 1e-9)) - 1
        for path, colour in zip(driven, colours, strict=True):
            ImageDraw.Draw(ground).line(panel.points(path[before : k + 1]), colour, thick, "curve")
        before = k
        frame = ground.copy()
        pen = ImageDraw.Draw(frame)
        for plan in run.reported[newest].paths.values() if newest >= 0 else ():
            pen.line(panel.points(plan), PLANNED, thick, "curve")
        raster.draw_now(pen, now)
        for avoid in run.came:
            if avoid.begin <= now <= avoid.end:
                for piece in avoid.pieces:
                    corners = panel.points(piece.vertices + avoid.offsets(np.array([now]))[0])
                    pen.polygon(corners, OBSTACLE, OBSTACLE_EDGE, FINE)
        for path, colour in zip(driven, colours, strict=True):
            panel.robot(pen, path[k], colour)
        yield frame.reduce(FINE)


def _draw_names(raster: Raster, pen: ImageDraw.ImageDraw, colours: Mapping[str, str]) -> None:
    """Whose colour is which, below the map."""
    panel = raster.panels[0]
    x, y = 8 * panel.unit, raster.size[1] - 12 * panel.unit
    for name, colour in colours.items():
        pen.text((x, y), name, colour, panel.font, anchor="lm")
        x += pen.textlength(f"{name}  ", panel.font)
