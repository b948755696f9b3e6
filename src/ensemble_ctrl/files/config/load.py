"""Load a problem file: every step, and every error at once."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any, NoReturn

from pydantic import ValidationError

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.core.values import expect, shown
from ensemble_ctrl.files.config.axes import Axis
from ensemble_ctrl.files.config.build import build
from ensemble_ctrl.files.config.dump import to_data
from ensemble_ctrl.files.config.errors import FieldError, show
from ensemble_ctrl.files.config.locate import Locator
from ensemble_ctrl.files.config.mapped import edge_findings, map_notes
from ensemble_ctrl.files.config.messages import Diagnostic, findings_of, layout
from ensemble_ctrl.files.config.overrides import Given, Override, apply, name_of_override, parse_override
from ensemble_ctrl.files.config.renamed_keys import renamed_keys, renamed_overrides
from ensemble_ctrl.files.config.schema import ProblemFile
from ensemble_ctrl.files.config.source import Source, Text, name_of, read_source
from ensemble_ctrl.files.config.tree import TextError, Tree
from ensemble_ctrl.files.config.user_system import CONSENT, by_ode, system_class
from ensemble_ctrl.planning.online.findings import loop_findings
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import Finding, findings, path_text


@dataclass(frozen=True, eq=False)
class Loaded:
    """A problem with the remarks on its file.

    Attributes
    ----------
    problem : Problem
    warnings : tuple of Diagnostic
        In file order; each prints as a warning with line and caret.
    text : str
        The file's text, as it was read.
    axes : tuple of Axis
        What its section ``sweep`` has.
    """

    problem: Problem
    warnings: tuple[Diagnostic, ...]
    text: str
    axes: tuple[Axis, ...] = ()

    @property
    def data(self) -> dict[str, Any]:
        """The problem as plain data, with every default and override filled in."""
        return to_data(self.problem)


def load(source: Source, overrides: Iterable[Given] = (), *, trust: bool = False) -> Problem:
    """Read a problem file.

    Parameters
    ----------
    source : path, "-" or open file
        ``-`` is stdin.
    overrides : iterable of str
        ``KEY=VALUE`` with a dotted key and a YAML value, applied in order before validation.
    trust : bool
        Whether to run the Python file that ``fleet.model`` may name; it has to lie next to the problem file.

    Returns
    -------
    Problem

    Raises
    ------
    ConfigError
        With every error in file order, each with line, column and a hint.
    """
    return read(source, overrides, trust=trust).problem


def load_text(text: str, name: str = "<text>", overrides: Iterable[Given] = (), *, trust: bool = False) -> Problem:
    """Read a problem from a text, with files next to the file called `name`; see `load`.

    Examples
    --------
    >>> problem = load_text('''
    ... fleet: {model: unicycle, start: {position: [0, 0], heading: 45 deg}}
    ... horizon: {duration: 4 s}
    ... task: F[0, T] x >= 1
    ... ''')
    >>> problem.steps, round(problem.fleet.heading, 4)
    (40, 0.7854)
    """
    return read_text(text, name, overrides, trust=trust).problem


def read(source: Source, overrides: Iterable[Given] = (), *, trust: bool = False, loop: bool = False) -> Loaded:
    """Read a problem file, and keep its warnings and its text; see `load`.

    With `loop`, as with a section ``online``, what is not for a loop is an error too.
    """
    return parsed(text_from(source), overrides, trust, loop)


def text_from(source: Source) -> Text:
    """The text of a source.

    Raises
    ------
    ConfigError
        If it can't be read.
    """
    try:
        return read_source(source)
    except TextError as error:
        _refuse([_unplaced(error, name_of(source))], name_of(source))


def read_text(text: str, name: str = "<text>", overrides: Iterable[Given] = (), *, trust: bool = False) -> Loaded:
    """Read a problem from a text, and keep its warnings; see `load`."""
    expect("text", text, str, "text")
    return parsed(Text(name, text, FilePath(name).parent if trust or CONSENT.get() else FilePath()), overrides, trust)


def parsed(text: Text, overrides: Iterable[Given], trust: bool = False, loop: bool = False) -> Loaded:
    """A text, read by all steps; see `read`."""
    if isinstance(overrides, bytes) or not isinstance(overrides, Iterable):
        raise ProblemError(f"overrides: expected texts KEY=VALUE, got {shown(overrides)}")
    tree = _tree(text)
    changes = _overrides([overrides] if isinstance(overrides, str) else overrides, text.name)
    changes, old_names = renamed_overrides(changes)
    old_names += renamed_keys(tree)
    data = _changed(tree.data, changes, text.name)
    locate = Locator(text, tree, data, changes)
    if not isinstance(data, dict):
        _refuse(
            [locate(Finding((), f"expected a problem with fleet, horizon and task, got {show(data)}"))],
            text.name,
        )
    problem, notes, axes = _problem(text, data, locate, trust)
    if loop or problem.online is not None:
        wrong = [locate(finding) for finding in loop_findings(problem)]
        if wrong:
            _refuse(sorted(wrong, key=locate.order), text.name)
    warnings = [*notes, *(locate(finding) for finding in [*old_names, *findings(problem)])]
    return Loaded(problem, tuple(sorted(warnings, key=locate.order)), text.content, axes)


def _problem(
    text: Text, data: dict[str, Any], locate: Locator, trust: bool
) -> tuple[Problem, list[Diagnostic], tuple[Axis, ...]]:
    """Validate and build, collecting every error, the remarks on its maps, and the axes of a sweep."""
    found = locate.repeated()
    context: dict[str, Any] = {"folder": text.folder, "trust": trust}
    if by_ode(data):
        try:
            context["places"] = system_class(data["fleet"]["model"], context).positions
        except FieldError as error:  # nothing else can be read without it
            path = ("fleet", "model", *error.path)
            _refuse([*found, locate(Finding(path, error.message, error.hint))], text.name)
    notes: list[Diagnostic] = []
    try:
        file = ProblemFile.model_validate(data, context=context)
        notes = [locate(finding) for finding in map_notes(file)]
        problem = build(file, re.sub(r"[^\w .+-]", "", FilePath(text.name).stem) or "problem")
        found += [locate(finding) for finding in edge_findings(file, problem)]
    except ValidationError as error:
        found += [locate(finding) for finding in findings_of(error)]
    except ProblemError as error:
        found += [locate(finding) for finding in error.findings or [Finding((), str(error))]]
    if found:
        _refuse(sorted([*found, *notes], key=locate.order), text.name)
    return problem, notes, file.sweep


def _tree(text: Text) -> Tree:
    """The text as data with places."""
    try:
        tree = Tree.read(text.content)
    except TextError as error:
        _refuse([_unplaced(error, text.name, text.content)], text.name)
    if tree.data is None:
        hint = "start from one of `ensemble-plan examples`"
        _refuse([Diagnostic(text.name, None, None, "error", "", "this file is empty", hint)], text.name)
    return tree


def _overrides(texts: Iterable[Given], name: str) -> list[Override]:
    """Every override, read."""
    read, wrong = [], []
    for text in texts:
        try:
            read.append(parse_override(text))
        except TextError as error:
            wrong.append(Diagnostic(name_of_override(text), None, None, "error", "", error.message, error.hint))
    if wrong:
        _refuse(wrong, name)
    return read


def _changed(data: Any, changes: Iterable[Override], name: str) -> Any:
    """The data with the overrides in it."""
    for change in changes:
        try:
            data = apply(data, [change])
        except TextError as error:
            path = path_text(change.path)
            _refuse([Diagnostic(change.name, None, None, "error", path, error.message, error.hint)], name)
    return data


def _unplaced(error: TextError, name: str, content: str = "") -> Diagnostic:
    """A text that can't be read, as a diagnostic."""
    if error.place is None:
        return Diagnostic(name, None, None, "error", "", error.message, error.hint)
    lines = content.split("\n")
    excerpt = lines[error.place.line - 1] if error.place.line <= len(lines) else ""
    return Diagnostic(name, error.place.line, error.place.column, "error", "", error.message, error.hint, excerpt)


def _refuse(errors: list[Diagnostic], name: str) -> NoReturn:
    """Raise all errors as one."""
    raise ConfigError(layout(errors, name), tuple(errors))
