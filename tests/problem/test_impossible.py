"""Tasks that no plan can do: refused with the reason, and never one that a robot is seen to do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import label

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, member_robustness, parse
from ensemble_ctrl.constraints.stl.rewrite import ground, resolve
from ensemble_ctrl.constraints.stl.robustness import reach
from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks.walls import Piece, closed
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Unicycle
from tests.examples import examples

TEXT = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.8, 1.0]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-1, 1], omega: [-1, 1]}
  radius: 0.1 m
horizon: {duration: 10 s, steps: 20}
regions:
  a: {box: [[2, 3], [1, 2]]}
  b: {box: [[2, 3], [-2, -1]]}
  c: {box: [[2.5, 3], [0, 3]]}
  hall: {box: [[-1, 4], [-3, 3]]}
  near: {box: [[-1, 1.2], [-3, 3]]}
obstacles:
  west: {box: [[1.5, 1.7], [0.5, 2.5]]}
  east: {box: [[3.3, 3.5], [0.5, 2.5]]}
  south: {box: [[1.5, 3.5], [0.5, 0.7]]}
  north: {box: [[1.5, 3.5], [2.3, 2.5]]}
task: "TASK"
"""
WALLS = "obstacles 'east', 'north', 'south' and 'west' close the region in"


def refusal(task: str, *changes: tuple[str, str]) -> str:
    """What a problem is refused with."""
    text = TEXT.replace("TASK", task)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(ConfigError) as error:
        load_text(text)
    return str(error.value)


@pytest.mark.parametrize(
    ("task", "wanted"),
    [
        ("G[6, 7] in(a) and F[6, 7] in(b)", "in 'a' and 'b' at one time, but these regions are 2 m apart"),
        ("F[2, 9] (in(a) and in(b))", "in 'a' and 'b' at one time"),
        ("F[0, 6] (G[0, 2] in(a) and F[1, 2] in(b))", "in 'a' and 'b' at one time"),
        ("G[4, 6] F[0, 1] in(a) and G[3, 6] in(b)", "in 'a' and 'b' at one time"),
        ("in(hall) U[6, 6] in(a) and F[6, 6] in(b)", "in 'a' and 'b' at one time"),
        (
            "F[5, 5.5] in(a) and F[6, 7] in(b)",
            "within 2 s, but these regions are 2 m apart, and at top speed the slowest",
        ),
        ("F[0, 8] (in(a) and F[0, 2] in(b))", "it needs 2.5 s: give more time between them"),
        ("(G[6, 7] in(a) and F[6, 7] in(b)) or F[0, 1] in(b)", "region 'b' is 2.24 m from the start"),
        ("F in(a) and G avoid(obstacles)", "close the region in"),
        ("F[0, 5] in(a) and G[0, 5] avoid(obstacles)", "no way leads from the start to 'a': 'east', 'north', 'south'"),
        ("G in(hall) and F in(a) and G avoid(west) and G avoid(north) and G avoid(south) and G avoid(east)", "close"),
    ],
)
def test_tasks_that_no_plan_can_do_are_refused(task: str, wanted: str) -> None:
    assert wanted in refusal(task)


def test_the_start_may_be_what_is_closed_in() -> None:
    text = refusal("F in(b) and G avoid(obstacles)", ("[0, 0]", "[2.5, 1.5]"))
    assert "close the start in" in text
    assert "open a gap wider than the robots, 0.2 m" in text


def test_a_region_to_stay_in_closes_a_wall() -> None:
    """A wall across the hall, which ends 5 cm from its edges, with robots of 20 cm."""
    across = ("west: {box: [[1.5, 1.7], [0.5, 2.5]]}", "west: {box: [[1.0, 1.2], [-3.05, 2.95]]}")
    text = refusal("G in(hall) and F in(b) and G avoid(west)", across)
    assert "no way leads from the start to 'b': 'west' and the edge of 'hall' close the region in" in text or (
        "close the start in" in text
    )
    load_text(TEXT.replace("TASK", "F in(b) and G avoid(west)").replace(*across))


@pytest.mark.parametrize(
    "task",
    [
        "F[5, 5.5] in(a) and F[6, 8] in(b)",
        "G[6, 7] in(a) and G[6, 7] in(c)",
        "(G[6, 7] in(a) and F[6, 7] in(b)) or F in(b)",
        "F in(a) and G[1, 10] avoid(obstacles)",
        "F in(a) and G[0, 9] avoid(obstacles)",
        "F in(c) and G avoid(obstacles)",
        "share(0.9, F in(a) and G avoid(obstacles))",
        "G F[0, 8] in(a) and F in(b)",
        "G (in(near) and F[0, 3] x <= 9) and F[9, 10] in(b)",
        "not (G[6, 7] in(a) and F[6, 7] in(b))",
    ],
)
def test_tasks_that_may_be_done_are_left_alone(task: str) -> None:
    load_text(TEXT.replace("TASK", task))


def test_discs_are_round() -> None:
    """Eight trees around the goal, which is a disc; each two leave 1 cm less than a robot, or 1 cm more."""
    apart = 2 * 1.0 * np.sin(np.pi / 8)
    for spare, passes in ((-0.01, False), (0.01, True)):
        radius = (apart - 0.2 - spare) / 2
        angles = 2 * np.pi * np.arange(8) / 8
        trees = "".join(
            f"  t{k}: {{disc: {{center: [{2.5 + np.cos(a)}, {np.sin(a)}], radius: {radius}}}}}\n"
            for k, a in enumerate(angles)
        )
        text = (
            TEXT.split("regions:")[0]
            + f"regions: {{a: {{disc: {{center: [2.5, 0], radius: 0.3}}}}}}\nobstacles:\n{trees}"
        )
        text += "task: F in(a) and G avoid(obstacles)\n"
        if passes:
            load_text(text)
        else:
            with pytest.raises(ConfigError, match="'t6' and 't7' close the region in"):
                load_text(text)
    # 0.6 m between the discs; 2 cm more between the polygons inside of them
    discs = "a: {disc: {center: [2.5, 1.5], radius: 0.5}}", "b: {disc: {center: [2.5, -0.1], radius: 0.5}}"
    text = TEXT.replace("TASK", "F[5, 5] in(a) and F[5.7, 5.75] in(b)").replace("a: {box: [[2, 3], [1, 2]]}", discs[0])
    text = text.replace("b: {box: [[2, 3], [-2, -1]]}", discs[1])
    load_text(text)
    with pytest.raises(ConfigError, match="m in that time"):
        load_text(text.replace("[5.7, 5.75]", "[5.6, 5.7]"))


@pytest.mark.parametrize(("gap", "passes"), [(0.1999, False), (0.2001, True)])
def test_a_gap_as_wide_as_a_robot_is_open(gap: float, passes: bool) -> None:
    text = TEXT.replace("TASK", "F in(a) and G avoid(obstacles)").replace(
        "[1.5, 3.5], [2.3, 2.5]", f"[{1.7 + gap}, 3.5], [2.3, 2.5]"
    )
    if passes:
        load_text(text)
    else:
        with pytest.raises(ConfigError, match="close the region in"):
            load_text(text)


def test_walls_that_only_touch_are_no_proof() -> None:
    """A point robot could go along the common edge of two boxes, in the letter of the task."""
    text = TEXT.replace("radius: 0.1 m", "radius: 0").replace("TASK", "F in(a) and G avoid(obstacles)")
    with pytest.raises(ConfigError, match="close the region in"):
        load_text(text)
    load_text(text.replace("[1.5, 3.5], [2.3, 2.5]", "[1.7, 3.3], [2.3, 2.5]"))


OPERATORS = (
    "in(r{k})",
    "F[{a},{b}] {one}",
    "G[{a},{b}] {one}",
    "({one} and {two})",
    "({one} or {two})",
    "({one} U[{a},{b}] {two})",
)


def written(rng: np.random.Generator, depth: int) -> str:
    """A task at random over four regions."""
    if depth == 0:
        return f"in(r{rng.integers(4)})"
    a, b = np.sort(rng.integers(0, 9, 2)) / 4
    pattern = str(rng.choice(OPERATORS))
    return pattern.format(k=rng.integers(4), a=a, b=b, one=written(rng, depth - 1), two=written(rng, depth - 1))


@given(st.integers(0, 2**31))
@examples(80)
def test_what_a_robot_is_seen_to_do_is_never_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fleet = Fleet(Unicycle(), {"traction": Interval(0.9, 0.9)}, np.zeros(2), 0.3, [-1.0, -1.0], [1.0, 1.0])
    controls = np.repeat(rng.choice([-1.0, 1.0, 1.0], (8, 2)) * rng.uniform(0.8, 1.0, (8, 2)), 5, axis=0)
    path = fleet.trajectories(controls, fleet.center[None], 0.25)[0, :, :2]
    # small boxes around places on the way, and some that it leaves and comes back to
    at = rng.integers(0, len(path), 4)
    half = rng.uniform(0.05, 1.0, 4)
    regions = {
        f"r{k}": Polyhedron.box(np.column_stack([path[i] - h, path[i] + h]))
        for k, (i, h) in enumerate(zip(at, half, strict=True))
    }
    states = fleet.trajectories(controls, fleet.center[None], 0.25)
    signals = StateSignals(states, ("x", "y"), 0.25)
    for _ in range(40):
        parts = [f"F[0,{t}] {written(rng, 2)}" if rng.random() < 0.7 else written(rng, 3) for t in (2, 4)]
        task = parse(" and ".join(parts))
        if reach(task, 0.25) <= 40:
            exact = ground(resolve(task, 10.0), regions, {}, position=("x", "y"), radius=0.0)
            if member_robustness(exact, signals, ExactOps())[0, 0] > 0:
                Problem("any", fleet, 10.0, 40, task, regions=regions)


def rooms(rng: np.random.Generator, count: int, radius: float) -> tuple[list[Piece], np.ndarray[Any, Any]]:
    """Thin walls at random around the middle, and a small region beyond some of them."""
    found = []
    for k in range(count):
        angle, away = 2 * np.pi * k / count + rng.normal(0, 0.1), rng.uniform(0.9, 1.3)
        centre, turned = away * np.array([np.cos(angle), np.sin(angle)]), angle + np.pi / 2 + rng.normal(0, 0.3)
        along = np.array([np.cos(turned), np.sin(turned)]) * rng.uniform(1.0, 1.7) * np.pi / count * 1.25
        across = np.array([-np.sin(turned), np.cos(turned)]) * rng.uniform(0.05, 0.15)
        corners = [centre + a * along + b * across for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        found.append(Piece(f"o{k}", np.array(corners), radius))
    angle = rng.uniform(0, 2 * np.pi)
    place = 2.2 * np.array([np.cos(angle), np.sin(angle)])
    return found, place + 0.1 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def connected(parts: list[Piece], region: np.ndarray[Any, Any], spare: float) -> bool:
    """Whether cells with so much room connect the start with the region, by filling."""
    axis = np.arange(-2.61, 2.61 + 1e-9, CELL)
    cells = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    room = np.min([Obstacle.polygon(part.corners).distance(cells) - part.radius for part in parts], axis=0)
    filled, _ = label(room > spare, structure=np.ones((3, 3)))
    here, there = (tuple(np.rint((place + 2.61) / CELL).astype(int)) for place in (np.zeros(2), region.mean(axis=0)))
    return bool(filled[here] and filled[here] == filled[there])


CELL = 0.03


def test_walls_agree_with_filling_a_fine_grid() -> None:
    """Cells that keep half their diagonal from everything are connected by ways that robots can drive, and reverse."""
    rng, seen = np.random.default_rng(17), {True: 0, False: 0}
    for k in range(50):
        parts, region = rooms(rng, int(rng.integers(5, 9)), float(rng.choice([0.0, 0.1])))
        wall = closed(parts, region)
        if connected(parts, region, 1.5 * CELL):
            assert wall is None, k
            seen[True] += 1
        elif not connected(parts, region, -1.5 * CELL):
            assert wall is not None, k
            seen[False] += 1
    assert min(seen.values()) >= 10
