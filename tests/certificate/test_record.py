"""Nothing that a reader may take from a saved certificate can be edited without ``verify`` saying so."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import Certificate, certify, claim, differences
from ensemble_ctrl.core.plain import to_json

TEXT = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.95, 1.05]}}
  start: {position: [0, 0], heading: 0 deg, heading_from: x}
horizon: {duration: 4 s, steps: 8}
regions: {goal: {box: [[3, 5], [-1, 1]]}}
obstacles: {post: {box: [[1, 2], [1, 2]]}}
task: F in(goal) and G y <= 1 and G avoid(post) and share(0.5, F x >= 3.9)
"""
Path = tuple[str | int, ...]
Edit = tuple[str, Callable[[Any], Any]]


@cache
def certificate(speed: float) -> Certificate:
    """Proven at 1 m/s, refuted at 0.1 m/s."""
    return certify(ec.load_text(TEXT), np.column_stack([np.full(8, speed), np.zeros(8)]))


def saved(speed: float) -> Any:
    return json.loads(to_json(claim(certificate(speed))))


def entries(data: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Every entry, those that hold others included."""
    yield path, data
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield from entries(value, (*path, key))


def edits(value: Any) -> list[Edit]:
    """Ways to change an entry."""
    if isinstance(value, dict):
        return [("one more", lambda old: {**old, "margin": 1.0}), ("none", lambda old: {})]
    if isinstance(value, list):
        return [
            ("one more", lambda old: [*old, copy.deepcopy(old[-1]) if old else {}]),
            ("one less", lambda old: old[1:]),
        ]
    if isinstance(value, bool):
        return [("the other", lambda old: not old)]
    if isinstance(value, int | float):
        return [
            ("more", lambda old: old + 1e-5),
            ("less", lambda old: old - 1e-5),
            ("text", str),
            ("none", lambda _: None),
        ]
    return [("text", lambda old: f"{old}x"), ("number", lambda _: 7.0)]


CASES = [
    pytest.param(speed, path, edit, id=f"{speed}-{'.'.join(map(str, path))}-{edit[0]}")
    for speed in (1.0, 0.1)
    for path, value in entries(saved(speed))
    for edit in edits(value)
    if edit[1](copy.deepcopy(value)) != value
]


@pytest.mark.parametrize(("speed", "path", "edit"), CASES)
def test_every_edit_is_found_out(speed: float, path: Path, edit: Edit) -> None:
    claimed = {"": saved(speed)}
    *above, last = ("", *path)
    place: Any = claimed
    for key in above:
        place = place[key]
    place[last] = edit[1](place[last])
    assert differences(claimed[""], certificate(speed))


@pytest.mark.parametrize("speed", [1.0, 0.1])
def test_what_was_saved_agrees(speed: float) -> None:
    assert certificate(speed).proven == {1.0: "yes", 0.1: "no"}[speed]
    assert differences(saved(speed), certificate(speed)) == []


def test_a_proven_number_may_not_claim_more() -> None:
    """Rounding to six digits downwards is no lie, upwards it is."""
    for change, wrong in ((-1e-7, False), (1e-7, True)):
        claimed = saved(1.0)
        claimed["clearances"][0]["proven"] += change
        claimed["clearance"] += change
        assert bool(differences(claimed, certificate(1.0))) is wrong


@pytest.mark.parametrize("claimed", [None, [], 3, "yes", {}, {"proven": 10**400}])
def test_what_is_no_certificate_differs(claimed: Any) -> None:
    assert differences(claimed, certificate(1.0))


def test_what_it_took_is_no_claim() -> None:
    """Boxes and seconds differ from machine to machine, so that they are not in the file."""
    again = replace(certificate(1.0), seconds=1e6, boxes=3)
    assert differences(saved(1.0), again) == []
    assert {"boxes", "seconds"}.isdisjoint(saved(1.0))
