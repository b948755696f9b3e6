"""Axes of a sweep: their values, exactly, and what is refused with its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.files.config import Variants
from ensemble_ctrl.files.config.axes import axes_of
from ensemble_ctrl.files.config.errors import FieldError
from tests.api.test_many import SMALL


def values(given: Any, folder: Path = Path()) -> list[Any]:
    (axis,) = axes_of({"key": given}, folder)
    return list(axis.values)


def test_decimals_are_those_that_one_would_write() -> None:
    assert values({"from": 0, "to": 0.5, "step": 0.1}) == [0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert values({"from": 0.1, "to": 0.7, "count": 7}) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]


def test_whole_numbers_stay_whole() -> None:
    found = values({"from": 80, "to": 320, "step": 80})
    assert found == [80, 160, 240, 320]
    assert {type(value) for value in found} == {int}


def test_ranges_are_those_of_numpy() -> None:
    np.testing.assert_allclose(values({"from": -1.5, "to": 7, "count": 9}), np.linspace(-1.5, 7, 9), rtol=1e-15)
    found = values({"from": 1e-3, "to": 10, "count": 9, "spacing": "log"})
    np.testing.assert_allclose(found, np.geomspace(1e-3, 10, 9), rtol=1e-13)
    assert values({"from": 5, "to": 1, "step": -2}) == [5, 3, 1]


def test_units_and_lists() -> None:
    assert values({"from": "0 cm", "to": "50 cm", "count": 3}) == ["0 cm", "25 cm", "50 cm"]
    assert values({"from": [0.95, 1.05], "to": [0.7, 1.3], "count": 3}) == [[0.95, 1.05], [0.825, 1.175], [0.7, 1.3]]
    assert values({"seeds": 3, "first": 7}) == [7, 8, 9]


def test_files_are_in_order_and_in_the_folder(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    for name in ("b.wkt", "a.wkt", "c.txt"):
        (tmp_path / "maps" / name).touch()
    assert values({"files": "maps/*.wkt"}, tmp_path) == [{"file": "maps/a.wkt"}, {"file": "maps/b.wkt"}]
    outside = tmp_path / "outside.wkt"
    outside.touch()
    (tmp_path / "maps" / "link.wkt").symlink_to(outside)
    with pytest.raises(FieldError, match="same folder or below"):
        values({"files": "*.wkt"}, tmp_path / "maps")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"from": 0, "to": 1}, "expected from, to, and count or step"),
        ({"from": 0, "to": 1, "count": 2, "step": 1}, "expected from, to, and count or step"),
        ({"from": 0, "to": 1, "count": 1}, "expected a whole number from 2"),
        ({"from": 0, "to": 1, "step": -1}, "expected a step from 0 towards 1, got -1"),
        ({"from": 0, "to": 1, "step": 1e-9}, "expected a step from 0 towards 1"),
        ({"from": 0, "to": "1 m", "count": 3}, "expected the same unit at both ends"),
        ({"from": 0, "to": 1, "count": 3, "spacing": "log"}, "expected numbers above 0"),
        ({"from": "a lot", "to": 1, "count": 3}, "expected a number, with or without a unit, got 'a lot'"),
        ({"seeds": 0}, "expected a whole number from 1"),
        ({"files": "../*"}, "expected a pattern of files in the same folder or below"),
        ({"files": "*.none"}, "expected files, found none"),
        ({"form": 0}, "expected a list, a range, seeds or files"),
        ([], "expected at least one value"),
        ([1, None], "expected values, got one that is empty"),
        (3, "expected a list, a range, seeds or files, got 3"),
    ],
)
def test_what_is_no_axis_is_refused(given: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(FieldError, match=message):
        values(given, tmp_path)


def test_a_mistake_has_its_place_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL + "sweep:\n  fleet.radius: {from: 0 cm, to: 10 cm, count: x}\n", encoding="utf-8")
    with pytest.raises(ec.ConfigError, match=r"small\.yaml:9:48: error: sweep\.fleet\.radius\.count: expected a whole"):
        ec.load(path)


def test_every_combination_has_its_problem(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL + "sweep: {solve.seed: {seeds: 3}, horizon.steps: [5, 6]}\n", encoding="utf-8")
    found = Variants(path)
    assert len(found) == 6
    problems = [found.problem(n).problem for n in range(6)]
    assert [(p.solve.seed, p.steps) for p in problems] == [(s, n) for s in range(3) for n in (5, 6)]
    assert found.base.problem.steps == 10
    assert len(Variants(path, axes=["solve.seed=[4]"])) == 2


def test_an_axis_of_the_command_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    with pytest.raises(ec.ConfigError, match=r"--axis solve\.seed=3: error: expected a list or a section"):
        Variants(path, axes=["solve.seed=3"])
