"""The plan in Python: save and load, one-line texts, drawings, and failures that carry the plan."""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import ensemble_ctrl as ec
from ensemble_ctrl.ocp.solvers import Iteration

SMALL = """
name: small
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 4 s, steps: 20}
regions:
  goal: {box: [[1.5, 2.5], [-0.5, 0.5]]}
obstacles:
  block: {box: [[0.8, 1.2], [-0.3, 0.1]]}
task: F[3, 4] in(goal) and G avoid(block)
verify: {members: 200}
"""


@pytest.fixture(scope="module")
def problem() -> ec.Problem:
    return ec.load_text(SMALL)


@pytest.fixture(scope="module")
def plan(problem: ec.Problem) -> ec.Plan:
    return ec.plan(problem)


def straight(problem: ec.Problem) -> ec.Plan:
    """Through the obstacle."""
    return ec.Plan(problem, np.tile([0.6, 0.0], (problem.steps, 1)), "infeasible")


def test_a_plan_is_verified_by_its_replay(plan: ec.Plan) -> None:
    assert plan.verified
    assert plan.status == "planned"
    assert plan.controls.shape == (20, 2)
    assert plan.replayed is not None
    assert plan.replayed.members == 200
    assert not plan.conflicts()
    with pytest.raises(ValueError, match="read-only"):
        plan.controls[0, 0] = 1


def test_save_and_load(plan: ec.Plan, tmp_path: Path) -> None:
    file = plan.save(tmp_path / "mine")
    assert file == tmp_path / "mine.npz"
    for name in (file, str(file), tmp_path / "mine"):
        again = ec.Plan.load(name)
        assert np.array_equal(again.controls, plan.controls)
        assert (again.status, again.details) == (plan.status, plan.details)
        assert repr(again.problem) == repr(plan.problem)
        assert again.replayed is None
        assert not again.verified
    with np.load(file, allow_pickle=False) as data:
        assert set(data.files) == {"controls", "problem", "facts"}
        for key in data.files:
            assert data[key].dtype != object
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]


def test_a_failed_save_leaves_the_earlier_file(plan: ec.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = plan.save(tmp_path / "mine.npz")
    before = file.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        plan.save(file)
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]


def test_load_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(ec.ProblemError, match=r"none\.npz: expected a saved plan, found no such file"):
        ec.Plan.load(tmp_path / "none.npz")
    np.savez(tmp_path / "evil.npz", controls=np.array([print], dtype=object), problem="", facts="{}")
    with pytest.raises(ec.ProblemError, match=r"evil\.npz: expected a plan\.npz of this package"):
        ec.Plan.load(tmp_path / "evil.npz")


def test_a_small_file_that_unpacks_to_much_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    """60 MB of zeros, or a header that speaks of 8 TB, in a file of some kilobytes."""
    shape = "{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }"
    for size, count in ((60_000_000, 7_000_000), (80, 10**12)):
        header = (shape % count).ljust(117) + "\n"
        content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(size)
        with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            for name in ("controls", "problem", "facts"):
                archive.writestr(f"{name}.npy", content)
        assert (tmp_path / "bomb.npz").stat().st_size < 1_000_000
        del content
        tracemalloc.start()
        with pytest.raises(ec.ProblemError, match=r"bomb\.npz: expected a plan\.npz of this package"):
            ec.Plan.load(tmp_path / "bomb.npz")
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 10_000_000


def test_a_plan_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "plan.npz")
    with pytest.raises(ec.ProblemError, match=r"plan\.npz: can't be read \(this is a pipe or a device"):
        ec.Plan.load(tmp_path)


@pytest.mark.parametrize(
    ("controls", "status", "words"),
    [
        (np.zeros((19, 2)), "planned", r"controls: expected \(20, 2\)"),
        (np.full((20, 2), np.nan), "planned", "controls: expected .* finite"),
        (np.zeros((20, 2)), "good", "status: expected one of planned, infeasible, limit, interrupted, got 'good'"),
    ],
)
def test_a_plan_checks_its_parts(problem: ec.Problem, controls: np.ndarray, status: str, words: str) -> None:
    with pytest.raises(ec.ProblemError, match=words):
        ec.Plan(problem, controls, status)  # type: ignore[arg-type]


def test_texts_are_one_line(plan: ec.Plan, problem: ec.Problem) -> None:
    for thing in (plan, straight(problem), problem, plan.replayed):
        assert "\n" not in repr(thing)
        assert len(repr(thing)) < 160
    assert repr(plan).startswith("Plan('small': planned, cost ")
    assert repr(plan).endswith("20 steps, 0 of 200 members violate, proven for all: yes)")
    assert repr(straight(problem)) == "Plan('small': infeasible, 20 steps, not replayed)"


def drawing(html: str) -> ElementTree.Element:
    """The SVG in a notebook's card; the whole card has to be well-formed."""
    card = ElementTree.fromstring(html)
    [found] = card.iter("{http://www.w3.org/2000/svg}svg")
    return found


def test_a_notebook_shows_the_plan_and_before_it_the_map(plan: ec.Plan, problem: ec.Problem) -> None:
    tag = "{http://www.w3.org/2000/svg}"
    card = drawing(plan._repr_html_())
    assert len(list(card.iter(f"{tag}polyline"))) == 9
    assert len(list(card.iter(f"{tag}polygon"))) == 2
    before = drawing(problem._repr_html_())
    assert not list(before.iter(f"{tag}polyline"))
    assert len(list(before.iter(f"{tag}polygon"))) == 2
    assert "no member of 200 violates" in plan._repr_html_()
    assert "violated" in straight(problem)._repr_html_()


def test_a_notebook_is_sent_no_markup_from_a_file() -> None:
    text = SMALL.replace("name: small", "name: a b").replace("block", "blo-ck")
    problem = ec.load_text(text)
    drawing(problem._repr_html_())
    drawing(straight(problem)._repr_html_())


def test_drawings_of_odd_maps() -> None:
    unbounded = ec.load_text(SMALL.replace("{box: [[1.5, 2.5], [-0.5, 0.5]]}", "{halfspaces: [x >= 1.5]}"))
    empty = ec.load_text("""
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0}}
        horizon: {duration: 2 s, steps: 10}
        task: F[0, T] x >= 1
    """)
    flat = ec.load_text(SMALL.replace("[[0.8, 1.2], [-0.3, 0.1]]", "[[8, 90], [-0.3, 0.1]]"))
    for problem in (unbounded, empty, flat):
        found = drawing(problem._repr_html_())
        assert 0.2 < float(found.attrib["height"]) / float(found.attrib["width"]) < 2.1
        straight(problem).plot(ax=Figure().subplots())


def test_plot_draws_on_given_axes(plan: ec.Plan) -> None:
    ax = Figure().subplots()
    assert plan.plot(ax=ax) is ax
    assert [len(c.get_segments()) for c in ax.collections if isinstance(c, LineCollection)] == [21]
    assert ax.get_xlabel() == "x [m]"


def test_plot_makes_axes_and_shows_nothing(plan: ec.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    plt.switch_backend("agg")
    monkeypatch.setattr(plt, "show", pytest.fail)
    before = plt.get_fignums()
    ax = plan.plot()
    assert isinstance(ax, Axes)
    [number] = set(plt.get_fignums()) - set(before)
    assert ax.get_figure() is plt.figure(number)
    plt.close(number)


def test_plot_needs_no_display(plan: ec.Plan, tmp_path: Path) -> None:
    file = plan.save(tmp_path / "plan.npz")
    code = (
        "import sys, ensemble_ctrl as ec; ax = ec.Plan.load(sys.argv[1]).plot();"
        "assert 'casadi' not in sys.modules;"
        "ax.get_figure().savefig(sys.argv[2])"
    )
    subprocess.run([sys.executable, "-c", code, str(file), str(tmp_path / "a.png")], check=True, env=headless())
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def headless() -> dict[str, str]:
    """An environment without a display."""
    import os

    source = str(Path(ec.__file__).parents[1])
    plain = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MPLBACKEND")}
    return {**plain, "PYTHONPATH": source, "MPLCONFIGDIR": str(mpl.get_cachedir())}


def test_a_failure_carries_its_plan() -> None:
    problem = ec.load_text(SMALL.replace("F[3, 4] in(goal)", "F[3, 4] in(goal)") + "solve: {time_limit: 1 ms}\n")
    with pytest.raises(ec.SolveError, match="small: the plan falls short") as caught:
        ec.plan(problem)
    found = caught.value.plan
    assert isinstance(found, ec.Plan)
    assert found.status == "limit"
    assert isinstance(found.plot(ax=Figure().subplots()), Axes)
    assert ec.plan(problem, check=False).status == "limit"


def test_a_plan_can_be_a_guess(plan: ec.Plan, problem: ec.Problem) -> None:
    again = ec.plan(problem, guess=plan)
    assert len(again.details["routes"]) == 1
    assert again.details["cost"] <= plan.details["cost"] + 1e-3


def test_an_unfinished_search_is_not_verified_by_luck(plan: ec.Plan) -> None:
    from dataclasses import replace

    assert not replace(plan, status="infeasible").verified
    assert replace(plan, status="limit").verified


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = (
        "import sys, ensemble_ctrl as ec; ec.load_text; ec.Plan;"
        "print([n for n in ('casadi', 'scipy', 'matplotlib', 'shapely') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=headless())
    assert done.stdout == "[]\n", done.stderr


def test_what_people_type_is_at_the_top_whatever_was_imported_before() -> None:
    code = """
import ensemble_ctrl.api.comparison, ensemble_ctrl.api.widening, ensemble_ctrl as ec
for name in ("certify", "compare", "widest", "parse", "Receding", "Certificate", "plan", "load", "replay"):
    assert callable(getattr(ec, name)), name
assert set(ec.__all__) == {*ec._HOMES, *ec.__all__} and all(hasattr(ec, name) for name in ec.__all__)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_replay_is_a_function_whatever_was_imported_before(plan: ec.Plan) -> None:
    code = """
import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation.sampled import Replay, replay
assert ec.replay is replay and Replay is ec.Replay
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    run = ec.replay(plan.problem, plan.controls, members=5)
    np.testing.assert_array_equal(run.robustness, plan.replay(5).robustness)


def test_the_package_is_the_command() -> None:
    run = subprocess.run([sys.executable, "-m", "ensemble_ctrl", "--version"], capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip().endswith(ec.__version__)) == (0, True)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda what: pickle.loads(pickle.dumps(what))])
def test_a_problem_and_a_plan_are_copied_and_stay_read_only(plan: ec.Plan, again: Callable[[ec.Plan], ec.Plan]) -> None:
    other = again(plan)
    assert repr(other) == repr(plan)
    assert other.verified
    assert other.problem.obstacles.keys() == plan.problem.obstacles.keys()
    assert np.array_equal(other.problem.fleet.lower, plan.problem.fleet.lower)
    for array in (other.controls, other.problem.fleet.position, other.problem.obstacles["block"][0].A):
        assert not array.flags.writeable
    with pytest.raises(TypeError):
        other.problem.regions["more"] = None  # type: ignore[index]


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_problems_are_planned_in_a_pool(plan: ec.Plan, method: str) -> None:
    with multiprocessing.get_context(method).Pool(1) as pool:
        (found,) = pool.map(ec.plan, [plan.problem])
    assert found.verified
    assert np.allclose(found.controls, plan.controls, atol=1e-6)


def test_a_fleet_of_a_differential_equation_is_pickled() -> None:
    fleet = ec.Fleet(ec.DoubleIntegrator(), {"mass": ec.Interval(1.0, 2.0)}, start={"vx": 1.0})
    again = pickle.loads(pickle.dumps(fleet))
    assert (again.start, again.names) == ({"vx": 1.0}, ("mass",))


def test_ctrl_c_ends_a_plan_beside_another_thread(problem: ec.Problem) -> None:
    """As in a notebook: with another thread everything is solved in this process."""
    solving, seen = threading.Event(), []

    def interrupt() -> None:
        solving.wait()
        os.kill(os.getpid(), signal.SIGINT)

    def progress(_: str, iteration: Iteration | None) -> bool:
        seen.append(iteration)
        if iteration is not None and iteration.count == 2:
            solving.set()
        return False

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        ec.plan(problem.with_(steps=400, order=8), progress=progress)
    thread.join()
    assert seen


def test_examples_by_name() -> None:
    assert ec.examples()["five_obstacles"].startswith("Five obstacles")
    assert ec.example("yard").obstacles
    with pytest.raises(ec.ProblemError, match="did you mean 'five_obstacles'"):
        ec.example("five_obstacle")
