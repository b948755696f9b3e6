"""Configuration of the Sphinx site; build it with ``sphinx-build -W -b html docs docs/_build``."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import jupytext  # noqa: E402
from reference import write_reference  # noqa: E402
from sphinx.util.fileutil import copy_asset  # noqa: E402

from ensemble_ctrl import __version__  # noqa: E402

write_reference(HERE / "_generated")
shutil.copyfile(HERE.parent / "examples" / "five_obstacles.ipynb", HERE / "notebook.ipynb")
(HERE / "tutorials").mkdir(exist_ok=True)
for script in (HERE.parent / "examples").glob("[0-9]_*.py"):
    notebook = jupytext.read(script)
    notebook.metadata["language_info"] = {"name": "python", "pygments_lexer": "ipython3"}
    jupytext.write(notebook, HERE / "tutorials" / f"{script.stem}.ipynb")

project = "ensemble_ctrl"
author = "The ensemble_ctrl developers"
copyright = author
release = version = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "_generated", "jupyter_execute"]
default_role = "literal"

html_theme = "furo"
html_title = "ensemble_ctrl"
html_static_path = ["_static"]
mathjax_path = "mathjax/tex-chtml.js"
"""On the site itself, so that it needs no network; the pages' own path to `_static` comes before it."""
MATHJAX = ("tex-chtml.js", "output/chtml", "input/tex")
"""What is copied of the files that the package ``sphinx-mathjax-offline`` ships (MathJax 3, Apache License 2.0)."""

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_merge_streams = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True

autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True


def _shapes_are_text(app: Any, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Set types with an array's shape as text: ``steps`` in ``shape (steps, 2)`` is no name to link to."""
    lines[:] = [re.sub(r"^(\s*:\w*type[^:]*:) (.*shape .*)$", r"\1 *\2*", line) for line in lines]


def _copy_mathjax(app: Any, error: Exception | None) -> None:
    """Put MathJax with its fonts on a site of pages."""
    if error is not None or app.builder.format != "html":
        return
    package = importlib.util.find_spec("sphinx-mathjax-offline")
    assert package is not None, "pip install '.[docs]'"
    assert package.origin is not None
    source, target = Path(package.origin).parent / "static" / "mathjax", Path(app.outdir) / "_static" / "mathjax"
    for name in MATHJAX:
        copy_asset(source / name, target / name if (source / name).is_dir() else target)
    (target / "LICENSE.txt").write_text(LICENSE, encoding="utf-8")


LICENSE = """\
MathJax 3.2.2, Copyright the MathJax Consortium, licensed under the Apache License, Version 2.0
(http://www.apache.org/licenses/LICENSE-2.0); its files are unchanged.
"""


def setup(app: Any) -> None:
    """Register what follows napoleon's reading of a docstring, and the site's MathJax."""
    app.connect("autodoc-process-docstring", _shapes_are_text, priority=900)
    app.connect("build-finished", _copy_mathjax)
