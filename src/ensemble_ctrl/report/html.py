"""``report.html``: one file with what a plan does and what is proven of it, without a network, on any screen.

Everything that comes from a problem is escaped; beyond that, the page's own policy lets the browser run no script but
the one that is written here.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.version import __version__
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.convergence import Descent, descents
from ensemble_ctrl.report.errors import patch_text
from ensemble_ctrl.report.pagecharts import Axes, Curve, chart
from ensemble_ctrl.report.pagemap import map_and_motion
from ensemble_ctrl.report.palette import hexadecimal, viridis
from ensemble_ctrl.report.series import by_parameter, distance_label, over_time
from ensemble_ctrl.report.text import PlanLike, parameter_label, summary_rows, unit_of, verdict
from ensemble_ctrl.report.tolerances import MEASURED, tolerance_bars
from ensemble_ctrl.report.transform import conflict_places
from ensemble_ctrl.report.tube import tubes
from ensemble_ctrl.report.words import certificate_words

Floats = NDArray[np.float64]

SOLVES = 6
"""Solves whose convergence is shown: the last ones, which led to the plan."""


def report_html(plan: PlanLike, problem_text: str, provenance: Mapping[str, Any] | None = None, log: str = "") -> str:
    """The page.

    Parameters
    ----------
    plan : PlanLike
        The plan with its problem and results; with `MEASURED` among its details, what it tolerates is shown, too.
    problem_text : str
        The problem file.
    provenance : mapping, optional
        Versions, command and time, as in ``provenance.json``.
    log : str
        The solver's own output, for its convergence.

    Returns
    -------
    str
        HTML that loads nothing.
    """
    problem, controls = plan.problem, plan.controls
    ribbons = tubes(problem, controls)
    marks = conflict_places(plan)
    drawing, motion = map_and_motion(problem, controls, ribbons, marks)
    style, script = _asset("drawing.css") + _asset("page.css"), _asset("page.js")
    sections = [
        _section("Map", _map(problem, drawing, bool(ribbons), bool(marks)), "wide"),
        _section("Certificate", _certificate(plan), "narrow"),
        _section("Controls", _controls(problem, controls), "half"),
        _section("Robustness over time", _robustness(problem, controls), "half"),
        _section("Clearance over the parameter", _clearance(plan), "half"),
        _section("Convergence", _convergence(descents(log)), "half"),
        _section("Tolerated errors of the model", _tolerances(plan)),
        _section("Problem file", f"<pre>{escape(problem_text)}</pre>"),
        _section("Provenance", _provenance(provenance or {})),
    ]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return Template(_asset("page.html")).substitute(
        version=__version__,
        script_hash=digest,
        name=escape(problem.name),
        style=style,
        verdict_class=verdict_class(plan),
        verdict=escape(verdict(plan)),
        facts=_rows(summary_rows(plan)),
        sections="\n".join(sections),
        motion=motion,
        script=script,
    )


def cards(plan: PlanLike) -> dict[str, str]:
    """What the page has below its map, as HTML by its title: certificate, controls, robustness, clearance.

    Notes
    -----
    *Guarantee*: every text that comes from the problem is escaped.
    """
    found = {
        "Certificate": _certificate(plan),
        "Controls": _controls(plan.problem, plan.controls),
        "Robustness over time": _robustness(plan.problem, plan.controls),
        "Clearance over the parameter": _clearance(plan),
    }
    return {title: body for title, body in found.items() if body}


def verdict_class(plan: PlanLike) -> str:
    """The verdict's colour: ``good`` only where nothing stands against it, else ``open`` or ``bad``."""
    run, certificate = plan.replayed, plan.certificate
    if plan.status == "infeasible" or (run is not None and run.violating.any()):
        return "bad"
    if certificate is not None and certificate.proven != "yes":
        return "bad" if certificate.proven == "no" else "open"
    return "good" if plan.status == "planned" and run is not None and certificate is not None else "open"


def _asset(name: str) -> str:
    """A file of this package."""
    return files("ensemble_ctrl.report").joinpath(name).read_text(encoding="utf-8")


def _section(title: str, body: str, width: str = "") -> str:
    """A card; nothing without a body."""
    return f'<section class="{width}"><h2>{title}</h2>{body}</section>' if body else ""


def _rows(pairs: Sequence[tuple[str, str]]) -> str:
    """Labels and texts as a list."""
    return "<dl>" + "".join(f"<dt>{escape(label)}</dt><dd>{escape(text)}</dd>" for label, text in pairs) + "</dl>"


def _map(problem: Problem, drawing: str, proven: bool, marked: bool) -> str:
    """The map, the player, what the colours mean and what the areas are."""
    player = (
        '<div class="player"><button id="play" type="button">Play</button>'
        '<input id="time" type="range" min="0" max="1000" step="1" value="1000" aria-label="time" '
        f'aria-valuetext="{problem.duration:.2f} s">'
        f'<output id="clock" for="time">t = {problem.duration:.2f} s</output></div>'
    )
    count = len(problem.fleet.places)
    bodies = "dots" if problem.fleet.footprint is None else "bodies"
    note = f"Lines: ways of some robots; {bodies}: where they are at the time shown."
    if count == 1:
        note = "The position over time. Lines: some robots; dots: where they are at the time shown."
    if count == 3:
        note = f"From above and from the side; dotted: obstacles beside the ways. {note}"
    if problem.terrain:
        patches = (f"{name}: {', '.join(patch_text(patch))}" for name, patch in problem.terrain.items())
        note = f"{note} Brown: terrain, in which robots may differ from the model ({escape('; '.join(patches))})."
    if problem.zones:
        limits = [zone.speed is not None for zone in problem.zones.values()]
        note += " Red: zones to keep out of." if not all(limits) else ""
        note += " Amber: zones with a speed limit." if any(limits) else ""
    if proven:
        note = f"Shaded: where every robot is proven to be (its centre), at some time of the plan. {note}"
    note += " Red rings: where the task fails worst." if marked else ""
    return f'<div class="maps">{drawing}</div>{player}{_scale(problem)}<p class="note">{note}</p>'


def _scale(problem: Problem) -> str:
    """Which colour is which value of the first parameter."""
    fleet = problem.fleet
    if not fleet.names or fleet.upper[0] <= fleet.lower[0]:
        return ""
    stops = ", ".join(hexadecimal(c) for c in viridis(np.linspace(0, 1, 9)))
    name, unit = escape(fleet.names[0]), unit_of(fleet.names[0])
    ends = (f"{end:.4g}{unit}" for end in (fleet.lower[0], fleet.upper[0]))
    low, high = ends
    return (
        f'<div class="scale"><span>{name} {low}</span><i style="background:linear-gradient(90deg, {stops})"></i>'
        f"<span>{high}</span></div>"
    )


def _certificate(plan: PlanLike) -> str:
    """The certificate in words."""
    words = certificate_words(plan.problem, plan.certificate)
    items = "".join(f"<li>{escape(text)}</li>" for text in words.bounds)
    bounds = f'<ul class="words">{items}</ul>' if items else ""
    return f'<p>{escape(words.lead)}</p>{bounds}<p class="note">{escape(words.note)}</p>'


def _controls(problem: Problem, controls: Floats) -> str:
    """A chart for every command, with its bounds."""
    fleet, system = problem.fleet, problem.fleet.system
    charts = []
    for i, (name, unit) in enumerate(zip(system.controls, system.control_units, strict=True)):
        bounds = (float(fleet.input_lower[i]), float(fleet.input_upper[i]))
        axes = Axes("t [s]", f"{name} [{unit}]", tuple((b, "bound") for b in bounds if np.isfinite(b)), time=True)
        charts.append(chart(axes, [Curve("", problem.times, controls[:, i], i, steps=True)], f"{name} over time"))
    return "".join(charts) + '<p class="note">One command for all robots. Dashed: its bounds.</p>'


def _robustness(problem: Problem, controls: Floats) -> str:
    """How far the fleet is from failing each part of the task."""
    times, series = over_time(problem, controls)
    if not series:
        return ""
    curves = [Curve(s.name, times, s.low, k, s.high, bold=(s.begin, s.end)) for k, s in enumerate(series)]
    axes = Axes("t [s]", distance_label(problem), ((0.0, "zero"),), time=True)
    note = "Line: the worst robot; shaded: up to the best one; thick: while the task asks for it. Below 0: not so then."
    return chart(axes, curves, "Robustness over time") + f'<p class="note">{note}</p>'


def _clearance(plan: PlanLike) -> str:
    """How close members of every parameter come to failing."""
    profile = by_parameter(plan.problem, plan.controls)
    curves = [Curve(name, profile.values, values, k) for k, (name, values) in enumerate(profile.curves.items())]
    if not curves:
        return ""
    certificate = plan.certificate
    bounds = [] if certificate is None else [certificate.clearance, certificate.robustness]
    levels = tuple((float(b), "proven") for b in bounds if np.isfinite(b))
    label = parameter_label(plan.problem, profile.parameter) if profile.parameter else "(all robots are equal)"
    axes = Axes(label, distance_label(plan.problem), ((0.0, "zero"), *levels))
    others = " The worst of the other parameters." if len(plan.problem.fleet.names) > 1 else ""
    others += f" Farther away: {escape(', '.join(profile.far))}." if profile.far else ""
    proven = " Dashed level: what is proven for all." if levels else ""
    return chart(axes, curves, "Clearance over the parameter") + f'<p class="note">Least over time.{others}{proven}</p>'


def _tolerances(plan: PlanLike) -> str:
    """How much error of the model the plan tolerates, if that was measured."""
    found = plan.details.get(MEASURED)
    return "" if found is None else tolerance_bars(found)


def _convergence(solves: Sequence[Descent]) -> str:
    """Cost and violation of the last solves, one after the other."""
    shown = [solve for solve in solves if len(solve.objective) > 1][-SOLVES:]
    if not shown:
        return ""
    charts = []
    for name, values, logarithmic in (
        ("cost [-]", [s.objective for s in shown], False),
        ("violation (scaled) [-]", [s.violation for s in shown], True),
    ):
        starts = np.cumsum([0, *(len(v) for v in values)])
        curves = [Curve("", starts[k] + np.arange(len(v), dtype=float), np.array(v), 0) for k, v in enumerate(values)]
        charts.append(chart(Axes("iteration", name, logarithmic=logarithmic), curves, f"{name} by iteration"))
    count = f"The last {len(shown)} of {len(solves)} solves" if len(shown) < len(solves) else f"{len(shown)} solves"
    return "".join(charts) + f'<p class="note">{count} of IPOPT, each from where a line begins.</p>'


def _provenance(facts: Mapping[str, Any]) -> str:
    """Where it comes from, one row a fact."""
    return _rows(list(_flat({"ensemble_ctrl": __version__, **facts})))


def _flat(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Nested facts as rows."""
    for name, value in facts.items():
        if isinstance(value, Mapping):
            yield name, ", ".join(f"{key} {one}" for key, one in value.items() if one is not None)
        elif isinstance(value, list | tuple):
            yield name, " ".join(map(str, value))
        else:
            yield name, value if isinstance(value, str) else json.dumps(value)
