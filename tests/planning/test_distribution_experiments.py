"""Problem files with other distributions: planned, proven for the range, replayed under the distribution."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.cli.verify import _replayed
from ensemble_ctrl.files.config import read
from ensemble_ctrl.moments import Beta, Interval, Samples
from ensemble_ctrl.problem import Problem
from tests.paths import CONFIGS

FILES = CONFIGS / "distributions"
NAMES = ["beta", "measured"]
experiments = pytest.mark.parametrize("name", NAMES)


@cache
def problem(name: str) -> Problem:
    """The problem of a file, which has no warnings."""
    loaded = read(FILES / f"{name}.yaml")
    assert loaded.warnings == ()
    return loaded.problem


@cache
def planned(name: str) -> Plan:
    """Its plan, made once."""
    return plan(problem(name))


def test_every_file_is_an_experiment_here() -> None:
    assert sorted(path.stem for path in FILES.glob("*.yaml")) == NAMES


def test_what_the_files_say() -> None:
    assert problem("beta").fleet.parameters["traction"] == Beta(0.85, 1.15, 2, 5)
    distribution = problem("measured").fleet.parameters["traction"]
    assert isinstance(distribution, Samples)
    assert len(distribution.values) == 60
    assert 0.9 < distribution.lower < 0.95 < 1.0 < distribution.upper < 1.1
    table = np.loadtxt(FILES / "measured.csv", delimiter=",", skiprows=2)
    np.testing.assert_array_equal(distribution.values, np.sort(table[:, 1]))


@experiments
def test_it_is_planned_and_proven_for_the_whole_range(name: str) -> None:
    found = planned(name)
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    distribution = problem(name).fleet.parameters["traction"]
    assert found.certificate.ranges == {"traction": (distribution.lower, distribution.upper)}
    assert not found.replay(members=5000, substeps=5).violating.any()


@experiments
def test_a_saved_plan_keeps_the_distribution(name: str, tmp_path: Path) -> None:
    again = Plan.load(planned(name).save(tmp_path / "plan.npz"))
    assert again.problem.fleet.parameters["traction"] == problem(name).fleet.parameters["traction"]
    np.testing.assert_array_equal(again.controls, planned(name).controls)


def test_verify_draws_from_the_distribution() -> None:
    found = planned("beta")
    drawn = _replayed(found, {}, 2000).parameters[:, 0]
    assert (len(drawn), drawn[0], drawn[1]) == (2000, 0.85, 1.15)
    assert drawn.mean() == pytest.approx(0.85 + 0.3 * 2 / 7, abs=0.005)
    assert len(_replayed(found, {}, 1).parameters) == 1
    even = _replayed(found, {"traction": Interval(0.9, 1.1)}, 5).parameters[:, 0]
    np.testing.assert_array_equal(even, np.linspace(0.9, 1.1, 5))
