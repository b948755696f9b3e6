"""Mutation of the proof: faults put into the trusted base one at a time, each of which the campaign has to find.

``python -m tests.campaign.mutate`` turns round every inequality, swaps every minimum and maximum, drops every term,
every sign and every factor that rounds up, and swaps beginnings with ends; each in a copy of the sources. A mutant is
*killed* if a claim about a case is false, if it crashes or hangs, or if too much is left open that brute force decides.
Mutants are found in the syntax tree, so that they follow the code. Those that survive are listed with a reason, and a
reason for a mutant that isn't there any more is an error.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.util
import json
import multiprocessing
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import zip_longest
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .survivors import reason_of, stale
from .table import KINDS, printed


def _sources() -> Path:
    """The package's folder, without an import of it."""
    found = importlib.util.find_spec("ensemble_ctrl")
    if found is None or found.origin is None:
        raise ImportError("ensemble_ctrl")
    return Path(found.origin).parent


SOURCES = _sources()
SWAPPED = {
    "min": "max",
    "minimum": "maximum",
    "argmin": "argmax",
    "floor": "ceil",
    "any": "all",
    "begin": "end",
    "lower": "upper",
    "low": "high",
    "left": "right",
    "here": "there",
    "first": "last",
    "early": "late",
    "earliest": "latest",
    "upwards": "downwards",
    "And": "Or",
    "Always": "Eventually",
    "Until": "Release",
    "innermost": "outermost",
}
"""Names of functions, attributes and variables that are exchanged, either way."""
SWAPPED |= {there: here for here, there in SWAPPED.items()}
FLIPPED: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
FACTORS = ("UP", "UNIT", "1 + ")
"""What a factor that rounds up looks like."""


WARM = ("numpy", "scipy.stats", "scipy.special", "scipy.optimize", "shapely", "casadi", "yaml", "jsonschema")
"""What a process is started with; nothing of the package."""
SHARP = ("tight", "bulging", "touching")
"""Families in which bounds meet the truth but for roundings."""
FAMILIES_FOR: dict[str, tuple[str, ...]] = {
    "certificate/enclosure.py": (
        *SHARP,
        "spinning",
        "windows",
        "cars",
        "turning",
        "starts",
        *SHARP,
        "far",
        "ranged",
        "scaled",
    ),
    "certificate/clearance.py": (
        *SHARP,
        "windows",
        "plain",
        "starts",
        "moving",
        "huge",
        "returning",
        "overtaken",
        "huge",
        "turning",
        "far",
        "huge",
        *SHARP,
    ),
    "certificate/boxes.py": ("plain", "far", "starts", "moving", "turning", *SHARP),
    "certificate/task.py": (*SHARP, "nested", "windows", "means", "shares", "turning", "plain", "starts"),
    "certificate/signals.py": (*SHARP, "nested", "windows", "means", "shares", "turning", "plain", "starts"),
    "certificate/masses.py": ("shares", "means"),
    "certificate/bound.py": ("pieces", "plain", "moving", *SHARP),
    "certificate/instants.py": ("windows", "nested", "plain", "moving"),
    "certificate/schedule.py": ("windows", "nested", "plain", "moving"),
    "certificate/share.py": ("shares", "reweighed"),
    "certificate/certify.py": ("plain", "windows", "shares", "together", "cornered", "nested", "means", "starts"),
    "constraints/obstacle.py": ("far", "plain", "skewed", "scaled", "starts", "moving", *SHARP),
    "constraints/exact.py": ("far", "plain", "scaled", *SHARP),
    "constraints/polygon.py": ("plain", "far", "nested", "scaled"),
    "constraints/stl/leaves.py": ("nested", "plain", "means"),
    "constraints/stl/rewrite.py": ("nested", "plain", "starts", "shares", "means"),
    "constraints/stl/implied.py": ("implied", "plain", "windows", "shares"),
    "constraints/polyhedron.py": ("windows", "plain", "far", "nested", "scaled"),
    "constraints/motion.py": ("moving", "overtaken"),
    "problem/specification.py": ("windows", "plain", "shares", "moving"),
    "certificate/disturbance.py": ("drifting", "drifting", "uncertain"),
    "certificate/terrain.py": ("terrain", "drifting", "terrain"),
    "certificate/commands.py": ("signals", "drifting", "zones"),
    "certificate/bodies.py": ("bodies",),
    "certificate/apart.py": ("apart",),
    "certificate/starts.py": ("apart",),
    "constraints/disc.py": ("discs", "bodies"),
    "problem/zones.py": ("zones",),
}
"""The modules that prove, with the families of cases that each is tried with. Those that only read and print (tokens,
texts, maps) are left to their own tests."""


@dataclass(frozen=True)
class Mutant:
    """One fault.

    Attributes
    ----------
    module : str
        The file, from the package's folder.
    function : str
        The function with its class.
    what : str
        The expression before and after; with a number where it stands in the function more than once.
    tree : ast.Module
        The module.
    place, changed : ast.expr
        The expression in it, and what stands there instead.
    """

    module: str
    function: str
    what: str
    tree: ast.Module
    place: ast.expr
    changed: ast.expr

    @property
    def name(self) -> str:
        """What tells it from all others."""
        return f"{self.module}:{self.function}: {self.what}"

    @property
    def source(self) -> str:
        """The text of the whole module with the fault."""
        return _replaced(self.tree, self.place, self.changed)


def mutants(module: str) -> Iterator[Mutant]:
    """Every mutant of a module."""
    tree = ast.parse((SOURCES / module).read_text())
    seen: dict[tuple[str, str], int] = {}
    for function, node in _functions(tree):
        names = {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
        names |= {part.arg for part in ast.walk(node) if isinstance(part, ast.arg)}
        for place in _expressions(node):
            for changed in _changed(place, names):
                what = f"{ast.unparse(place)} -> {ast.unparse(changed)}"
                count = seen[function, what] = seen.get((function, what), 0) + 1
                label = what if count == 1 else f"{what} #{count}"
                yield Mutant(module, function, label, tree, place, changed)


def _functions(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Functions and methods with their names."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from ((f"{node.name}.{part.name}", part) for part in node.body if isinstance(part, ast.FunctionDef))


def _expressions(function: ast.AST) -> Iterator[ast.expr]:
    """The expressions that a function evaluates; no patterns, annotations, decorators or default values."""
    assert isinstance(function, ast.FunctionDef)
    todo: list[ast.AST] = list(reversed(function.body))
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Raise | ast.pattern):
            continue
        if isinstance(node, ast.expr):
            yield node
        parts = [node.value] if isinstance(node, ast.AnnAssign) else list(ast.iter_child_nodes(node))
        todo.extend(part for part in reversed(parts) if part is not None)


def _changed(node: ast.expr, names: set[str]) -> Iterator[ast.expr]:
    """The faults of one expression in a function with these names."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in FLIPPED:
            yield _with(node, ops=[FLIPPED[type(op)]()])
        case ast.Call(func=ast.Name(id=name)) if name in SWAPPED:
            yield _with(node, func=ast.Name(SWAPPED[name]))
        case ast.Call(func=ast.Attribute(value=value, attr=name)) if name in SWAPPED:
            yield _with(node, func=ast.Attribute(value, SWAPPED[name]))
        case ast.Attribute(value=value, attr=name, ctx=ast.Load()) if name in SWAPPED and name not in _METHODS:
            yield ast.Attribute(value, SWAPPED[name])
        case ast.Name(id=name, ctx=ast.Load()) if name in SWAPPED and name not in _METHODS and SWAPPED[name] in names:
            yield ast.Name(SWAPPED[name], ast.Load())
        case ast.Slice(lower=None, upper=ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=1)), step=None):
            yield ast.Slice(ast.Constant(1), None, None)
        case ast.Slice(lower=ast.Constant(value=1), upper=None, step=None):
            yield ast.Slice(None, ast.UnaryOp(ast.USub(), ast.Constant(1)), None)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right) if not isinstance(left, ast.List):
            yield left
            if isinstance(node.op, ast.Add) and not isinstance(left, ast.Constant):
                yield right
        case ast.BinOp(left=left, op=ast.Mult(), right=right) if ast.unparse(right).startswith(FACTORS):
            yield left
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield operand
        case ast.Constant(value="left" | "right" as side):
            yield ast.Constant(SWAPPED[side])


OPEN = ("huge",)
"""Families that are left open as they are."""
HOW = ("claim", "crash", "hangs", "left open", "survive")
"""How faults are found."""
MARK = "mutants"
"""Of the table on the page."""
_METHODS = (
    *("min", "max", "minimum", "maximum", "argmin", "argmax", "floor", "ceil", "any", "all"),
    *("And", "Or", "Always", "Eventually", "Until", "Release"),
)


def _with(node: ast.expr, **changes: object) -> ast.expr:
    """A copy with other fields."""
    twin = copy.copy(node)
    for name, value in changes.items():
        setattr(twin, name, value)
    return twin


def _replaced(tree: ast.Module, place: ast.expr, changed: ast.expr) -> str:
    """The module's text with one expression exchanged."""

    class Exchange(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> ast.AST:
            return changed if node is place else self.generic_visit(_copied(node))

    return ast.unparse(ast.fix_missing_locations(Exchange().visit(tree)))


def _copied(node: ast.AST) -> ast.AST:
    """A copy whose lists are copies too, so that the tree itself stays as it is."""
    twin = copy.copy(node)
    for name, value in ast.iter_fields(node):
        if isinstance(value, list):
            setattr(twin, name, list(value))
    return twin


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant."""

    name: str
    killed: str
    cases: int
    seconds: float


def tried(mutant: Mutant, seed: int, families: tuple[str, ...], count: int, timeout: int) -> Outcome:
    """A mutant before the campaign's small set, in a process of its own."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "ensemble_ctrl"
        shutil.copytree(SOURCES, copied, ignore=shutil.ignore_patterns("__pycache__"))
        (copied / mutant.module).write_text(mutant.source)
        ours, theirs = multiprocessing.get_context("fork").Pipe()
        process = multiprocessing.get_context("fork").Process(
            target=_judge_all, args=(folder, timeout, seed, families, count, theirs)
        )
        process.start()
        theirs.close()
        try:
            killed, cases = ours.recv()
        except EOFError:
            killed, cases = "hangs", 0
        process.join()
    return Outcome(mutant.name, killed, cases, time.perf_counter() - began)


def _judge_all(folder: str, timeout: int, seed: int, families: tuple[str, ...], count: int, pipe: Connection) -> None:
    """Judge cases until a claim is false; tell which, or nothing. The process is ended when its time is used up."""
    resource.setrlimit(resource.RLIMIT_CPU, (timeout, timeout))
    sys.path.insert(0, folder)
    try:
        pipe.send(_verdict(seed, families, count))
    except Exception as error:
        pipe.send((f"crash: {error!r}", 0))


def _verdict(seed: int, families: tuple[str, ...], count: int) -> tuple[str, int]:
    """The first false claim, and the number of cases looked at."""
    import numpy as np

    from .cases import FAMILIES, of_family

    try:
        from .features.cases import of_family as later
        from .features.judge import judge as judge_later
        from .judge import judge
    except Exception as error:
        return f"import: {error!r}", 0
    decidable, left, refused = Counter[str](), Counter[str](), 0
    for index in range(count):
        family = families[index % len(families)]
        rng = np.random.default_rng([seed, index])
        judged: Any = judge(of_family(family, rng)) if family in FAMILIES else judge_later(later(family, rng), rng)
        if judged.faults:
            kind = getattr(judged.faults[0], "kind", None) or str(judged.faults[0]).partition(":")[0]
            return f"{kind}: {family} {seed}:{index}", index + 1
        decidable[family] += bool(judged.decided)
        left[family] += bool(judged.decided) and judged.verdict == "undecided"
        refused += judged.verdict == "refused"
        if index >= 40 and refused > 0.5 * index:
            return f"crash: {refused} of {index + 1} refused", index + 1
        if decidable[family] >= 15 and left[family] > 0.2 * decidable[family] and family not in OPEN:
            return f"left open: {left[family]} of {decidable[family]} {family}", index + 1
        if decidable.total() >= 60 and left.total() > 0.25 * decidable.total():
            return f"left open: {left.total()} of {decidable.total()}", index + 1
    return "", count


def families_for(mutant: Mutant) -> tuple[str, ...]:
    """The cases that a mutant is tried with."""
    return FAMILIES_FOR[mutant.module]


def every_mutant() -> list[Mutant]:
    """All mutants of the trusted base."""
    return [mutant for module in FAMILIES_FOR for mutant in mutants(module)]


def spread(chosen: list[Mutant], each: int) -> list[Mutant]:
    """So many of each module that no reason excuses, evenly over its lines, in turn; all of them for 0."""
    if not each:
        return chosen
    by_module: dict[str, list[Mutant]] = {}
    for mutant in chosen:
        if not reason_of(mutant.name):
            by_module.setdefault(mutant.module, []).append(mutant)
    taken = [some[:: -(-len(some) // each)] for some in by_module.values()]
    return [mutant for row in zip_longest(*taken) for mutant in row if mutant is not None]


def main() -> int:
    """The command; its exit code is 1 if a mutant survives without a reason, or a reason is of no mutant."""
    parser = argparse.ArgumentParser(description="Put faults into the proof, and see the campaign find them.")
    parser.add_argument("--only", default="", help="mutants with this in their names")
    parser.add_argument("--each", type=int, default=0, help="so many of each module, evenly; 0 for all")
    parser.add_argument("--list", action="store_true", help="print the mutants and end")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--cases", type=int, default=480, help="cases for each mutant at most")
    parser.add_argument("--timeout", type=int, default=120, help="seconds of processor time for each mutant")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, help="a JSON file of outcomes; those that are in it are not tried again")
    parser.add_argument("--page", type=Path, help="a page of the documentation whose table is written anew")
    args = parser.parse_args()
    chosen = spread([mutant for mutant in every_mutant() if args.only in mutant.name], args.each)
    if args.list:
        print(*(mutant.name for mutant in chosen), sep="\n")
        return 0
    done = json.loads(args.out.read_text()) if args.out and args.out.exists() else {}
    todo = [mutant for mutant in chosen if mutant.name not in done]
    for name in WARM:
        importlib.import_module(name)
    with ThreadPoolExecutor(args.jobs) as pool:
        waiting = [pool.submit(tried, m, args.seed, families_for(m), args.cases, args.timeout) for m in todo]
        for future in as_completed(waiting):
            outcome = future.result()
            done[outcome.name] = outcome.killed
            print(f"{outcome.killed or 'SURVIVES'} ({outcome.cases}, {outcome.seconds:.0f} s): {outcome.name}")
            if args.out:
                args.out.write_text(json.dumps(done, indent=1) + "\n")
    if args.page:
        args.page.write_text(printed(args.page.read_text(), as_markdown(done), MARK))
    return told({mutant.name: done[mutant.name] for mutant in chosen})


def as_markdown(found: dict[str, str]) -> str:
    """What became of mutants, for a page of the documentation."""
    head = ("module", "faults tried", "a false claim", "a crash", "for ever", "left open", "survive")
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    rows: dict[str, Counter[str]] = {}
    for name, killed in found.items():
        rows.setdefault(name.partition(":")[0], Counter())[_how(killed)] += 1
    for module, row in (*sorted(rows.items()), ("**all**", sum(rows.values(), Counter[str]()))):
        counts = [row.total(), *(row[how] for how in HOW)]
        lines.append("| " + " | ".join(map(str, [module, *counts])) + " |")
    alive = [f"- `{name}`: {reason_of(name)}." for name, killed in sorted(found.items()) if not killed]
    return "\n".join(lines) + ("\n\nThose that survive:\n\n" + "\n".join(alive) if alive else "")


def _how(killed: str) -> str:
    """How a mutant was found."""
    kind = killed.partition(":")[0]
    return {"": "survive", "hangs": kind, "left open": kind}.get(kind, "crash" if kind not in KINDS[:-1] else "claim")


def told(found: dict[str, str]) -> int:
    """Print what became of mutants, and what is wrong with that as an exit code."""
    alive = [name for name, killed in found.items() if not killed]
    unexplained = [name for name in alive if not reason_of(name)]
    killed = len(found) - len(alive)
    print(f"{len(found)} mutants: {killed} killed, {len(alive)} survive, {len(unexplained)} of them without a reason")
    print(*(f"  {reason_of(name) or 'NO REASON'}: {name}" for name in alive), sep="\n")
    old = stale([mutant.name for mutant in every_mutant()])
    print(*(f"a reason for no mutant: {begin}" for begin in old), sep="\n")
    return int(bool(unexplained or old))


if __name__ == "__main__":
    sys.exit(main())
