"""The tube holds the fleet: every member of a slice, at every instant."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from ensemble_ctrl.replay import trajectories
from ensemble_ctrl.report.tube import tube

from .plans import made

CURLS = {"plain": 0.9, "several": 0.5, "bicycle": 0.2, "equal": 1.5, "spread": 2.0}


@pytest.mark.parametrize(("kind", "curl"), CURLS.items())
def test_every_member_stays_in_its_slice(kind: str, curl: float) -> None:
    problem = made(kind).problem
    turn = curl * np.sin(np.linspace(0, 9, problem.steps))
    controls = np.column_stack([np.full(problem.steps, 1.5), turn])
    ribbons = tube(problem, controls)
    fleet = problem.fleet
    members = np.concatenate([fleet.sample(300, 4), fleet.corners, fleet.grid(81)])
    paths = trajectories(problem, controls, members, 9)
    areas = [_area(ribbon.outlines) for ribbon in ribbons]
    share = (members - fleet.lower)[:, 0] / (fleet.upper - fleet.lower)[0] if fleet.names else np.zeros(len(members))
    slices = np.clip((share * len(areas)).astype(int), 0, len(areas) - 1)
    for area, path in zip(np.array(areas)[slices], paths, strict=True):
        assert shapely.covers(area, shapely.points(path)).all()


def test_a_tube_is_not_much_larger_than_the_fleet() -> None:
    plan = made("plain")
    paths = trajectories(plan.problem, plan.controls, plan.problem.fleet.grid(41), 4)
    swept = shapely.union_all([shapely.LineString(path).buffer(0.01) for path in paths]).area
    whole = shapely.union_all([_area(ribbon.outlines) for ribbon in tube(plan.problem, plan.controls)]).area
    assert whole < 2 * swept


def test_many_steps_share_hulls() -> None:
    plan = made("plain")
    long = plan.problem.with_(steps=1000)
    ribbons = tube(long, np.repeat(plan.controls, 25, axis=0))
    assert sum(len(outline) for ribbon in ribbons for outline in ribbon.outlines) < 12 * 400


def _area(outlines: tuple[np.ndarray, ...]) -> shapely.Geometry:
    """Rings filled by the even-odd rule."""
    area: shapely.Geometry = shapely.Polygon()
    for outline in outlines:
        area = shapely.symmetric_difference(area, shapely.Polygon(outline))
    return area
