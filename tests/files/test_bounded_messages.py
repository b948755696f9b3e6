"""Messages stay short and cheap, however much is wrong."""

from __future__ import annotations

import difflib
from dataclasses import replace
from unittest.mock import Mock

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import check
from ensemble_ctrl.files.config import tree

HEAD = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}
horizon: {duration: 4 s, steps: 8}
regions: {goal: {box: [[1, 2], [1, 2]]}}
"""
LONG = "a" * 900


def refused(text: str) -> ec.ConfigError:
    with pytest.raises(ec.ConfigError) as caught:
        ec.load_text(HEAD + text)
    return caught.value


@pytest.mark.parametrize(
    "text",
    [
        f"task: in({LONG})",
        f"task: F avoid({LONG})",
        f"task: {LONG} >= 1",
        f"task: x >= 1 {LONG}",
        f"task: F in(goal)\n{LONG}: 1",
        f"task: F in(goal)\nsolve: {{method: {LONG}}}",
        f"task: F in(goal)\nobjective: {{earliest: {LONG}}}",
        f"task: F in(goal)\nobstacles: {{o: {{box: [[0, 1 {LONG}], [1, 2]]}}}}",
        f"task: F in(goal)\nobstacles: {{o: {{file: {LONG}.wkt}}}}",
        f"task: F in(goal)\nregions: {{goal: {{box: [[1, 2], [1, 2]]}}, {LONG}: {{box: [[1, 2], [1, 2], 3]}}}}",
    ],
)
def test_a_long_name_is_cut(text: str) -> None:
    error = refused(text)
    assert "a" * 61 not in "".join(f"{item.path} {item.message} {item.hint}" for item in error.diagnostics)
    assert len(str(error)) < 800


def test_a_long_list_ends_with_its_number() -> None:
    error = refused("task: F in(goal)\n" + "\n".join(f"k{i}: 1" for i in range(500)))
    assert len(error.diagnostics) == 500
    assert str(error).count("unknown field") == 20
    assert str(error).endswith("\nand 480 more\n500 errors in <text>")


def test_guesses_and_places_are_made_for_the_first_names_only(monkeypatch: pytest.MonkeyPatch) -> None:
    guesses = Mock(side_effect=difflib.get_close_matches)
    searches = Mock(side_effect=tree.indices)
    monkeypatch.setattr(check, "get_close_matches", guesses)
    monkeypatch.setattr("ensemble_ctrl.files.config.locate.indices", searches)
    error = refused("task: " + " and ".join(f"in(gaol{i})" for i in range(300)))
    assert len(error.diagnostics) == 300
    assert [item.column for item in error.diagnostics[:3]] == [10, 24, 38]
    assert (guesses.call_count, searches.call_count) == (20, 1)
    assert "did you mean 'goal'" in str(error)


def test_a_problem_made_in_python_is_refused_as_shortly() -> None:
    problem = ec.load_text(HEAD + "task: F in(goal)")
    with pytest.raises(ec.ProblemError) as caught:
        replace(problem, task=ec.parse(" and ".join(f"in(b{i})" for i in range(100))))
    assert len(caught.value.findings) == 100
    assert str(caught.value).endswith("\nand 80 more")
