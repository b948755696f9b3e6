"""``ensemble-plan import``: a map from another tool as a problem file."""

from __future__ import annotations

from pathlib import Path
from typing import cast, get_args

from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.errors import EnsembleError, shortened
from ensemble_ctrl.files.config import import_map
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.map_formats import counted_pieces
from ensemble_ctrl.files.config.occupancy import Unknown
from ensemble_ctrl.files.folder import write_text
from ensemble_ctrl.problem.arguments.units import quantity


def import_file(
    source: Path,
    output: Path | None,
    tolerance: str | None,
    unknown: str | None,
    section: bool,
    overwrite: bool,
) -> None:
    """Print a map as a problem file, or write it.

    Raises
    ------
    EnsembleError
        If the map, the tolerance or what unknown cells are is not what was wanted, or the file is there already.
    """
    found = import_map(source, None if tolerance is None else _length(tolerance), _unknown(unknown))
    for note in found.notes:
        complain(f"{source}: warning: {note}")
    text = found.section if section else found.problem
    kept = counted_pieces(found.obstacles, found.pieces)
    if output is None:
        say(text.rstrip("\n"))
        complain(f"{source}: {kept}")
    else:
        write_text(output, text, overwrite)
        say(f"wrote {output}: {kept}" + ("" if section else f"; now run: ensemble-plan check {output}"))


def _length(text: str) -> float:
    """A length of at least 0, with a unit or in metres."""
    try:
        return quantity("length", 0)(text)
    except FieldError as error:
        raise EnsembleError(f"--tolerance: {error.message}") from None


def _unknown(text: str | None) -> Unknown | None:
    """What unknown cells are, as typed."""
    for known in get_args(Unknown):
        if text == known:
            return cast(Unknown, known)
    if text is not None:
        raise EnsembleError(f"--unknown: expected occupied or free, got {shortened(repr(text))}")
    return None
