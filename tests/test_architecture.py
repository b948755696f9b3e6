"""The arrows between the rooms, read from every import; a new room fails here until it is given its layer."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import ensemble_ctrl
from tests.paths import CONFIGS

ROOT = Path(ensemble_ctrl.__file__).parent
LAYERS: tuple[frozenset[str], ...] = tuple(
    frozenset(layer.split(", "))
    for layer in (
        "core.errors, core.version, core.plain, core.readonly, core.renamed, core.deferred, core.storage",
        "core.values",
        "core.jobs",
        "moments, systems",
        "constraints",
        "problem.risk, problem.target, problem.arguments, problem.units, problem.starts, problem.zones",
        "problem.ensemble, problem.integrated, problem.capabilities, problem.terrain, problem.uncertainty",
        "problem.arc_members",
        "problem.fleet",
        "problem.signals",
        "problem.checks, problem.drawing, problem.specification",
        "problem.problem",
        "problem.renamed, problem.plain",
        "problem.bounds",
        "problem.evaluation",
        "ocp",
        "certificate",
        "planning.planner, planning.baseline",
        "planning.online, planning.tolerance, planning.minimum_time, planning.suggest, report, files.planfile",
        "files.config, planning.ranges",
        "files.folder",
        "files.export, files.examples",
        "api.blocks",
        "api.plans",
        "api.planning",
        "api.channels, api.comparison, api.widening, api.paper, api.results, api.portable",
        "api.paper_study",
        "api.planned",
        "api.edit, api.many, api.sweep",
        "cli",
    )
)
ONLY_IN = {"casadi": "ocp", "matplotlib": "report", "yaml": "files"}
FACES = {"problem": "problem.problem", "api": "api.plans"}
"""What one imports from a package whose modules have an order of their own."""
EMPTY = {"core", "files", "planning"}
"""Packages that offer nothing themselves."""
TOP = 12
"""How many names may lie at the top of the package."""
LINES = 400
"""The most lines of one file: a longer one has more than one idea."""
LEVEL = {room: level for level, layer in enumerate(LAYERS) for room in layer}
FILES = sorted(path for path in ROOT.rglob("*.py") if path.parent != ROOT or not path.stem.startswith("__"))


def imports(source: str, package: str) -> Iterator[tuple[str, int]]:
    """Full names of the modules that a module of `package` imports at run time, with their lines."""
    todo: list[ast.AST] = [ast.parse(source)]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).removeprefix("typing.") == "TYPE_CHECKING":
            todo.extend(node.orelse)
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            if base == "ensemble_ctrl" or base.removeprefix("ensemble_ctrl.") in EMPTY:
                yield from ((f"{base}.{alias.name}", node.lineno) for alias in node.names)
            else:
                yield base, node.lineno
        todo.extend(ast.iter_child_nodes(node))


def room(name: str) -> str:
    """The room of a module, by its dotted name below the package."""
    first, _, rest = name.partition(".")
    if first in LEVEL:
        return first
    return f"{first}.{rest.partition('.')[0]}" if rest else FACES.get(first, first)


def room_of(path: Path) -> str:
    """The room that a file belongs to."""
    return room(".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"))


@cache
def arrows() -> tuple[tuple[str, str, str], ...]:
    """Importing room, imported module, and the place of the import."""
    return tuple(
        (room_of(path), module, f"{path.relative_to(ROOT)}:{line}")
        for path in FILES
        for module, line in imports(
            path.read_text(encoding="utf-8"), ".".join(["ensemble_ctrl", *path.relative_to(ROOT).parent.parts])
        )
    )


def test_every_room_has_a_layer() -> None:
    assert {room_of(path) for path in FILES} - set(LEVEL) - EMPTY == set(), "give the new room a layer in LAYERS"


def test_few_names_lie_at_the_top() -> None:
    names = [path.stem for path in ROOT.iterdir() if path.suffix in ("", ".py") and not path.stem.startswith("__")]
    assert len(names) <= TOP
    assert {name.partition(".")[0] for name in LEVEL} == set(names)


def test_no_file_is_long() -> None:
    lengths = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert {name: length for name, length in lengths.items() if length > LINES} == {}


def test_no_two_packages_import_each_other() -> None:
    """Not through others either."""
    below: dict[str, set[str]] = {name.partition(".")[0]: set() for name in LEVEL}
    for here, module, _ in arrows():
        if module.startswith("ensemble_ctrl."):
            below[here.partition(".")[0]].add(module.split(".")[1])
    left = {name: targets - {name} for name, targets in below.items()}
    while free := [name for name, targets in left.items() if not targets & set(left)]:
        for name in free:
            del left[name]
    assert left == {}


def test_the_page_has_the_same_rooms_and_layers() -> None:
    page = (ROOT.parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawn = page.partition("## Arrows")[2].split("```")[1].removeprefix("text\n").strip().splitlines()
    assert [frozenset(line.split(", ")) for line in drawn] == list(LAYERS)
    table = page.partition("## Rooms")[2].partition("## Arrows")[0]
    first = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    rooms = {name.strip(" `/") for cell in first for name in cell.split(",")}
    assert rooms == set(LEVEL)


def test_rooms_import_only_from_earlier_layers() -> None:
    wrong = []
    for here, module, place in arrows():
        target = room(module.removeprefix("ensemble_ctrl."))
        if not module.startswith("ensemble_ctrl") or target == here:
            continue
        if target not in LEVEL or LEVEL[target] >= LEVEL[here]:
            wrong.append(f"{place}: {here} must not import {target}")
    assert wrong == []


@pytest.mark.parametrize(("library", "home"), ONLY_IN.items())
def test_a_library_stays_in_its_room(library: str, home: str) -> None:
    users = {here.partition(".")[0]: place for here, module, place in arrows() if module.split(".")[0] == library}
    assert set(users) == {home}, users


@pytest.mark.parametrize("judge", ["problem.evaluation", "certificate"])
def test_what_judges_a_plan_shares_no_code_with_what_finds_it(judge: str) -> None:
    """Not even through other rooms."""
    reached, todo = set(), [judge]
    edges = [
        (here, room(module.removeprefix("ensemble_ctrl.")))
        for here, module, _ in arrows()
        if module.startswith("ensemble_ctrl.")
    ]
    while todo:
        here = todo.pop()
        reached.add(here)
        todo.extend({target for room, target in edges if room == here} - reached)
    assert {name for name in reached if name.partition(".")[0] in ("ocp", "planning", "api")} == set()
    assert "constraints" in reached


def test_the_reader_of_imports_sees_nested_ones_and_not_those_for_types() -> None:
    source = """
import a.b, c
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    import hidden
else:
    import seen
def f():
    class G:
        from ensemble_ctrl import ocp
        from . import near
        from ..problem import Problem
        from .. import far
"""
    found = {module for module, _ in imports(source, "ensemble_ctrl.room")}
    assert found == {
        "a.b",
        "c",
        "typing",
        "seen",
        "ensemble_ctrl.ocp",
        "ensemble_ctrl.room",
        "ensemble_ctrl.problem",
        "ensemble_ctrl.far",
    }


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, ensemble_ctrl; print([m for m in ('matplotlib','scipy','casadi','yaml') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize("module", ["problem", "problem.evaluation.sampled", "moments", "systems", "constraints"])
def test_the_rooms_below_load_no_solver_and_no_plots(module: str) -> None:
    code = f"import sys, ensemble_ctrl.{module}; print([m for m in ('matplotlib', 'casadi') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_plain_run_loads_no_plots_and_no_polygons(tmp_path: Path) -> None:
    """Each takes as long as a tenth of the start."""
    code = (
        "import sys; from ensemble_ctrl.cli.app import invoke; assert invoke(sys.argv[1:]) == 0; "
        "heavy = 'matplotlib', 'shapely', 'scipy.optimize', 'numpy.ma'; "
        "print([m for m in heavy if m in sys.modules], file=sys.stderr)"
    )
    arguments = [str(CONFIGS / "one_obstacles.yaml"), "--no-plots", "-q", "-o", str(tmp_path / "plan")]
    run = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    assert run.stderr.strip() == "[]"


def writes(path: Path) -> Iterator[str]:
    """Calls by which a module writes a file by itself, with their places."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        modes = [arg.value for arg in [*node.args, *(k.value for k in node.keywords)] if isinstance(arg, ast.Constant)]
        opens = name == "open" and any(isinstance(mode, str) and re.fullmatch("[wxa][bt+]*", mode) for mode in modes)
        moves = ast.unparse(node.func) in ("os.replace", "os.rename", "shutil.move", "shutil.copyfile")
        if opens or moves or (isinstance(node.func, ast.Attribute) and name in ("write_text", "write_bytes")):
            yield f"{path.relative_to(ROOT)}:{node.lineno}"


def test_files_are_written_in_one_place() -> None:
    """The results folder is moved; a solver's log grows in a folder that is hidden, or in the user's own."""
    allowed = {"core.storage", "files.folder", "ocp"}
    found = [place for path in FILES if room_of(path) not in allowed for place in writes(path)]
    assert [place for place in found if not place.startswith("cli/streams.py")] == []
    assert any(writes(ROOT / "core" / "storage" / "writing.py"))
