"""A map that was dropped on the page, as changes of the problem file."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ensemble_ctrl.api.edit.changes import ChangeError
from ensemble_ctrl.api.edit.session import Session
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config import import_map
from ensemble_ctrl.files.config.tree import Tree

ENDINGS = (".geojson", ".json", ".wkt")
"""Maps that are one file of text."""


def imported(name: str, content: str, session: Session) -> list[dict[str, Any]]:
    """The changes that add a map's areas, each written out in the problem file, under names that are free there.

    Raises
    ------
    EnsembleError
        If it is no map of one text file, or can't be read.
    """
    ending = Path(name).suffix.lower()
    if ending not in ENDINGS:
        raise ChangeError(f"expected a map as {', '.join(ENDINGS)}, got {Path(name).name!r}; import others by command")
    with TemporaryDirectory() as folder:
        path = Path(folder, "map" + ending)  # never the name that was sent
        put_file(path, content)
        found = import_map(path)
    data = session.checked.data if isinstance(session.checked.data, dict) else {}
    taken = {name for section in ("obstacles", "regions") for name in data.get(section) or {}}
    edits = []
    for section, areas in (Tree.read(found.section).data or {}).items():
        for area, shape in areas.items():
            free = _free(area, taken)
            taken.add(free)
            edits.append({"do": "put", "path": [section, free], "value": shape})
    if not edits:
        raise ChangeError(f"{Path(name).name}: expected areas, got a map without any")
    return edits


def _free(name: str, taken: set[str]) -> str:
    """A name that is not taken."""
    plain = re.sub(r"[^\w.-]", "_", name) or "area"
    return next(n for n in (plain, *(f"{plain}_{k}" for k in range(2, 10_000))) if n not in taken)
