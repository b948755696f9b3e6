"""Pages that are made from the code, so that they can't disagree with it: fields, commands, limits."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, get_args, get_type_hints

import ensemble_ctrl
from ensemble_ctrl.cli.app import NAME, app, invoke
from ensemble_ctrl.files.config import fields as f
from ensemble_ctrl.files.config import meanings
from ensemble_ctrl.files.config import online as o
from ensemble_ctrl.files.config.distributions import (
    DistributionName,
    DistributionSection,
    Measured,
    MixturePart,
    PartSection,
)
from ensemble_ctrl.files.config.fields import Model
from ensemble_ctrl.files.config.joint_samples import JointSamples
from ensemble_ctrl.files.config.motions import Course, MotionSection, Velocity
from ensemble_ctrl.files.config.schema import ProblemFile
from ensemble_ctrl.files.config.shapes import ObstacleShape, RegionShape
from ensemble_ctrl.files.config.targets import Terminal
from ensemble_ctrl.moments import DISTRIBUTIONS
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
    (f.Positive, "number, > 0"),
    (f.Wheelbase, "m, > 0"),
    (f.SteeringBounds, "[rad, rad]"),
    (JointSamples, "a file's name, or columns"),
    (Velocity, "[m/s, m/s]"),
    (Terminal, "[m, m], or a [target](targets.md)"),
    (f.Task, "formula"),
    (f.Order, "1 to 50, or `auto`"),
    (f.Routes, "1 to 1000, or `all`"),
    (DistributionName, ", ".join([*(f"`{name}`" for name in DISTRIBUTIONS), "or [another](extending.md)"])),
    (f.ModelName, ", ".join([*(f"`{name}`" for name in SYSTEMS), "or [another](systems.md)"])),
    (Course, "[[s, [m, m]], ...]"),
    (o.Turn, "rad, ≥ 0"),
    (o.Delay, "s, ≥ 0"),
    (o.Rate, "number, ≥ 0"),
    (o.Share, "0 to below 1"),
    (o.Magnitudes, "[m/s, of the other command]"),
    (list[o.PatchSection], "list"),
    (f.FolderName, "text"),
    (Measured, "list, or a file's name"),
    (list[MixturePart], "list"),
    (dict[str, f.Number], "numbers by name"),
]
"""What a field's type is measured in."""

Row = tuple[str, Any, str, str]
"""Path, type, default and meaning of a field."""


def write_reference(folder: Path) -> None:
    """Write every generated page into `folder`."""
    folder.mkdir(exist_ok=True)
    pages = {
        "names.md": public_names(),
        "fields.md": field_table(),
        "areas.md": area_table(),
        "loops.md": loop_table(),
        "commands.md": command_help(),
    }
    for name, lines in pages.items():
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


def public_names() -> Iterator[str]:
    """Everything that `ensemble_ctrl` itself exports, with the first line of its docstring."""
    yield from ("```{eval-rst}", ".. currentmodule:: ensemble_ctrl", "", ".. autosummary::", "   :nosignatures:", "")
    yield from (f"   {name}" for name in ensemble_ctrl.__all__ if not name.startswith("_"))
    yield "```"


def field_table() -> Iterator[str]:
    """Every field of a problem file: unit, default, meaning; then those of a distribution."""
    yield from _table("field", fields(ProblemFile))
    yield from ("", "### A distribution", "", "The fields of each of `fleet.parameters`:", "")
    yield from _table("field", fields(DistributionSection))


def loop_table() -> Iterator[str]:
    """Every field of the section about loops."""
    yield from _table("field", fields(o.OnlineSection, "online."))


def area_table() -> Iterator[str]:
    """The forms of an area."""
    regions, obstacles = meanings(RegionShape), meanings(ObstacleShape)
    yield from ("| form | of a region | of an obstacle |", "|---|---|---|")
    for form in ObstacleShape.model_fields:
        yield f"| `{form}` | {regions.get(form, 'no')} | {obstacles[form]} |"


def _table(head: str, rows: Iterable[Row]) -> Iterator[str]:
    """Rows as a table."""
    yield from (f"| {head} | unit or values | default | meaning |", "|---|---|---|---|")
    for path, kind, default, meaning in rows:
        yield f"| `{path}` | {unit(kind)} | {default} | {' '.join(meaning.split())} |"


def fields(model: type[Model], prefix: str = "") -> Iterator[Row]:
    """Path, type, default and meaning of every field, sections opened."""
    said = meanings(model)
    for name, info in model.model_fields.items():
        path, kind = f"{prefix}{name}", _plain(info.annotation)
        if name == "online":
            yield path, "a section", "none", said[name]
        elif isinstance(kind, type) and issubclass(kind, PartSection):
            yield path, "a distribution", "the same for all", said[name]
        elif isinstance(kind, type) and issubclass(kind, Model):
            yield from fields(kind, f"{path}.")
        elif name == "robots":
            yield f"{path}.<name>", "a robot", "none", said[name]
        elif name == "motions":
            yield from fields(MotionSection, f"{path}.<name>.")
        elif name in ("regions", "obstacles"):
            yield f"{path}.<name>", "an area", "none", f"{said[name]} See [areas](problem_file.md#areas)."
            if model is o.OnlineSection:
                yield from _beside_shape(o.ComingSection, f"{path}.<name>.")
        else:
            yield path, _annotated(model, name), _default(info, path), said[name]


def _beside_shape(model: type[Model], prefix: str) -> Iterator[Row]:
    """The fields of an obstacle that are not of its shape."""
    shape = tuple(f"{prefix}{name}" for name in ObstacleShape.model_fields)
    yield from (row for row in fields(model, prefix) if not row[0].startswith(shape))


def unit(annotation: Any) -> str:
    """What a value is measured in, or the values there are."""
    if annotation == "an area":
        return "[area](problem_file.md#areas)"
    if annotation == "a distribution":
        return "[distribution](distributions.md)"
    if annotation == "a section":
        return "[section](online.md)"
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


def _annotated(model: type[Model], name: str) -> Any:
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
    if path.startswith("online.robot.drifting."):
        return "required with `drifting`"
    if path.startswith("online.robot.noise."):
        return "as assumed"
    if path == "online.noise.heading":
        return "1 deg"
    if info.is_required():
        return "**required**"
    value = info.get_default(call_default_factory=True)
    if value is None or value == []:
        return {"moments.order": "`auto`", "horizon.steps": "10 per s", "name": "file name"}.get(path, "none")
    return (
        f"`{list(value)}`"
        if isinstance(value, tuple)
        else f"`{str(value).lower() if isinstance(value, bool) else value}`"
    )
