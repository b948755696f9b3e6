"""Line charts as SVG text, coloured by the page's style sheet so that they follow its light and dark modes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import ceil, floor, log10

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.report.text import short
from ensemble_ctrl.report.transform import telling

Floats = NDArray[np.float64]

WIDTH, HEIGHT = 460, 250
"""Size in the chart's own units; the page scales it."""
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 10, 40
"""Room around the plot."""
COLOURS = 6
"""Colours of the style sheet, classes ``c0`` to ``c5``."""
SMALLEST = 1e-10
"""What a logarithmic axis shows of zero."""
POINTS = 1200
"""Points of a curve from which on only the telling ones are drawn."""
LONGEST = 80
"""Letters of a name in a legend; all of it is its title."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a chart.

    Attributes
    ----------
    name : str
        For the legend; empty for none.
    x, y : ndarray, shape (points,)
        NaN breaks the line.
    colour : int
        Of `COLOURS`, which also sets its dashes.
    top : ndarray, shape (points,), optional
        The area from `y` up to it is shaded.
    steps : bool
        Whether `y` holds from each x to the next; x then has one more entry.
    bold : tuple of float, optional
        The part of x in which it is drawn thicker.
    """

    name: str
    x: Floats
    y: Floats
    colour: int = 0
    top: Floats | None = None
    steps: bool = False
    bold: tuple[float, float] | None = None


@dataclass(frozen=True)
class Axes:
    """What a chart measures: labels with units, levels drawn across it, and whether time runs along x."""

    x: str
    y: str
    levels: tuple[tuple[float, str], ...] = ()
    time: bool = False
    logarithmic: bool = False


def chart(axes: Axes, curves: Sequence[Curve], label: str) -> str:
    """One chart as a ``<figure>`` with its legend.

    Parameters
    ----------
    axes : Axes
        Labels and levels.
    curves : sequence of Curve
        At least one, with some finite value.
    label : str
        What it shows, for people who can't see it.
    """
    frame = _Frame.around(axes, curves)
    parts = [*_grid(frame, axes), *(_level(frame, value, kind) for value, kind in axes.levels)]
    parts += [part for curve in curves for part in _curve(frame, curve)]
    if axes.time:
        x = frame.at(frame.x[0], frame.y[0])[0]
        ends = f'data-x0="{LEFT}" data-x1="{WIDTH - RIGHT}"'
        parts.append(f'<line class="cursor" {ends} x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>')
    svg = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">{"".join(parts)}</svg>'
    return f"<figure>{svg}{_legend(curves)}</figure>"


@dataclass(frozen=True)
class _Frame:
    """Where numbers are in the drawing."""

    x: tuple[float, float]
    y: tuple[float, float]
    logarithmic: bool

    @classmethod
    def around(cls, axes: Axes, curves: Sequence[Curve]) -> _Frame:
        """A frame that holds everything."""
        xs = np.concatenate([c.x for c in curves])
        ys = np.concatenate([*(c.y for c in curves), *(c.top for c in curves if c.top is not None)])
        ys = np.concatenate([ys, [value for value, _ in axes.levels]])
        ys = ys[np.isfinite(ys)]
        if axes.logarithmic:
            ys = np.log10(np.maximum(ys, SMALLEST))
        # 6 % of the range above and below, or about a constant curve
        low, high = (float(ys.min()), float(ys.max())) if ys.size else (0.0, 1.0)
        pad = 0.06 * (high - low) if high > low else max(0.1 * abs(high), 1e-3)
        left, right = float(xs.min()), float(xs.max())
        if right <= left:
            left, right = left - 0.5, right + 0.5
        return cls((left, right), (low - pad, high + pad), axes.logarithmic)

    def at(self, x: Floats | float, y: Floats | float) -> tuple[Floats, Floats]:
        """Drawing coordinates."""
        y = np.log10(np.maximum(y, SMALLEST)) if self.logarithmic else np.asarray(y, dtype=float)
        # shares of the frame, then drawing units with y downwards
        across = (np.asarray(x, dtype=float) - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return LEFT + across * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM)


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers within a range, about `count` of them.

    Examples
    --------
    >>> ticks(-0.3, 16.2)
    [0.0, 5.0, 10.0, 15.0]
    """
    # the least of 1, 2, 2.5, 5, 10 times a power of ten that is not below range / count
    raw = (high - low) / count
    size = 10.0 ** floor(log10(raw))
    step = next(size * m for m in (1, 2, 2.5, 5, 10) if size * m >= raw * (1 - 1e-9))
    return [round(k * step, 12) + 0.0 for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def _grid(frame: _Frame, axes: Axes) -> list[str]:
    """Grid lines, numbers and labels."""
    parts = []
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    for value in ticks(*frame.x):
        x = frame.at(value, 1.0)[0]
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 15}" class="mid">{value:g}</text>')
    for value in ticks(*frame.y):
        if frame.logarithmic and value != round(value):
            continue
        y = float(frame.at(0.0, 10.0**value if frame.logarithmic else value)[1])
        text = f"1e{value:.0f}" if frame.logarithmic else f"{value:g}"
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" class="end">{text}</text>')
    parts.append(f'<text x="{(LEFT + right) / 2}" y="{HEIGHT - 6}" class="mid">{escape(axes.x)}</text>')
    turn = f'transform="translate(14 {(TOP + bottom) / 2}) rotate(-90)"'
    parts.append(f'<text {turn} class="mid">{escape(axes.y)}</text>')
    return parts


def _level(frame: _Frame, value: float, kind: str) -> str:
    """A level across the chart; `kind` is a class of the style sheet."""
    y = float(frame.at(0.0, value)[1])
    return f'<line class="level {kind}" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'


def _curve(frame: _Frame, curve: Curve) -> list[str]:
    """A curve's shaded area, its line, and the thick part of it; a point where there is but one."""
    x, y = curve.x, curve.y
    kind = f"c{curve.colour % COLOURS}"
    if curve.steps:
        keep = telling(y, POINTS)
        # a step function: each value from its begin to the next one's
        x, y = np.repeat(np.append(x[keep], x[-1]), 2)[1:-1], np.repeat(y[keep], 2)
    if len(x) == 1:
        px, py = frame.at(x, y)
        return [f'<circle class="point {kind}" cx="{px[0]:.1f}" cy="{py[0]:.1f}" r="5"/>']
    parts, top = [], curve.top
    if not curve.steps:
        keep = telling(y, POINTS)
        x, y, top = x[keep], y[keep], None if top is None else top[keep]
    if top is not None:
        parts += [f'<path class="area {kind}" d="{d}"/>' for d in _areas(frame, x, y, top)]
    parts.append(f'<path class="line {kind}" d="{_path(frame, x, y)}"/>')
    if curve.bold is not None:
        inside = (x >= curve.bold[0] - 1e-9) & (x <= curve.bold[1] + 1e-9)
        parts.append(f'<path class="line bold {kind}" d="{_path(frame, x[inside], y[inside])}"/>')
    return parts


def _path(frame: _Frame, x: Floats, y: Floats) -> str:
    """The commands of a line that is broken where y is not finite."""
    px, py = frame.at(x, y)
    text, pen = [], False
    for a, b, there in zip(px.tolist(), py.tolist(), np.isfinite(y).tolist(), strict=True):
        if there:
            text.append(f"{'L' if pen else 'M'}{a:.1f} {b:.1f}")
        pen = there
    return "".join(text)


def _areas(frame: _Frame, x: Floats, low: Floats, high: Floats) -> list[str]:
    """Closed paths between two curves, one for each stretch where both are finite."""
    there = np.isfinite(low) & np.isfinite(high)
    # begins and ends of the stretches where both curves are finite
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        part = slice(begin, end)
        around = np.concatenate([x[part], x[part][::-1]])
        found.append(_path(frame, around, np.concatenate([low[part], high[part][::-1]])) + "Z")
    return found


def _legend(curves: Sequence[Curve]) -> str:
    """Names with samples of their lines; none for a single curve without a name."""
    named = [c for c in curves if c.name]
    entries = [
        f'<li><svg viewBox="0 0 30 10"><path class="line c{c.colour % COLOURS}" d="M1 5H29"/></svg>'
        f'<span title="{escape(c.name)}">{escape(short(c.name, LONGEST))}</span></li>'
        for c in named
    ]
    return f'<ul class="legend">{"".join(entries)}</ul>' if entries else ""
