"""The table of the page on the paper: what its kept rows say, and the quicker ones planned again."""

from __future__ import annotations

import json
from itertools import product
from typing import Any

import pytest

from ensemble_ctrl.api.paper import EXPERIMENTS, ROBOTS, Form, Robot, as_data, reproduce

from ..paths import ROOT

Row = dict[str, Any]

KEPT: list[Row] = json.loads((ROOT / "benchmarks/measured/paper.json").read_text(encoding="utf-8"))["rows"]
ROWS: dict[tuple[str, str, str], Row] = {(row["experiment"], row["robot"], row["form"]): row for row in KEPT}

OURS = {
    ("box", "unicycle"): 0.0795,
    ("box", "bicycle"): 0.0322,
    ("polyhedron", "unicycle"): 0.0816,
    ("polyhedron", "bicycle"): 0.0313,
    ("one_obstacles", "unicycle"): 0.4806,
    ("one_obstacles", "bicycle"): 0.3618,
    ("three_obstacles", "unicycle"): 0.9238,
    ("three_obstacles", "bicycle"): 0.5979,
    ("five_obstacles", "unicycle"): 0.5392,
    ("five_obstacles", "bicycle"): 0.4290,
    ("six_obstacles", "unicycle"): 0.6735,
    ("six_obstacles", "bicycle"): 0.4593,
    ("seven_obstacles", "unicycle"): 0.9541,
    ("seven_obstacles", "bicycle"): 0.5910,
    ("eight_obstacles", "unicycle"): 1.5398,
    ("eight_obstacles", "bicycle"): 0.8584,
    ("two_waypoints", "unicycle"): 1.1979,
    ("two_waypoints", "bicycle"): 0.8487,
}
"""Costs of our plans."""
PUBLISHED = {
    ("box", "unicycle"): (0.0830, 0.0),
    ("box", "bicycle"): (0.3021, 1.0),
    ("polyhedron", "unicycle"): (0.0834, 0.0),
    ("one_obstacles", "unicycle"): (0.6244, 0.0),
    ("one_obstacles", "bicycle"): (0.3924, 0.0),
    ("three_obstacles", "unicycle"): (1.0274, 0.0),
    ("three_obstacles", "bicycle"): (0.8995, 0.125),
}
"""Of published plans that take seconds: cost, and share of the members that violate."""
COST, SHARE, DEPTH = 0.01, 0.02, 0.02
"""Tolerances: relative, of the members, metres."""
FORMS: tuple[Form, ...] = ("published", "ours")


def agrees(row: Row, cost: float, share: float) -> None:
    """A row has that cost and share of violating members, within the tolerances."""
    assert row["cost"] == pytest.approx(cost, rel=COST, abs=1e-3)
    assert row["violating"] / row["members"] == pytest.approx(share, abs=SHARE)


def test_there_is_a_row_for_everything() -> None:
    asked = set(product(EXPERIMENTS, ROBOTS, FORMS))
    assert asked <= set(ROWS)
    assert {form for _, _, form in set(ROWS) - asked} == {"linear"}
    assert all(row["members"] == 100_000 for row in KEPT)


@pytest.mark.parametrize("row", KEPT, ids=lambda row: f"{row['experiment']}-{row['robot']}-{row['form']}")
def test_a_kept_row_is_consistent(row: Row) -> None:
    """A proof and a violating member exclude each other; a depth is there exactly where a member violates."""
    assert (row["violating"] > 0) == (row["depth"] > 0)
    assert row["violating"] == 0 or row["proven"] == "no"
    assert row["form"] == "published" or (row["proven"], row["status"]) == ("yes", "planned")
    assert row["bound"] is None or row["bound"] <= row["cost"]
    assert row["truncation"] < 0.01


@pytest.mark.parametrize(("name", "robot"), OURS)
def test_kept_costs_of_ours(name: str, robot: str) -> None:
    agrees(ROWS[name, robot, "ours"], OURS[name, robot], 0.0)


@pytest.mark.parametrize(("name", "robot"), PUBLISHED)
def test_kept_costs_and_shares_of_the_published_form(name: str, robot: str) -> None:
    agrees(ROWS[name, robot, "published"], *PUBLISHED[name, robot])


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if (name, "unicycle") in OURS])
def test_a_plan_from_a_linear_model_costs_about_the_same(name: str) -> None:
    """Another start of the same program: up to 5 % less, and no more than 1 % more."""
    if (row := ROWS.get((name, "unicycle", "linear"))) is not None:
        assert 0.95 * OURS[name, "unicycle"] <= row["cost"] <= 1.01 * OURS[name, "unicycle"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "robot"), OURS)
def test_ours_again(name: str, robot: Robot) -> None:
    (row,) = reproduce([name], [robot], members=2000, forms=["ours"])
    agrees(as_data(row), OURS[name, robot], 0.0)
    assert row.proven == "yes"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "robot"), [what for what in PUBLISHED if "unicycle" in what])
def test_the_published_form_again(name: str, robot: Robot) -> None:
    (row,) = reproduce([name], [robot], members=2000, bonmin_limit=0.5, forms=["published"])
    agrees(as_data(row), *PUBLISHED[name, robot])
    assert row.proven == ROWS[name, robot, "published"]["proven"]
    assert row.depth == pytest.approx(ROWS[name, robot, "published"]["depth"], abs=DEPTH)
