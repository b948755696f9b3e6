"""Which obstacles the task avoids, and when: throughout, for a while, or never."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import TYPE_CHECKING

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    Inside,
    Known,
    Not,
    Predicate,
    Release,
    Until,
    Within,
    leaves,
    negation_normal_form,
    resolve,
)
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.checks.task import mentioned

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem

Window = tuple[float, float]


@dataclass(frozen=True)
class Coverage:
    """When an obstacle is avoided for sure.

    Attributes
    ----------
    windows : tuple of (float, float)
        Seconds, apart from each other and in order.
    gaps : tuple of (float, float)
        The rest of the horizon.
    otherwise : bool
        Whether an until, an implication or a share refers to it: the plan then decides when it is avoided.
    """

    windows: tuple[Window, ...]
    gaps: tuple[Window, ...]
    otherwise: bool


def coverage(problem: Problem) -> dict[str, Coverage]:
    """When each obstacle is avoided, by its name."""
    try:
        task = negation_normal_form(resolve(problem.task, problem.duration))
    except ProblemError:  # a window that runs backwards has a finding of its own
        return {}
    # windows in which the task surely avoids something, and names below other operators
    given, others = _always(task, (0.0, 0.0), problem.duration), set(_others(task))
    found: dict[str, list[Window]] = {name: [] for name in problem.obstacles}
    for name, window in given:
        for each in found if name == ALL_OBSTACLES else [name]:
            found.get(each, []).append(window)
    answer = {}
    for name, windows in found.items():
        joined = tuple(_joined(windows))
        gaps = tuple(_gaps(joined, problem.duration))
        answer[name] = Coverage(joined, gaps, name in others or ALL_OBSTACLES in others)
    return answer


def _always(formula: Formula, now: Window, duration: float) -> Iterator[tuple[str, Window]]:
    """Names with windows in which they are avoided, where a formula holds at all times `now`."""
    match formula:
        case Avoid(name=name):
            yield name, now
        case And():
            for part in formula.parts:
                yield from _always(part, now, duration)
        case Always(child=child, a=a, b=b):
            # G[a,b] at all times of [c, d] holds its operand at all times of [c + a, d + b]
            end = duration if b is None else now[1] + b
            yield from _always(child, (now[0] + (a or 0.0), end), duration)


def _others(formula: Formula) -> Iterator[str]:
    """Names below an operator that is no conjunction, always or eventually."""
    if isinstance(formula, And | Always | Eventually):
        for part in formula.parts:
            yield from _others(part)
    elif formula.parts:
        yield from (leaf.name for leaf in leaves(formula) if isinstance(leaf, Avoid))


def _joined(windows: Iterable[Window]) -> Iterator[Window]:
    """Windows that overlap or touch as one."""
    here: Window | None = None
    for begin, end in sorted(windows):
        if here is not None and begin <= here[1] + SLACK:
            here = here[0], max(here[1], end)
        else:
            if here is not None:
                yield here
            here = begin, end
    if here is not None:
        yield here


def _gaps(windows: tuple[Window, ...], duration: float) -> Iterator[Window]:
    """The parts of the horizon between some windows."""
    at = 0.0
    for begin, end in windows:
        if begin > at + SLACK:
            yield at, begin
        at = end
    if at < duration - SLACK:
        yield at, duration


def coverage_findings(problem: Problem) -> Iterator[Finding]:
    """Obstacles that are avoided for a part of the horizon only, and parts of the task about its start only."""
    same: dict[str, list[str]] = {}
    _, avoided = mentioned(problem)
    for name, found in coverage(problem).items():
        spoken = name in avoided or ALL_OBSTACLES in avoided  # else there is a warning of that already
        if found.gaps and spoken and not found.otherwise and name not in problem.ignore:
            same.setdefault(_when_not(found), []).append(name)
    for name in problem.ignore:
        if name not in problem.obstacles:
            yield Finding(("ignore",), f"there is no obstacle {name!r}", _similar(name, problem), "warning")
    for when, names in same.items():
        path = ("obstacles", names[0]) if len(names) == 1 else ("obstacles",)
        verb = "is" if len(names) == 1 else "are"
        hint = f"add `G avoid(..)` without a window, or list {'it' if len(names) == 1 else 'them'} under `ignore`"
        yield Finding(path, f"{listed(names)} {verb} {when}", hint, "warning", on_key=True)
    for leaf in _at_start(problem.task):
        text = str(leaf) if len(str(leaf)) <= 40 else f"{str(leaf)[:39]}…"
        message = f"{text} holds at t = 0 only, as it is outside of every temporal operator"
        column = getattr(leaf, "column", 0)
        yield Finding(("task",), message, f"`G {text}` or `F {text}`?", "warning", column - 1 if column else None)


def _similar(name: str, problem: Problem) -> str:
    """The obstacle that may be meant."""
    close = get_close_matches(name, list(problem.obstacles), n=1)
    return f"did you mean {close[0]!r}?" if close else ""


def _when_not(found: Coverage) -> str:
    """When an obstacle is not avoided, in words."""
    if not found.windows:
        return "avoided at some time only, which the plan chooses"
    if all(begin == end for begin, end in found.windows):
        return f"avoided at {' and '.join(f't = {begin:g} s' for begin, _ in found.windows)} only"
    return f"not avoided {_spans(found.gaps)}"


def _spans(windows: Iterable[Window]) -> str:
    """Windows in words."""
    return " and ".join(f"{begin:g}..{end:g} s" if end > begin else f"at t = {begin:g} s" for begin, end in windows)


def _at_start(formula: Formula) -> Iterator[Formula]:
    """The leaves that no temporal operator is around."""
    if isinstance(formula, Always | Eventually | Until | Release | Known):
        return
    if isinstance(formula, Inside | Avoid | Predicate | Within) or (
        isinstance(formula, Not) and isinstance(formula.child, Inside | Avoid | Predicate | Within)
    ):
        yield formula
        return
    for part in formula.parts:
        yield from _at_start(part)


def coverage_text(problem: Problem) -> str:
    """One line: which obstacles are avoided throughout, which for a while, and which never."""
    groups: dict[str, list[str]] = {}
    for name, found in coverage(problem).items():
        if not found.gaps:
            kind = "throughout"
        elif found.otherwise:
            kind = "as the task says"
        elif found.windows:
            kind = f"only {_spans(found.windows)}"
        else:
            kind = "never"
        groups.setdefault(kind, []).append(name)
    first, last = [k for k in ("throughout",) if k in groups], [k for k in ("never",) if k in groups]
    order = [*first, *(k for k in groups if k not in ("throughout", "never")), *last]
    text = "; ".join(f"{kind}: {listed(groups[kind])}" for kind in order)
    return f"avoided {text}" if first or not groups or order[0] != "never" else f"avoided throughout: none; {text}"


def listed(names: list[str], most: int = 12) -> str:
    """Names in their order; numbered ones that follow each other as a range, and of very many the first.

    Examples
    --------
    >>> listed(["o1", "o2", "o3", "post", "wall"])
    'o1..o3, post, wall'
    """
    runs: list[list[str]] = []
    for name in names:
        if runs and _follows(runs[-1][-1], name):
            runs[-1].append(name)
        else:
            runs.append([name])
    texts = [t for run in runs for t in ([f"{run[0]}..{run[-1]}"] if len(run) > 2 else run)]
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def _follows(one: str, other: str) -> bool:
    """Whether two names differ by their number at the end, and that by one."""
    a, b = (re.fullmatch(r"(.*?)([1-9]\d{0,8}|0)", name, re.DOTALL) for name in (one, other))
    return a is not None and b is not None and a[1] == b[1] and int(b[2]) == int(a[2]) + 1
