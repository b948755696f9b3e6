"""Results folders of an earlier version load, and their plans are proven again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import differences
from ensemble_ctrl.certificate.record import claims_each
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.files.config.tree import Tree

SAVED = sorted(path.parent for path in (Path(__file__).parent / "saved").glob("*/plan.npz"))


@pytest.mark.parametrize("folder", SAVED, ids=lambda folder: folder.name)
def test_a_saved_plan_loads_and_is_proven_again(folder: Path) -> None:
    plan = ec.Plan.load(folder)
    recorded = json.loads((folder / "certificate.json").read_text())
    certificate = plan.certify(each=claims_each(recorded))
    assert (certificate.proven, certificate.inputs) == ("yes", recorded["inputs_sha256"])
    assert [bound.proven for bound in certificate.clearances] == pytest.approx(
        [bound["proven"] for bound in recorded["clearances"]], abs=1e-9
    )
    assert differences(recorded, certificate) == []
    assert plan.replay(members=200).satisfied == 1.0


def kept(saved: Any, today: Any) -> Any:
    """What today's data says under the keys of the saved data; keys that have come since are left out."""
    if isinstance(saved, dict) and isinstance(today, dict):
        return {key: kept(value, today.get(key)) for key, value in saved.items()}
    return today


@pytest.mark.parametrize("folder", SAVED, ids=lambda folder: folder.name)
def test_its_problem_file_is_the_same_problem(folder: Path) -> None:
    text = (folder / "problem.yaml").read_text()
    problem = ec.load_text(text)
    today, saved = (Tree.read(one).data for one in (dump(problem), text.replace("twin:", "baseline:")))
    assert kept(saved, today) == saved
    members = problem.fleet.spread(5)
    controls = ec.Plan.load(folder).controls
    own = ec.Plan.load(folder).problem.fleet.trajectories(controls, members, problem.step)
    np.testing.assert_array_equal(problem.fleet.trajectories(controls, members, problem.step), own)


def test_there_are_plans_of_every_kind_of_fleet() -> None:
    assert {ec.Plan.load(folder).problem.fleet.system.name for folder in SAVED} == {"unicycle", "planar_quadrotor"}


def test_details_of_an_earlier_version_have_their_name_of_today(tmp_path: Path) -> None:
    found = {"of": "duration", "value": 3.0, "bound": 2.0, "missed": None, "tried": 4}
    plan = replace(ec.Plan.load(SAVED[0] / "plan.npz"), details={"soonest": found, "cost": 1.0})
    plan.save(tmp_path / "plan.npz")
    assert ec.Plan.load(tmp_path / "plan.npz").details == {"minimum_time": found, "cost": 1.0}
