"""Regions that no passage leads to, against a flood fill of a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label

import ensemble_ctrl as ec
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.ocp.guesses.passages import closed_off
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.planning.suggest import suggest

RADIUS, CELL = 0.15, 0.04

TEXT = """
fleet: {{model: {model}, start: {{position: [0, 0]{heading}}}, radius: {radius}}}
horizon: {{duration: 4 s, steps: 20}}
regions: {{goal: {{box: [[2, 2.6], [-0.3, 0.3]]}}, other: {{box: [[-2.6, -2], [-0.3, 0.3]]}}}}
obstacles:
  west: {{box: [[1.5, 1.8], [-0.9, 0.9]]}}
  east: {{box: [[2.8, 3.1], [-0.9, 0.9]]}}
  south: {{box: [[1.8, 2.8], [-0.9, -0.6]]}}
  north: {{box: [[1.8, {end}], [0.6, 0.9]]}}
task: "{task}"
solve: {{routes: 1}}
"""


def walls(
    end: float = 2.8, task: str = "F[3, 4] in(goal) and G avoid(obstacles)", model: str = "unicycle", radius: float = 0
) -> ec.Problem:
    heading = ", heading: 0 deg" if model == "unicycle" else ""
    return ec.load_text(TEXT.format(end=end, task=task, model=model, radius=radius, heading=heading))


def scattered(seed: int) -> ec.Problem:
    """Rectangles at random around the goal, none at the goal."""
    random, found = np.random.default_rng(seed), dict[str, tuple[Obstacle, ...]]()
    while len(found) < 20:
        angle, half = random.uniform(-np.pi, np.pi), random.uniform(0.1, 0.5, size=2)
        middle = np.array([3, 0]) + random.uniform(0.8, 1.3) * np.array([np.cos(angle), np.sin(angle)])
        low, high = middle - half, middle + half
        if shapely.box(*low, *high).distance(shapely.box(2.9, -0.1, 3.1, 0.1)) > 0.3:
            found[f"o{len(found)}"] = (Obstacle.box(np.stack([low, high], axis=1)),)
    open_space = ec.load_text(
        f"fleet: {{model: unicycle, start: {{position: [0, 0], heading: 0 deg}}, radius: {RADIUS}}}\n"
        "horizon: {duration: 20 s, steps: 20}\nregions: {goal: {box: [[2.9, 3.1], [-0.1, 0.1]]}}\n"
        'task: "F in(goal) and G avoid(obstacles)"\n'
    )
    return open_space.with_(obstacles=found)


def flooded(problem: ec.Problem, clearance: float, corners: bool) -> bool:
    """Whether cells that keep a clearance lead from the start to the goal, through sides, or through corners too."""
    shapes = [shapely.Polygon(piece.vertices) for pieces in problem.obstacles.values() for piece in pieces]
    xs, ys = np.arange(-0.4, 5.4, CELL), np.arange(-2.4, 2.4, CELL)
    x, y = np.meshgrid(xs, ys, indexing="ij")
    room: NDArray[np.float64] = shapely.distance(shapely.union_all(shapes), shapely.points(x, y))
    cells, _ = label(room > clearance, np.ones((3, 3)) if corners else None)
    start = cells[np.abs(xs).argmin(), np.abs(ys).argmin()]
    inside = (np.abs(x - 3) <= 0.1) & (np.abs(y) <= 0.1)
    return bool(start and (cells[inside] == start).any())


def test_it_says_what_a_flood_fill_says(monkeypatch: pytest.MonkeyPatch) -> None:
    # some of these maps are refused with a proof before any search
    monkeypatch.setattr("ensemble_ctrl.problem.checks.impossible.wall_findings", lambda *_: iter(()))
    seen = {True: 0, False: 0}
    for seed in range(20):
        problem = scattered(seed)
        # wide enough by a cell's diagonal, and too narrow by one
        wide = flooded(problem, RADIUS + 1.5e-3 + CELL, corners=False)
        narrow = not flooded(problem, RADIUS + 1e-3 - CELL, corners=True)
        if wide or narrow:
            assert closed_off(problem) == (("goal",) if narrow else ())
            seen[wide] += 1
    assert min(seen.values()) >= 3


@pytest.mark.parametrize(
    ("task", "closed"),
    [
        ("F[3, 4] in(goal) and G avoid(obstacles)", ("goal",)),
        ("(F[3, 4] in(goal) or F[3, 4] in(other)) and G avoid(obstacles)", ()),
        ("F[3, 4] in(goal) and F[1, 4] in(other) and G avoid(obstacles)", ("goal",)),
        ("F[3, 4] in(goal) and G[0, 2] avoid(west) and G avoid(east) and G avoid(south) and G avoid(north)", ()),
        ("F[3, 4] in(goal) and G avoid(west) and G avoid(east) and G avoid(south)", ()),
        ("F[3, 4] in(other) and G avoid(obstacles)", ()),
        ("G avoid(obstacles)", ()),
    ],
)
def test_walls_that_touch_count_as_long_as_they_are_avoided(task: str, closed: tuple[str, ...]) -> None:
    assert closed_off(walls(task=task)) == closed


@pytest.mark.parametrize(("end", "radius", "closed"), [(2.79, 0, False), (2.7985, 0, True), (2.5, 0.1, False)])
def test_a_gap_wider_than_the_robots_is_a_passage(end: float, radius: float, closed: bool) -> None:
    assert bool(closed_off(walls(end, radius=radius))) is closed


@pytest.mark.parametrize("model", ["unicycle", "double_integrator"])
def test_a_search_that_no_passage_is_for_ends_with_its_first_guesses(model: str) -> None:
    solution = solve(walls(model=model))
    assert solution.status == "infeasible"
    assert solution.closed == ("goal",)
    assert {route.kind for route in solution.routes} == {"route"}


def test_only_what_opens_a_passage_is_suggested() -> None:
    problem = walls()
    found = suggest(problem, solve(problem).controls, seconds=60.0)
    assert [suggestion.change for suggestion in found.helps] == ["no obstacle west"]
