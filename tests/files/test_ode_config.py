"""Problem files of systems defined by a differential equation: what is wrong with them, and where."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.files.config import schema
from ensemble_ctrl.systems import SYSTEMS

GOOD = """\
fleet:
  model: quadrotor
  settings: {mass: 6}
  parameters:
    payload: {range: [0, 0.5]}
  start: {position: [0, 0, 1]}
  input_bounds: {thrust: [0, 120]}
horizon: {duration: 1 s}
regions:
  goal: {box: [[1, 2], [-1, 1], [0.5, 2]]}
obstacles:
  wall: {halfspaces: [x >= 0.5, x <= 0.6, y >= -1, y <= 1, z >= 2, z <= 3]}
task: F in(goal) and G avoid(wall)
"""
SYSTEM = """\
from ensemble_ctrl import OdeSystem

class Cart(OdeSystem):
    name, states, positions = "cart", ("p", "v"), ("p",)
    controls, control_units, input_bounds = ("force",), ("N",), ((-1.0, 1.0),)
    parameters = {"mass": 1.0}

    def xdot(self, x, u, psi):
        return [x[1], u[0] / psi["mass"]]
"""
CART = """\
fleet: {model: {python: cart.py:Cart}, parameters: {mass: {range: [1, 2]}}}
horizon: {duration: 2 s}
regions: {goal: {box: [[0.2, 1]]}}
task: F in(goal) and G v <= 1
"""


def refused(text: str) -> str:
    """The errors of a text."""
    with pytest.raises(ec.ConfigError) as caught:
        ec.load_text(text, "bad.yaml")
    return str(caught.value)


def test_a_good_one() -> None:
    problem = ec.load_text(GOOD)
    assert isinstance(problem, ec.Problem)
    assert problem.fleet.position.tolist() == [0, 0, 1]
    assert problem.fleet.start_states(problem.fleet.center[None])[6, 0] == 1.0
    assert problem.fleet.input_upper.tolist() == [120, 2, 2, 0.5]
    assert (problem.steps, problem.verify.certificate) == (10, True)
    (wall,) = problem.obstacles["wall"]
    assert isinstance(wall, ec.Solid)
    assert len(wall.vertices) == 8


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass: 6", "mass: -6", "bad.yaml:3:20: error: fleet.settings.mass: expected a mass above 0 kg, got -6 kg"),
        (
            "mass: 6",
            "inertia: [1, 0, 1]",
            "bad.yaml:3:23: error: fleet.settings.inertia: expected three moments above 0",
        ),
        ("mass: 6", "weight: 6", "bad.yaml:3:22: error: fleet.settings.weight: unknown name"),
        ("mass: 6", "weight: 6", "hint: known here: mass, inertia, payload_arm"),
        ("payload:", "load:", "bad.yaml:5:11: error: fleet.parameters.load: unknown name"),
        ("payload:", "payloads:", "hint: did you mean 'payload'?"),
        ("[0, 0.5]", "[-7, 0.5]", "fleet.parameters.payload: expected a total mass above 0 kg, got -1 kg"),
        ("[0, 0.5]", "[a, b]", "fleet.parameters.payload.range[0]: expected a number without a unit, got 'a'"),
        ("position: [0, 0, 1]", "position: [0, 0]", "fleet.start.position: expected [x, y, z], got [0.0, 0.0]"),
        ("position: [0, 0, 1]", "height: 1", "fleet.start.height: unknown name"),
        ("position: [0, 0, 1]", "vx: fast", "fleet.start.vx: expected a number without a unit, got 'fast'"),
        ("thrust: [0, 120]", "thrust: [120, 0]", "where low is above high"),
        ("thrust: [0, 120]", "power: [0, 120]", "fleet.input_bounds.power: unknown name"),
        (
            "[[1, 2], [-1, 1], [0.5, 2]]",
            "[[1, 2], [-1, 1]]",
            "expected [[x low, x high], [y low, y high], [z low, z high]]",
        ),
        ("z >= 2", "w >= 2", "expected an inequality in x and y and z, got the unknown 'w'"),
        (", z >= 2, z <= 3", "", "obstacles.wall.halfspaces: expected a bounded polyhedron, got an unbounded set"),
        ("F in(goal)", "F in(goal) and vq >= 1", "expected the name of a state (x, y, z, vx, vy, vz, qw"),
        ("F in(goal)", "F in(gaol)", "did you mean 'goal'"),
        ("[0, 0, 1]", "[0.55, 0, 2.5]", "deep inside obstacle 'wall'"),
        ("F in(goal)", "F[0, 3] in(goal)", "expected a window that ends by 1 s"),
        (
            "model: quadrotor",
            "model: quadrator",
            f"'quadrator' is not one of {', '.join(SYSTEMS)}",
        ),
    ],
)
def test_mistakes_are_placed(old: str, new: str, message: str) -> None:
    assert message in refused(GOOD.replace(old, new, 1))


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (
            "solve: {method: minlp, grid: full}",
            "bad.yaml:14:30: error: solve.grid: this is not for the quadrotor",
        ),
        (
            "motions: {wall: {path: [[0, [0, 0]], [1, [1, 0]]]}}",
            "motions.wall: expected 3 dimensions (x, y, z), got 2",
        ),
        ("objective: {terminal: {target: [1, 2]}}", "objective.terminal.target: expected [x, y, z]"),
        (
            "objective: {terminal: {target: {payload: [[0, [1, 2]], [0.5, [1, 2]]]}}}",
            "objective.terminal.target.payload[0][1]: expected [x, y, z], got [1, 2]",
        ),
    ],
)
def test_what_is_not_for_such_fleets(extra: str, message: str) -> None:
    assert message in refused(GOOD + extra + "\n")


def test_several_errors_at_once() -> None:
    text = GOOD.replace("payload:", "load:").replace("duration: 1 s", "duration: 0 s")
    assert "2 errors in bad.yaml" in refused(text)


def write(folder: Path, system: str = SYSTEM, problem: str = CART) -> Path:
    """A problem with a system of one's own in a folder."""
    (folder / "cart.py").write_text(textwrap.dedent(system))
    path = folder / "cart.yaml"
    path.write_text(problem)
    return path


def test_a_file_is_run_with_consent_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    marker = tmp_path / "ran"
    path = write(tmp_path, f"open({str(marker)!r}, 'w').close()\n" + SYSTEM)
    with pytest.raises(ec.ConfigError) as caught:
        ec.load(path)
    assert "expected your consent to run cart.py" in str(caught.value)
    assert "1 error in" in str(caught.value)
    assert invoke(["check", str(path)]) == 2
    assert not marker.exists()
    assert invoke(["check", str(path), "--trust"]) == 0
    assert marker.exists()
    assert invoke(["check", str(path)]) == 2, "a consent ends with its call"
    capsys.readouterr()
    problem = ec.load(path, trust=True)
    assert problem.fleet.states == ("p", "v")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("../cart.py:Cart", "expected a file next to the problem file, got '../cart.py'"),
        ("/tmp/cart.py:Cart", "expected a file next to the problem file"),
        ("other.py:Cart", "other.py: no such file next to the problem file"),
        ("cart.py", "expected FILE.py:CLASS"),
        ("cart.txt:Cart", "expected FILE.py:CLASS"),
        ("cart.py:Car", "cart.py: expected a child of OdeSystem called Car, there is no such name"),
        ("cart.py:OTHER", "cart.py: expected a child of OdeSystem called OTHER, got int"),
        ("cart.py:Load", "cart.py: expected a child of OdeSystem called Load, got a class that is none"),
    ],
)
def test_files_that_are_not_run(tmp_path: Path, name: str, message: str) -> None:
    path = write(tmp_path, SYSTEM + "OTHER = 1\nclass Load:\n    pass\n", CART.replace("cart.py:Cart", f"'{name}'"))
    with pytest.raises(ec.ConfigError) as caught:
        ec.load(path, trust=True)
    assert message in str(caught.value)
    assert "cart.yaml:1:" in str(caught.value)


def test_a_link_to_elsewhere_is_not_followed(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    path = write(inner)
    (inner / "cart.py").rename(tmp_path / "cart.py")
    (inner / "cart.py").symlink_to(tmp_path / "cart.py")
    with pytest.raises(ec.ConfigError, match="expected a file next to the problem file"):
        ec.load(path, trust=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("class Cart", "class Cart(", "cart.py, line 3: SyntaxError"),
        ("from ensemble_ctrl", "1 / 0\nfrom ensemble_ctrl", "cart.py, line 1: ZeroDivisionError"),
        ('("p", "v"), ("p",)', '("p", "v"), ("q",)', "Cart.positions: expected one to three of the states"),
        ("return [x[1], u[0] /", "return [u[0] /", "Cart.xdot: expected 2 entries (p, v), got 1"),
        ("u[0] / psi", "u[0] / 0.0 * psi", "expected finite rates at the start, got nan for v"),
        ('psi["mass"]', 'psi["weight"]', "Cart.xdot can't be evaluated: KeyError: 'weight'"),
        ("x[1], u", "x[2], u", "Cart.xdot can't be evaluated: IndexError"),
    ],
)
def test_systems_with_mistakes(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = write(tmp_path, SYSTEM.replace(old, new, 1))
    with pytest.raises(ec.ConfigError) as caught:
        ec.load(path, trust=True)
    assert message in str(caught.value)


def test_a_line_has_regions_but_no_obstacles(tmp_path: Path) -> None:
    path = write(tmp_path, problem=CART + "obstacles: {o: {box: [[1, 2]]}}\n")
    with pytest.raises(ec.ConfigError, match="obstacles"):
        ec.load(path, trust=True)
    path = write(tmp_path, problem=CART.replace("G v <= 1", "G avoid(goal)"))
    with pytest.raises(ec.ConfigError, match="a position of one coordinate can't be kept out of places"):
        ec.load(path, trust=True)


def test_the_schema_knows_both_kinds_of_fleet() -> None:
    described: dict[str, Any] = schema()
    kinds = described["properties"]["fleet"]["oneOf"]
    assert {kind["$ref"].rsplit("/", 1)[1] for kind in kinds} == {"FleetSection", "SystemFleetSection"}
    assert "settings" in described["$defs"]["SystemFleetSection"]["properties"]
