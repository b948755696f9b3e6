"""What the pages print of runs: which code and files a figure comes from, and how it gets onto its page.

A figure is kept with the digest of everything that decides it. Where the digest of today is another one, the figure is
stale, and the commands that print figures make it again.
"""

from __future__ import annotations

import ast
import hashlib
import json
import re
from functools import cache
from math import floor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "ensemble_ctrl"
LEFT_OUT = ("api/edit", "cli", "report", "files/export", "planning/online", "planning/suggest")
"""Packages that decide no plan and no proof."""


def source(problem: Path, left_out: tuple[str, ...] = LEFT_OUT) -> str:
    """Digest of a problem file, of the maps and samples beside it, and of the code that plans and proves."""
    beside = [path for path in sorted(problem.parent.iterdir()) if path.is_file() and path.suffix != ".yaml"]
    found = hashlib.sha256(_code(left_out).encode())
    for path in (problem, *beside):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


@cache
def _code(left_out: tuple[str, ...]) -> str:
    """Digest of the code without its comments and docstrings, which decide nothing."""
    found = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        if not path.relative_to(PACKAGE).as_posix().startswith(left_out):
            found.update(ast.dump(_bare(ast.parse(path.read_text(encoding="utf-8")))).encode())
    return found.hexdigest()


def _bare(tree: ast.Module) -> ast.Module:
    """The tree without strings that stand alone."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return tree


def _is_text(line: ast.AST) -> bool:
    """Whether a statement is a docstring, or the words below a constant."""
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


def read(path: Path) -> dict[str, Any]:
    """A file of figures; none yet is an empty one."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return found


def write(path: Path, figures: dict[str, Any]) -> None:
    """Keep figures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(figures, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def rounded_down(bound: float) -> float:
    """A proven bound to a tenth of a millimetre, still proven."""
    return floor(1e4 * bound) / 1e4


def block(page: str, name: str, lines: list[str] | None = None) -> tuple[str, str]:
    """The page with the lines of one block, or as it is, and the block that then stands there.

    Raises
    ------
    ValueError
        If the page has no such block.
    """
    found = re.search(rf"(<!-- begin {name}: [^\n]* -->\n)(.*?)(<!-- end {name} -->)", page, re.DOTALL)
    if found is None:
        raise ValueError(f"no block {name!r} in the page")
    text = found[2] if lines is None else "\n".join(lines) + "\n"
    return page[: found.start(2)] + text + page[found.end(2) :], text
