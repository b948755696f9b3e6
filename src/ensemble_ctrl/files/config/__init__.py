"""Problem files: YAML to `Problem` and back, with errors that name file, line and column.

The fields are in `schema`, each with its meaning, which `describe` reads; a text passes through `source` (bytes),
`tree` (YAML with places), `overrides`, `schema` (validation) and `build`; `messages` describes what is wrong.
"""

from ensemble_ctrl.files.config.describe import meanings, schema
from ensemble_ctrl.files.config.dump import dump, to_data
from ensemble_ctrl.files.config.load import Loaded, load, load_text, read, read_text
from ensemble_ctrl.files.config.map_formats import Imported, import_map
from ensemble_ctrl.files.config.messages import Diagnostic, layout
from ensemble_ctrl.files.config.user_system import named_source
from ensemble_ctrl.files.config.variants import Variants

__all__ = [
    "Diagnostic",
    "Imported",
    "Loaded",
    "Variants",
    "dump",
    "import_map",
    "layout",
    "load",
    "load_text",
    "meanings",
    "named_source",
    "read",
    "read_text",
    "schema",
    "to_data",
]
