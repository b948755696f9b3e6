"""The code that a proof rests on is named in one place, imports nothing else, and stays small."""

from __future__ import annotations

import io
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

import ensemble_ctrl
from ensemble_ctrl.certificate import GENERAL, HANDED, TRUSTED
from tests.paths import ROOT as REPOSITORY
from tests.test_architecture import imports

ROOT = Path(ensemble_ctrl.__file__).parents[1]
LINES = 4_260
"""Lines of code that have to be right: neither blank, nor comments, nor docstrings."""
OF_PROOF = 2_125
"""Those of them in `ensemble_ctrl.certificate`."""
OF_GENERAL = 1_650
"""Lines of code that have to be right in addition, for systems that are not robots on arcs."""
UNPROVEN = "ensemble_ctrl.certificate.general.picard"
"""Polynomials near the true states, of which nothing is assumed: how far they are is proven afterwards."""
ELSEWHERE = {
    ("certificate.general.basis", "scipy"): "sums over sparse tables",
    ("constraints._sides", "scipy"): "rows of a program on moments",
    ("constraints.cover", "shapely"): "cutting what is not convex, when a map is read",
    ("constraints.polygon", "shapely"): "the same",
    ("constraints.solid", "scipy"): "solids, of which no proof is known",
    ("core.errors", "IPython"): "messages in a notebook",
}
"""Modules that load a library within a function, and for what: no certificate calls these."""


def source(module: str) -> str:
    """The text of a module."""
    return (ROOT / Path(*module.split("."))).with_suffix(".py").read_text(encoding="utf-8")


def run_time_imports(module: str) -> Iterator[str]:
    """Modules that a module imports; where it takes a module from a package, that."""
    package = module.rpartition(".")[0]
    text = source(module)
    for name, line in imports(text, package):
        taken = text.splitlines()[line - 1].partition(" import ")[2].split(",")
        within = [f"{name}.{part.strip()}" for part in taken if f"{name}.{part.strip()}" in TRUSTED]
        yield from within or [name]


def lines_of_code(text: str) -> int:
    """Lines with code on them."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    lines: set[int] = set()
    begins = True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        docstring = token.type == tokenize.STRING and begins
        if token.type not in skipped and not docstring:
            lines.update(range(token.start[0], token.end[0] + 1))
        if token.type != tokenize.COMMENT and token.type != tokenize.NL:
            begins = token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    return len(lines)


def test_what_is_trusted_imports_nothing_else() -> None:
    wrong = []
    for module in (*TRUSTED, *GENERAL):
        for name in run_time_imports(module):
            library = name.split(".")[0]
            allowed = library in sys.stdlib_module_names or library == "numpy" or name in (*TRUSTED, *GENERAL, UNPROVEN)
            if not allowed and (module.removeprefix("ensemble_ctrl."), library) not in ELSEWHERE:
                wrong.append(f"{module} imports {name}")
    assert wrong == []


def test_nothing_is_named_that_is_not_needed() -> None:
    reached, todo = set(), ["ensemble_ctrl.certificate.certify"]
    while todo:
        module = todo.pop()
        reached.add(module)
        todo.extend({name for name in run_time_imports(module) if name in (*TRUSTED, *GENERAL)} - reached)
    assert reached == {*TRUSTED, *GENERAL}
    assert not set(TRUSTED) & set(HANDED)
    assert all(source(module) for module in HANDED)


def test_it_stays_small() -> None:
    counts = {module: lines_of_code(source(module)) for module in TRUSTED}
    proof = sum(count for module, count in counts.items() if ".certificate." in module)
    assert sum(counts.values()) <= LINES, counts
    assert proof <= OF_PROOF, counts
    assert sum(lines_of_code(source(module)) for module in GENERAL) <= OF_GENERAL


def test_the_page_names_these_bounds() -> None:
    page = (REPOSITORY / "docs" / "proof_limits.md").read_text(encoding="utf-8").replace("\n", " ")
    claimed = "at most {:,}, of which at most {:,} are the proof, and at most {:,} more for `GENERAL`"
    assert claimed.format(LINES, OF_PROOF, OF_GENERAL) in page


def test_lines_are_counted_without_words() -> None:
    text = '''"""Words,

and more."""

x = 1  # one
# none
y = """two
lines"""

def f():
    """Words."""
    return [
        x,
    ]
'''
    assert lines_of_code(text) == 7
