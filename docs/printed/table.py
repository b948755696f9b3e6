"""A block of figures on a page: what decides it, what makes its rows, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ensemble_ctrl as ec
from printed import LEFT_OUT, ROOT, source

Row = dict[str, Any]
Rows = list[Row]
CONFIGS = ROOT / "configs"
FIVE = "five_obstacles"


@dataclass(frozen=True)
class Table:
    """Figures that a run of the planner decides; they repeat on the same machine.

    Attributes
    ----------
    page : str
        Where the block stands.
    problems : tuple of str
        Problems of `configs/` that decide the figures.
    run : callable
        Makes the rows from these names.
    lines : callable
        Writes the rows.
    left_out : tuple of str
        Packages of the code that do not decide them.
    """

    page: str
    problems: tuple[str, ...]
    run: Callable[[tuple[str, ...]], Rows]
    lines: Callable[[Rows], Iterator[str]]
    left_out: tuple[str, ...] = LEFT_OUT

    def source(self) -> str:
        """Digest of the code and the problems."""
        return " ".join(source(config(name), self.left_out) for name in self.problems)


@dataclass(frozen=True)
class Timed:
    """Figures that depend on the machine: a benchmark writes their file, and only the page is made from it.

    Attributes
    ----------
    page : str
        Where the block stands.
    file : str
        Name in ``benchmarks/measured``.
    lines : callable
        Writes the rows, given the statement of the machine.
    """

    page: str
    file: str
    lines: Callable[[Rows, str], Iterator[str]]

    @property
    def path(self) -> Path:
        """The benchmark's file."""
        return ROOT / "benchmarks" / "measured" / f"{self.file}.json"


def config(name: str) -> Path:
    """A problem file of `configs/`."""
    return CONFIGS / f"{name}.yaml"


def load(name: str, overrides: Iterable[str] = ()) -> ec.Problem:
    """A problem of `configs/`, or one made from it."""
    problem = ec.load(config(name), list(overrides))
    assert isinstance(problem, ec.Problem)
    return problem


def proven_plan(problem: ec.Problem) -> ec.Plan:
    """A plan with a certificate that says *yes*."""
    plan = ec.plan(problem)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    return plan


def header(*names: str) -> Iterator[str]:
    """The first two lines of a table."""
    yield f"| {' | '.join(names)} |"
    yield "|" + "---|" * len(names)


def metres(value: float) -> str:
    """A length in the unit that suits it, to two digits."""
    if value >= 0.995:
        return f"{value:.1f} m"
    return f"{_two_digits(1e2 * value)} cm" if value >= 0.00995 else f"{_two_digits(1e3 * value)} mm"


def _two_digits(value: float) -> str:
    """Two digits without a power of ten, at least one tenth."""
    return f"{value:.1f}" if value < 9.95 else f"{value:.0f}"


def power(value: float, digits: int = 2) -> str:
    """So many digits, and the power of ten without its zero."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def plain(value: float, digits: int = 2) -> str:
    """So many digits; without a power of ten where that is short."""
    if not 0.01 <= abs(value) < 10**digits:
        return power(value, digits)
    return f"{value:.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"
