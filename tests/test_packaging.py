"""What pyproject.toml declares is what the sources import, and what the job with the oldest libraries installs."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
import yaml

from ensemble_ctrl import __version__
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


def test_the_conda_recipe_has_the_same_requirements() -> None:
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    run = {entry.replace(" ", "") for entry in recipe["requirements"]["run"]}
    wanted = {entry.replace("matplotlib", "matplotlib-base") for entry in PROJECT["dependencies"]}
    assert run == wanted | {f"python{PROJECT['requires-python']}"}
    assert recipe["context"]["version"] == cited()["version"]


def cited() -> dict[str, Any]:
    """CITATION.cff."""
    found: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    return found


def test_what_is_cited_is_this_version() -> None:
    assert cited()["version"] == __version__
    assert cited()["license"] == PROJECT["license"]
    assert cited()["repository-code"] == PROJECT["urls"]["Homepage"]


def test_the_packages_page_links_to_nothing_relative() -> None:
    hook = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["metadata"]["hooks"]
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    for change in hook["fancy-pypi-readme"]["substitutions"]:
        page = re.sub(change["pattern"], change["replacement"], page)
    links = re.findall(r"\]\(([^)]+)\)|src=\"([^\"]+)\"", page)
    assert len(links) > 20
    assert [link for pair in links for link in pair if link and not link.startswith("https://")] == []


def test_every_supported_python_is_a_classifier() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    named = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", line)}
    assert named <= set(re.findall(r'"(3\.\d+)"', workflow))
    assert "3.11" in named


@pytest.mark.parametrize("path", sorted((ROOT / ".github").rglob("*.yml")), ids=lambda path: path.name)
def test_forms_and_workflows_are_yaml(path: Path) -> None:
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)
