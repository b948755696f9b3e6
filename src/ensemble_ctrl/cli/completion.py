"""What a shell offers for the values of arguments and options; imports wait until it asks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def examples(incomplete: str) -> list[str]:
    """Names of the example problems."""
    from ensemble_ctrl.files.examples import examples as known

    return _starting(incomplete, known())


def kinds(incomplete: str) -> list[str]:
    """Kinds of pictures."""
    from ensemble_ctrl.report.plot import KINDS

    return _starting(incomplete, KINDS)


def methods(incomplete: str) -> list[str]:
    """Solution methods."""
    return _starting(incomplete, ("nlp", "minlp"))


def picture_formats(incomplete: str) -> list[str]:
    """Formats of figures."""
    from ensemble_ctrl.report.canvas import FORMATS

    return _starting(incomplete, FORMATS)


def film_formats(incomplete: str) -> list[str]:
    """Formats of animations."""
    return _starting(incomplete, ("gif", "mp4"))


def export_formats(incomplete: str) -> list[str]:
    """Formats for other programs."""
    return _starting(incomplete, ("csv", "json", "geojson", "rosbag"))


def unknown_cells(incomplete: str) -> list[str]:
    """What unknown cells of an occupancy grid can count as."""
    return _starting(incomplete, ("occupied", "free"))


def keys(incomplete: str) -> list[str]:
    """Dotted keys of a problem file, with the ``=`` that follows them."""
    from ensemble_ctrl.files.config.schema import ProblemFile

    return _starting(incomplete, [f"{key}=" for key in _keys(ProblemFile)])


def _keys(model: Any) -> Iterator[str]:
    """The dotted keys of the fields of a section that are no sections themselves."""
    from ensemble_ctrl.files.config.fields import Model
    from ensemble_ctrl.files.config.messages import plain_type

    for name, field in model.model_fields.items():
        kind = plain_type(field.annotation)
        if isinstance(kind, type) and issubclass(kind, Model):
            yield from (f"{name}.{key}" for key in _keys(kind))
        else:
            yield name


def _starting(incomplete: str, known: Any) -> list[str]:
    """The known words that begin as what was typed."""
    return [word for word in known if word.startswith(incomplete)]
