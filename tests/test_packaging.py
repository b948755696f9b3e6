"""What pyproject.toml declares is what the sources import, and what the job with the oldest libraries installs."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import tomllib
from importlib.metadata import packages_distributions

from tests.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def names(requirements: list[str]) -> set[str]:
    """Names of the distributions in a list of requirements."""
    return {re.split(r"[<>=\[;! ]", entry)[0].lower() for entry in requirements}


def imported() -> set[str]:
    """Every module outside of Python's own library that the sources import anywhere."""
    found = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"ensemble_ctrl", "__future__"}


def test_what_is_imported_is_declared_and_the_other_way_round() -> None:
    of_module = packages_distributions()
    used = {of_module[module][0].lower() for module in imported() - {"IPython"} if module in of_module}
    declared = names(PROJECT["dependencies"])
    optional = {name for extra in PROJECT["optional-dependencies"].values() for name in names(extra)}
    assert declared <= used
    assert used - declared <= optional


def test_the_constraints_are_the_declared_minimums() -> None:
    wanted = runpy.run_path(str(ROOT / ".ci" / "minimum.py"))["constraints"]()
    assert (ROOT / ".ci" / "minimum.txt").read_text(encoding="utf-8") == wanted
    assert all(re.fullmatch(r"[a-z]+==[\d.]+", line) for line in wanted.splitlines())
    assert len(wanted.splitlines()) == len(PROJECT["dependencies"])
