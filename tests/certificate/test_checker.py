"""``python -m ensemble_ctrl.certificate``: the same verdict from plain data, with NumPy alone."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.files.config import to_data
from ensemble_ctrl.problem.plain import problem_of, proven_part
from tests.paths import CONFIGS, ROOT
from tests.test_trusted import lines_of_code

FILES = sorted(CONFIGS.rglob("*.yaml"))
ALONE = """\
import runpy, sys
for name in ("scipy", "casadi", "pydantic", "yaml", "shapely", "matplotlib", "typer", "PIL", "numba"):
    sys.modules[name] = None
sys.argv = ["check", sys.argv[1]]
try:
    runpy.run_module("ensemble_ctrl.certificate", run_name="__main__")
finally:
    print(*(module.__file__ for name, module in sys.modules.items() if name[:14] == "ensemble_ctrl."), file=sys.stderr)
"""
TASK = """\
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}, parameters: {traction: {range: [0.95, 1.05]}}}
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1, 2], [-0.5, 0.5]]}}
obstacles: {crate: {polygon: [[0.9, 0.6], [1.1, 0.6], [1.0, 0.9]]}}
task: F[3, 4] in(goal) and G avoid(crate)
"""


def data_of(problem: ec.Problem) -> dict[str, Any]:
    part = proven_part(to_data(problem)) | {"horizon": {"duration": problem.duration, "steps": problem.steps}}
    found: dict[str, Any] = json.loads(to_json(part))
    return found


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from ensemble_ctrl.api.results import write_results

    folder = tmp_path_factory.mktemp("plan")
    write_results(ec.plan(ec.load_text(TASK, "task")), folder, ["ensemble-plan"])
    return folder


def alone(folder: Path) -> tuple[int, str, str]:
    """The checker in a process that has no other library."""
    done = subprocess.run([sys.executable, "-c", ALONE, folder], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_plain_data_are_the_same_problem(path: Path) -> None:
    problem = ec.load(path)
    again = problem_of(data_of(problem))
    still = np.zeros((problem.steps, len(problem.fleet.input_lower)))
    first, second = (fingerprint(one, still, one.fleet.parameters) for one in (problem, again))
    assert first == second


def test_a_plan_is_proven_again_with_numpy_alone(saved: Path) -> None:
    code, out, loaded = alone(saved)
    assert (code, out.splitlines()[0]) == (0, "proven: yes, for traction 0.95..1.05, every instant")
    assert "certificate.json says the same" in out
    files = [Path(name) for name in loaded.split()]
    assert not {"files", "ocp", "cli", "planning"} & {file.parent.name for file in files}
    counted = sum(lines_of_code(file.read_text(encoding="utf-8")) for file in files)
    page = (ROOT / "docs" / "proof_limits.md").read_text(encoding="utf-8")
    most = re.search(r"at most ([\d,]+) lines of code in all", page)
    assert most is not None
    assert 0.8 * int(most[1].replace(",", "")) < counted <= int(most[1].replace(",", ""))


def changed(saved: Path, folder: Path, name: str, old: str, new: str) -> Path:
    """A copy of a plan in which one text of one file is another."""
    copy = Path(shutil.copytree(saved, folder / "copy"))
    text = (copy / name).read_text(encoding="utf-8")
    assert old in text
    (copy / name).write_text(text.replace(old, new, 1), encoding="utf-8")
    return copy


def test_other_controls_are_other_inputs(saved: Path, tmp_path: Path) -> None:
    first = json.loads((saved / "proof_input.json").read_text(encoding="utf-8"))["controls"][0][0]
    code, out, _ = alone(changed(saved, tmp_path, "proof_input.json", repr(first), repr(first + 1e-9)))
    assert code == 4
    assert "inputs_sha256 differs" in out


def test_a_certificate_that_claims_more_is_found(saved: Path, tmp_path: Path) -> None:
    claimed = json.loads((saved / "certificate.json").read_text(encoding="utf-8"))["clearance"]
    code, out, _ = alone(changed(saved, tmp_path, "certificate.json", repr(claimed), repr(claimed + 0.001)))
    assert code == 4
    assert "certificate.json says something else:" in out


def test_every_bound_of_an_error_is_read_back() -> None:
    bounds = ec.Uncertainty(
        {"position": 0.001, "heading": 0.002},
        {"omega": 0.003},
        {"v": 0.01, "omega": 0.02},
        {"v": 0.004},
        {"traction": 0.03},
        delay=0.1,
        jitter=0.005,
        heading_hold=2.0,
    )
    problem = ec.load_text(TASK, "task")
    data = data_of(problem.with_(fleet=problem.fleet.with_(uncertainty=bounds)))
    assert problem_of(data).fleet.uncertainty.data() == bounds.data()
    data["fleet"]["uncertainty"]["actuators"]["v"]["offset"] = 0.1
    with pytest.raises(ProblemError, match=r"^fleet.uncertainty.actuators.v: expected absolute and share, got"):
        problem_of(data)
    del data["fleet"]["uncertainty"]["actuators"]
    data["fleet"]["uncertainty"]["wind"] = 0.1
    with pytest.raises(ProblemError, match="wind"):
        problem_of(data)


def test_a_fleet_that_says_more_is_refused() -> None:
    data = data_of(ec.load_text(TASK, "task"))
    data["fleet"]["wind"] = 3
    with pytest.raises(ProblemError, match=r"^fleet: expected the keys model, .*, got 'wind'$"):
        problem_of(data)


MORE: dict[str, tuple[tuple[str | int, ...], object, str]] = {
    "section": (("walls",), {}, r"^problem: expected the keys name, .*, got 'walls'$"),
    "horizon": (("horizon", "until"), 3.0, r"^horizon: expected the keys duration, steps, got 'until'$"),
    "half a step": (("horizon", "steps"), 20.5, r"^horizon.steps: expected 1 or more, got 20.5"),
    "start": (("fleet", "start", "speed"), 3.0, r"^fleet.start: expected the keys position, .*, got 'speed'$"),
    "parameter": (("fleet", "parameters", "traction", "span"), [0, 9], r"^fleet.parameters: .*, got 'span'$"),
    "footprint": (("fleet", "footprint"), {"polygon": [[0, 0], [1, 0], [0, 1]], "length": 9}, r"got 'length'$"),
    "two shapes of a region": (("regions", "goal", "disc"), {}, r"^regions: expected one of box, .* got box, disc$"),
    "two shapes of an obstacle": (("obstacles", "crate", 0, "box"), [], r"^a shape: expected one of .* polygon, box$"),
    "zone": (("zones", "slow"), {"box": [[5, 6], [5, 6]], "v": 0.3, "speed": 0.1}, r"^zones: .* got box, speed$"),
    "zone of two": (("zones", "slow"), {"box": [[5, 6], [5, 6]], "areas": [], "v": 0.3}, r"^zones: .* box, areas$"),
    "terrain": (("terrain", "mud"), {"box": [[5, 6], [5, 6]], "polygon": [], "traction": [0.9, 1]}, r"^terrain: "),
    "half-plane": (("obstacles", "crate"), [{"halfspaces": ["x + 5*z >= 1"]}], r"^halfspaces: .* got 'z'$"),
    "motion": (("motions", "crate"), {"path": [[0, [0, 0]], [4, [1, 0]]], "until": 3}, r"^motions: .* got 'until'$"),
}  # fmt: skip
"""What a reader could take for a part of the claim, though it is none: where it is put in, and what the error says."""


@pytest.mark.parametrize("name", MORE)
def test_a_problem_that_says_more_is_refused(name: str) -> None:
    place, value, message = MORE[name]
    data: Any = data_of(ec.load_text(TASK, "task"))
    data["obstacles"]["crate"] = [data["obstacles"]["crate"]]
    inner = data
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with pytest.raises(ProblemError, match=message):
        problem_of(data)


def test_a_name_that_is_given_twice_is_refused(saved: Path, tmp_path: Path) -> None:
    copy = changed(saved, tmp_path, "proof_input.json", '"task":', '"task": "G (x >= 100)", "task":')
    code, out, err = alone(copy)
    assert (code, out) == (2, "")
    assert "can't be read (a name is given twice, among name, fleet," in err


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "can't be read"),
        ("[]", "expected an object with problem and controls"),
        ('{"problem": {}, "controls": [[0, 0]]}', "expected a problem as it is written beside a certificate"),
        ('{"problem": {"fleet": {"model": "own.py:Robot"}}, "controls": 1}', "fleet.model: expected one of unicycle"),
    ],
)
def test_what_is_no_input_is_named(saved: Path, tmp_path: Path, content: str, message: str) -> None:
    copy = Path(shutil.copytree(saved, tmp_path / "copy"))
    (copy / "proof_input.json").write_text(content, encoding="utf-8")
    code, out, err = alone(copy)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err
