"""Problem files: YAML to `Problem` and back, with errors that name file, line and column.

The fields are in `schema`; a text passes through `source` (bytes), `tree` (YAML with places), `overrides`,
`schema` (validation) and `build`; `messages` puts into words what is wrong on the way.
"""

from ensemble_ctrl.config.dump import dump, to_data
from ensemble_ctrl.config.imported import Imported, import_map
from ensemble_ctrl.config.load import Loaded, load, load_text, read, read_text, schema
from ensemble_ctrl.config.messages import Diagnostic, layout

__all__ = [
    "Diagnostic",
    "Imported",
    "Loaded",
    "dump",
    "import_map",
    "layout",
    "load",
    "load_text",
    "read",
    "read_text",
    "schema",
    "to_data",
]
