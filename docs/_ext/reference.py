"""Pages that are made from the code, so that they can't disagree with it: fields, commands, limits."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel

from ensemble_ctrl.cli.app import NAME, app, invoke
from ensemble_ctrl.config import fields as f
from ensemble_ctrl.config.laws import Measured, MixturePart
from ensemble_ctrl.config.schema import ProblemFile
from ensemble_ctrl.systems import SYSTEMS

UNITS: list[tuple[Any, str]] = [
    (f.Point, "[m, m]"),
    (f.Range, "[–, –]"),
    (f.SpeedBounds, "[m/s, m/s]"),
    (f.TurnRateBounds, "[rad/s, rad/s]"),
    (f.Length, "m"),
    (f.Margin, "m, ≥ 0"),
    (f.Duration, "s, > 0"),
    (f.FreeDuration, "s, > 0, or `{at_least, at_most}`"),
    (f.Effort, "number, ≥ 0, or one for each"),
    (f.Angle, "rad"),
    (f.Weight, "number, ≥ 0"),
    (f.Task, "formula"),
    (f.Order, "1 to 50, or `auto`"),
    (f.Routes, "1 to 1000, or `all`"),
    (f.ModelName, ", ".join(f"`{name}`" for name in SYSTEMS)),
    (f.FolderName, "text"),
    (Measured, "list, or a file's name"),
    (list[MixturePart], "list"),
]
"""What a field's type is measured in."""

MEANING = {
    "version": "Version of the file's format.",
    "name": "Names the results folder; by default the file's name.",
    "fleet.model": "The dynamics all members share; `ensemble-plan models` lists them.",
    "fleet.wheelbase": "Bicycle only: distance between the axles; 0.3 m if not given.",
    "fleet.parameters": "What differs between members; without the section, `traction` from 0.9 to 1.1.",
    "fleet.parameters.traction.range": "Factor on speed and turn rate at once, uniform; above 0.",
    "fleet.parameters.linear_traction.range": "Factor on the speed alone, uniform; above 0.",
    "fleet.parameters.angular_traction.range": "Factor on the turn rate alone, uniform; above 0.",
    "fleet.parameters.start_x.range": "Offset of the start from `start.position`, uniform.",
    "fleet.parameters.start_y.range": "Offset of the start from `start.position`, uniform.",
    "fleet.parameters.start_heading.range": "Offset of the heading from `start.heading`, counter-clockwise, uniform.",
    "fleet.cloud": "Measured robots whose parameters belong together: a CSV file with a column for each, or columns.",
    "fleet.start.position": "Start of all members, but for `start_x` and `start_y`.",
    "fleet.start.heading": "Start heading of all members, but for `start_heading`.",
    "fleet.parameters.traction.law": "How it is spread over the range; see [laws](laws.md).",
    "fleet.parameters.traction.a": "Shape of a Beta law at the low end.",
    "fleet.parameters.traction.b": "Shape of a Beta law at the high end.",
    "fleet.parameters.traction.mean": "Mean of a normal law, before it is cut off at the range's ends.",
    "fleet.parameters.traction.deviation": "Standard deviation of a normal law, before it is cut off.",
    "fleet.parameters.traction.samples": "Measured values, or a CSV file of them, in place of a range.",
    "fleet.parameters.traction.mixture": "A list of laws, each with a `weight`, in place of a range.",
    "fleet.start.heading_from": "`x`: from +x, counter-clockwise. `y`: from +y, clockwise (the paper's).",
    "fleet.input_bounds.v": "Bounds of the commanded speed.",
    "fleet.input_bounds.omega": "Unicycle: bounds of the commanded turn rate.",
    "fleet.input_bounds.delta": "Bicycle: bounds of the steering angle, within ±1.5 rad.",
    "fleet.rate_bounds.v": "Largest change of the speed per second, m/s².",
    "fleet.rate_bounds.omega": "Unicycle: largest change of the turn rate per second, rad/s².",
    "fleet.rate_bounds.delta": "Bicycle: largest change of the steering angle per second, rad/s.",
    "fleet.radius": "Radius of a robot; what `avoid(...)` names grows by it.",
    "horizon.duration": "Length of the plan, `T` in the task; or the shortest: [minimum time](objectives.md).",
    "horizon.steps": "Control steps of equal length; by default one each 0.1 s.",
    "moments.basis": "Polynomials of the moments.",
    "moments.order": "Truncation order N: moments 0 to N. `auto` takes the lowest one that errs by less than 0.1 mm.",
    "regions.<name>": "A named convex area; see *Areas* below.",
    "obstacles.<name>": "A named area to keep out of, one shape or a list of shapes; see *Areas* below.",
    "motions.<name>.velocity": "Obstacle of that name: constant velocity from where it is drawn.",
    "motions.<name>.path": "Or its displacement over time: `[[time, [x, y]], ...]`, linear in between.",
    "task": "What every member has to do; see [the task language](task_language.md).",
    "objective.robustness": "Reward for each metre of the task's robustness.",
    "objective.terminal.target": "Where the fleet should end, see [targets](targets.md); without it no terminal term.",
    "objective.terminal.weight": "Price of the squared terminal moment error, per m².",
    "objective.effort": "Price of the integral of the squared commands; or one for each: `{v: 0.1, omega: 0.02}`.",
    "objective.cvar.of": "What the worst part of the fleet has a price on; see [risk](objectives.md).",
    "objective.cvar.level": "Share of the fleet that is left out of the mean.",
    "objective.cvar.weight": "Price of a metre.",
    "objective.earliest": "A region to pass as soon as can be; see [objectives](objectives.md).",
    "objective.smoothness": "Price of the integral of the squared rates of the commands.",
    "solve.method": "`nlp`: nonlinear program, IPOPT.",
    "solve.guarantee": "For whom the program's constraints hold; see [guarantees](guarantees.md).",
    "solve.time_limit": "The best plan so far is returned after this time.",
    "solve.seed": "Seed of the replayed members.",
    "solve.margin": "What the program keeps to spare, from obstacles and in the robustness.",
    "solve.routes": "Routes tried on a coarse grid before the best is refined. `all`: see *Routes* below.",
    "solve.max_iterations": "Iterations of one solve.",
    "solve.cells": "Parts of the first parameter's range with separating lines of their own; for wide fleets.",
    "verify.members": "Members replayed.",
    "verify.substeps": "Looks at the obstacles in each step of the replay.",
    "verify.certificate": "Prove the plan for all parameters and times, and tighten until that succeeds.",
    "report.twin": "Plan the same problem without obstacles and bounding regions too, and draw it dashed.",
}
"""What a field says; a field that is missing here shows without a remark."""


def write_reference(folder: Path) -> None:
    """Write every generated page into `folder`."""
    folder.mkdir(exist_ok=True)
    for name, lines in (("fields.md", field_table()), ("commands.md", command_help())):
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


def field_table() -> Iterator[str]:
    """Every field of a problem file: unit, default, meaning."""
    yield "| field | unit or values | default | meaning |"
    yield "|---|---|---|---|"
    for path, annotation, default in fields(ProblemFile):
        yield f"| `{path}` | {unit(annotation)} | {default} | {MEANING.get(path, '')} |"


def fields(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, Any, str]]:
    """Path, type and default of every field, sections opened."""
    for name, info in model.model_fields.items():
        path, kind = f"{prefix}{name}", _plain(info.annotation)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from fields(kind, f"{path}.")
        elif name in ("regions", "obstacles"):
            yield f"{path}.<name>", "an area", "none"
        else:
            yield path, _annotated(model, name), _default(info, path)


def unit(annotation: Any) -> str:
    """What a value is measured in, or the values there are."""
    if annotation == "an area":
        return "area"
    required = _required(annotation)
    for known, text in UNITS:
        if known in (annotation, required):
            return text
    kind = _plain(annotation)
    if get_args(kind) and all(isinstance(value, str) for value in get_args(kind)):
        return ", ".join(f"`{value}`" for value in get_args(kind))
    return {int: "whole number", bool: "`true`, `false`", float: "number", str: "text"}.get(kind, "")


def command_help() -> Iterator[str]:
    """The help of every subcommand, as the command prints it."""
    os.environ["COLUMNS"] = "80"
    for command in app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        printed = io.StringIO()
        with redirect_stdout(printed):
            invoke([name, "--help"])
        yield from (f"## `{NAME} {name}`", "", "```text", printed.getvalue().strip(), "```", "")


def _annotated(model: type[BaseModel], name: str) -> Any:
    """A field's type with its validators, as it was written."""
    return get_type_hints(model, include_extras=True)[name]


def _required(kind: Any) -> Any:
    """A type without ``| None``."""
    options = [option for option in get_args(kind) if option is not type(None)]
    return options[0] if type(None) in get_args(kind) and len(options) == 1 else kind


def _plain(kind: Any) -> Any:
    """A type without ``Annotated`` and without ``| None``."""
    kind = _required(kind)
    while hasattr(kind, "__metadata__"):
        kind = _required(get_args(kind)[0])
    return kind


def _default(info: Any, path: str) -> str:
    """A default as it would stand in a file."""
    if path == "objective.terminal.target":
        return "required with `terminal`"
    if path == "objective.cvar.of":
        return "required with `cvar`"
    if info.is_required():
        return "**required**"
    value = info.default
    if value is None:
        return {"moments.order": "`auto`", "horizon.steps": "10 per s", "name": "file name"}.get(path, "none")
    return (
        f"`{list(value)}`"
        if isinstance(value, tuple)
        else f"`{str(value).lower() if isinstance(value, bool) else value}`"
    )
