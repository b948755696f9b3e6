"""The tube holds the fleet: every member of a slice, at every instant."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from ensemble_ctrl.report.tube import Ribbon, tubes

from .plans import ODE_KINDS, made, ode_made

CURLS = {"plain": 0.9, "several": 0.5, "bicycle": 0.2, "equal": 1.5, "spread": 2.0}


@pytest.mark.parametrize(("kind", "curl"), CURLS.items())
def test_every_member_stays_in_its_slice(kind: str, curl: float) -> None:
    problem = made(kind).problem
    turn = curl * np.sin(np.linspace(0, 9, problem.steps))
    controls = np.column_stack([np.full(problem.steps, 1.5), turn])
    ribbons = plane(problem, controls)
    fleet = problem.fleet
    members = np.concatenate([fleet.sample(300, 4), fleet.corners, fleet.grid(81)])
    paths = trajectories(problem, controls, members, 9)
    areas = [_area(ribbon.outlines) for ribbon in ribbons]
    share = (members - fleet.lower)[:, 0] / (fleet.upper - fleet.lower)[0] if fleet.names else np.zeros(len(members))
    slices = np.clip((share * len(areas)).astype(int), 0, len(areas) - 1)
    for area, path in zip(np.array(areas)[slices], paths, strict=True):
        assert shapely.covers(area, shapely.points(path)).all()


@pytest.mark.parametrize("kind", ODE_KINDS)
def test_members_of_other_systems_stay_in_their_slice_in_every_view(kind: str) -> None:
    plan = ode_made(kind)
    fleet = plan.problem.fleet
    members = np.concatenate([fleet.sample(100, 4), fleet.corners, fleet.grid(21)])
    paths = trajectories(plan.problem, plan.controls, members, 7)
    times = np.broadcast_to(np.linspace(0, plan.problem.duration, paths.shape[1]), paths.shape[:2])
    share = (members - fleet.lower)[:, 0] / (fleet.upper - fleet.lower)[0] if fleet.names else np.zeros(len(members))
    found = tubes(plan.problem, plan.controls)
    assert list(found) == VIEWS[kind]
    for view, ribbons in found.items():
        seen = np.stack([times, paths[..., 0]], axis=-1) if view is None else paths[..., list(view)]
        areas = np.array([_area(ribbon.outlines) for ribbon in ribbons])
        slices = np.clip((share * len(areas)).astype(int), 0, len(areas) - 1)
        for area, path in zip(areas[slices], seen, strict=True):
            assert shapely.covers(area, shapely.points(path)).all()
        swept = shapely.union_all([shapely.LineString(path).buffer(0.02) for path in seen])
        assert shapely.union_all(areas).difference(swept.convex_hull.buffer(0.02)).area < 1e-9


VIEWS = {"plane": [(0, 1)], "space": [(0, 1), (0, 2)], "line": [None], "equal line": [None]}


def plane(problem: Problem, controls: np.ndarray) -> tuple[Ribbon, ...]:
    """The tube of robots on arcs."""
    return tubes(problem, controls)[0, 1]


def test_a_tube_is_not_much_larger_than_the_fleet() -> None:
    plan = made("plain")
    paths = trajectories(plan.problem, plan.controls, plan.problem.fleet.grid(41), 4)
    swept = shapely.union_all([shapely.LineString(path).buffer(0.01) for path in paths]).area
    whole = shapely.union_all([_area(ribbon.outlines) for ribbon in plane(plan.problem, plan.controls)]).area
    assert whole < 2 * swept


def test_many_steps_share_hulls() -> None:
    plan = made("plain")
    long = plan.problem.with_(steps=1000)
    ribbons = plane(long, np.repeat(plan.controls, 25, axis=0))
    assert sum(len(outline) for ribbon in ribbons for outline in ribbon.outlines) < 12 * 400


def _area(outlines: tuple[np.ndarray, ...]) -> shapely.Geometry:
    """Rings filled by the even-odd rule."""
    area: shapely.Geometry = shapely.Polygon()
    for outline in outlines:
        area = shapely.symmetric_difference(area, shapely.Polygon(outline))
    return area
