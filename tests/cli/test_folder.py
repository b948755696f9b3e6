"""Where results go: nothing is overwritten unasked, and nothing half-written is ever left."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.cli import run as run_module
from ensemble_ctrl.core.storage import release
from ensemble_ctrl.files import folder as folder_module
from ensemble_ctrl.files.folder import FolderError, ResultsFolder

from .conftest import Command
from .tools import COMMAND, Outcome, environment, left

QUICK = ("small.yaml", "--no-plots", "-q")


def test_the_next_run_has_the_next_number(command: Command, place: Path) -> None:
    (place / "plans/small").mkdir(parents=True)
    for name in ("small-2", "small-3"):
        done = command(*QUICK, "--json")
        assert done.data["folder"] == f"plans/{name}"
    assert sorted(os.listdir(place / "plans")) == ["small", "small-2", "small-3"]


def test_two_runs_at_once_each_have_a_folder(place: Path) -> None:
    first, second = ResultsFolder(None, "twin"), ResultsFolder(None, "twin")
    for folder in (first, second):
        (folder.working / "plan.npz").write_text("x")
    assert [first.commit(), second.commit()] == [Path("plans/twin"), Path("plans/twin-2")]
    assert left(place / "plans") == ["twin", "twin-2", "twin-2/plan.npz", "twin/plan.npz"]
    third, fourth = ResultsFolder(None, "other"), ResultsFolder(None, "other")
    third.discard()
    fourth.discard()
    assert sorted(os.listdir(place / "plans")) == ["twin", "twin-2"]


def test_a_new_or_an_empty_folder_is_used(command: Command, place: Path) -> None:
    assert command(*QUICK, "-o", "a/b/c").code == 0
    (place / "empty").mkdir()
    inode = (place / "empty").stat().st_ino
    assert command(*QUICK, "-o", "empty").code == 0
    assert (place / "empty").stat().st_ino == inode
    assert set(os.listdir("empty")) == set(os.listdir("a/b/c"))
    assert not [name for name in left(place) if "/." in name or name.startswith(".")]


def test_the_working_directory_itself_if_it_is_empty(
    command: Command, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place / "here").mkdir()
    monkeypatch.chdir(place / "here")
    assert command("../small.yaml", "--no-plots", "-q", "-o", ".").code == 0
    assert "plan.npz" in os.listdir(".")
    assert ".." not in os.getcwd()


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("small.yaml", "small.yaml: expected a folder for the results, found a file"),
        ("small.yaml/x", "small.yaml/x: can't write results here (/"),
        ("/proc/x", "/proc/x: can't write results here"),
        (".", ".: this folder is not empty; choose another with -o"),
        ("n" * 300, "can't write results here (File name too long)"),
    ],
)
def test_a_folder_that_can_not_be_used_is_refused_before_solving(
    command: Command, place: Path, target: str, words: str
) -> None:
    before = left(place)
    done = command(*QUICK, "-o", target)
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("error: ")
    assert words in done.err
    assert left(place) == before


def test_a_file_called_plans(command: Command, place: Path) -> None:
    (place / "plans").write_text("mine")
    done = command(*QUICK)
    assert done.code == 2
    assert done.err == f"error: plans/small: can't write results here ({place}/plans is a file)\n"


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_permission(command: Command, place: Path) -> None:
    (place / "locked").mkdir(mode=0o500)
    done = command(*QUICK, "-o", "locked/x")
    assert done.code == 2
    assert "locked/x: can't write results here (Permission denied)" in done.err


def test_overwrite_replaces_earlier_results_only(command: Command, results: Path, place: Path) -> None:
    refused = command(*QUICK, "-o", "results")
    assert refused.code == 2
    assert "results: this folder is not empty; choose another with -o, or add --overwrite" in refused.err
    assert command(*QUICK, "-o", "results", "--overwrite", "--seed", "5").code == 0
    assert ec.Plan.load(results).problem.solve.seed == 5
    assert sorted(os.listdir(place)) == ["results", "small.yaml", "walled.yaml"]


def test_overwrite_never_removes_other_files(command: Command, results: Path, place: Path) -> None:
    (results / "notes.txt").write_text("mine")
    done = command(*QUICK, "-o", "results", "--overwrite")
    assert done.code == 2
    assert "--overwrite would remove notes.txt, which is not a result" in done.err
    (place / "other").mkdir()
    (place / "other/thesis.tex").write_text("mine")
    done = command(*QUICK, "-o", "other", "--overwrite")
    assert done.code == 2
    assert "found no plan.npz here" in done.err
    assert (results / "notes.txt").exists()
    assert (place / "other/thesis.tex").exists()


def test_overwrite_leaves_the_working_directory_alone(
    command: Command, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(results)
    done = command("problem.yaml", "-q", "-o", ".", "--overwrite")
    assert done.code == 2
    assert "--overwrite can't replace the working directory" in done.err


@pytest.mark.parametrize("kind", ["file", "folder", "cache"])
def test_overwrite_keeps_python_of_the_user_s_own(command: Command, results: Path, kind: str) -> None:
    mine = {"file": "analysis.py", "folder": "d.py/thesis.tex", "cache": "__pycache__/analysis.cpython-311.pyc"}[kind]
    (results / mine).parent.mkdir(exist_ok=True)
    (results / mine).write_text("mine")
    done = command(*QUICK, "-o", "results", "--overwrite")
    assert done.code == 2
    assert f"--overwrite would remove {Path(mine).parts[0]}, which is not a result" in done.err
    assert (results / mine).read_text() == "mine"


def test_overwrite_removes_a_folder_or_a_link_with_a_result_s_name_no_more_than_others(
    command: Command, results: Path, place: Path
) -> None:
    (results / "figure-controls.png").mkdir()
    assert "would remove figure-controls.png" in command(*QUICK, "-o", "results", "--overwrite").err
    (results / "figure-controls.png").rmdir()
    (results / "report.html").symlink_to(place / "small.yaml")
    assert "would remove report.html" in command(*QUICK, "-o", "results", "--overwrite").err


def test_overwrite_replaces_the_python_file_that_the_problem_names(results: Path) -> None:
    text = "fleet: {model: {python: own.py:Own}}\n"
    (results / "problem.yaml").write_text(text)
    (results / "own.py").write_text("class Own: ...")
    (results / "__pycache__").mkdir()
    (results / "__pycache__/own.cpython-311.pyc").touch()
    folder = ResultsFolder(results, overwrite=True)
    (folder.working / "plan.npz").touch()
    folder.commit()
    assert os.listdir(results) == ["plan.npz"]


def test_a_comparison_can_be_replaced(place: Path) -> None:
    (place / "compared").mkdir()
    (place / "compared/compare.json").touch()
    (place / "compared/compare.png").touch()
    folder = ResultsFolder(Path("compared"), overwrite=True)
    (folder.working / "compare.json").write_text("new")
    folder.commit()
    assert left(place / "compared") == ["compare.json"]


def test_files_that_came_while_the_plan_was_made_are_kept(results: Path) -> None:
    folder = ResultsFolder(results, overwrite=True)
    (folder.working / "plan.npz").write_text("new")
    (results / "notes.txt").write_text("mine")
    assert folder.commit().name == "results-2"
    assert (results / "notes.txt").exists()
    assert (results.parent / "results-2/plan.npz").read_text() == "new"


def test_a_place_that_was_taken_while_the_plan_was_made(place: Path) -> None:
    folder, inside = ResultsFolder(Path("x")), None
    (folder.working / "plan.npz").write_text("ours")
    (place / "x").mkdir()
    (place / "x/plan.npz").write_text("theirs")
    assert folder.commit() == Path("x-2")
    (place / "empty").mkdir()
    inside = ResultsFolder(Path("empty"))
    (inside.working / "plan.npz").write_text("ours")
    (place / "empty/plan.npz").write_text("theirs")
    assert inside.commit() == Path("empty-2")
    for name in ("x", "empty"):
        assert (place / name / "plan.npz").read_text() == "theirs"
        assert (place / f"{name}-2/plan.npz").read_text() == "ours"
    assert not [name for name in left(place) if ".ensemble" in name]


@pytest.mark.parametrize("there", ["nothing", "an empty folder", "earlier results"])
def test_a_place_is_taken_at_the_start(results: Path, place: Path, there: str) -> None:
    target = Path({"nothing": "new/x", "an empty folder": "empty", "earlier results": "results"}[there])
    (place / "empty").mkdir()
    first = ResultsFolder(target, overwrite=True)
    with pytest.raises(FolderError, match="another run is about to write its results here"):
        ResultsFolder(place / target, overwrite=True)
    first.discard()
    assert (place / target).exists() == (there != "nothing")
    ResultsFolder(target, overwrite=True).discard()


def test_the_next_run_removes_what_a_killed_one_left(place: Path) -> None:
    code = "import os\nfrom pathlib import Path\nfrom ensemble_ctrl.files.folder import ResultsFolder\n"
    code += "folder = ResultsFolder(Path('plans/x'))\n(folder.working / 'solver.log').touch()\nos.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code], cwd=place, env=environment(), timeout=60)
    assert len(list((place / "plans").iterdir())) == 1
    folder = ResultsFolder(Path("plans/y"))
    assert list((place / "plans").iterdir()) == [folder.working.resolve()]
    assert not list(folder.working.iterdir())
    folder.discard()


def without_exchange(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a file system that can't exchange two names."""

    def none(*_: object) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(folder_module, "exchange", none)


def test_earlier_results_are_still_there_if_they_can_not_be_replaced(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = ResultsFolder(results, overwrite=True)
    rename = os.rename

    def broken(source: Path, target: Path) -> None:
        if source == folder.working:
            raise OSError("no")
        rename(source, target)

    without_exchange(monkeypatch)
    monkeypatch.setattr(os, "rename", broken)
    with pytest.raises(OSError, match="no"):
        folder.commit()
    folder.discard()
    assert (results / "plan.npz").exists()
    assert not [name for name in os.listdir(results.parent) if name.startswith(".")]


def test_earlier_results_are_replaced_without_an_exchange_of_names(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_exchange(monkeypatch)
    folder = ResultsFolder(results, overwrite=True)
    (folder.working / "plan.npz").write_text("new")
    folder.commit()
    assert left(results) == ["plan.npz"]
    assert not [name for name in os.listdir(results.parent) if name.startswith(".")]


def test_a_kill_between_two_renames_is_mended_by_the_next_run(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = ResultsFolder(results, overwrite=True)
    rename = os.rename

    def killed(source: Path, target: Path) -> None:
        rename(source, target)
        raise SystemExit  # what comes after that rename does not happen

    without_exchange(monkeypatch)
    monkeypatch.setattr(os, "rename", killed)
    with pytest.raises(SystemExit):
        folder.commit()
    release(folder._held)
    monkeypatch.setattr(os, "rename", rename)
    assert not results.exists()
    with pytest.raises(FolderError, match="this folder is not empty"):
        ResultsFolder(results)
    assert (results / "plan.npz").exists()
    ResultsFolder(results, overwrite=True).discard()
    assert not [name for name in os.listdir(results.parent) if name.startswith(".")]


def test_a_link_to_a_folder_that_is_not_there_yet(command: Command, place: Path) -> None:
    (place / "link").symlink_to("elsewhere/results")
    assert command(*QUICK, "-o", "link").code == 0
    assert (place / "link").is_symlink()
    assert (place / "elsewhere/results/plan.npz").exists()
    (place / "loop").symlink_to("loop")
    done = command(*QUICK, "-o", "loop")
    assert done.code == 2
    assert "loop: can't write results here" in done.err


def test_nothing_is_written_through_the_links_of_a_foreign_folder(command: Command, results: Path, place: Path) -> None:
    mine = place / "mine.txt"
    mine.write_text("mine")
    names = [".report.html.part", ".animation.gif.part", ".again.npz.part", "figure-controls.png", "report.html"]
    for name in [*names, "animation.gif"]:
        (results / name).symlink_to(mine)
    assert command("report", "results").code == 0
    assert command("animate", "results", "--seconds", "0.2").code == 0
    assert command("plot", "results", "controls").code == 0
    ec.Plan.load(results).save(results / "again.npz")
    assert mine.read_text() == "mine"
    for name in ("figure-controls.png", "report.html", "animation.gif", "again.npz"):
        assert not (results / name).is_symlink()


def test_a_discarded_folder_leaves_nothing(place: Path) -> None:
    folder = ResultsFolder(Path("new/deep/results"))
    (folder.working / "solver.log").write_text("x")
    folder.discard()
    assert not (place / "new").exists()
    with pytest.raises(FolderError, match="found a file"):
        ResultsFolder(Path("small.yaml"))


def test_an_internal_error_leaves_nothing(command: Command, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(run_module, "plan", broken)
    before = left(place)
    done = command(*QUICK)
    assert done.code == 1
    assert done.err == ("error: internal error: ZeroDivisionError: oh (set ENSEMBLE_PLAN_DEBUG=1 for the traceback)\n")
    assert left(place) == before
    assert command(*QUICK, "--json").data["exit_code"] == 1
    monkeypatch.setenv("ENSEMBLE_PLAN_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        command(*QUICK)


def with_full_disk(place: Path, limit: int, *arguments: str) -> Outcome:
    """Run where no file may grow beyond `limit` bytes, as if the disk were full then."""

    def restrict() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run(
        [*COMMAND, *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        env=environment(MPLCONFIGDIR=os.environ.get("MPLCONFIGDIR", ""), PYTHONDONTWRITEBYTECODE="1"),
        preexec_fn=restrict,
        timeout=60,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def test_a_full_disk_does_not_lose_the_plan(place: Path) -> None:
    before = left(place)
    done = with_full_disk(place, 2000, *QUICK)
    assert done.code == 1
    assert "error: plans/small: the plan could not be written (File too large)" in done.err
    assert "Traceback" not in done.err
    assert left(place) == before
    text, _, table = done.out.partition("controls, since no file holds them:\n")
    assert text.startswith("small: plan found")
    assert table.splitlines()[0] == "t [s],v [m/s],omega [rad/s]"
    assert len(table.splitlines()) == 21


@pytest.mark.slow
def test_a_full_disk_with_json(place: Path) -> None:
    done = with_full_disk(place, 2000, *QUICK, "--json")
    assert done.code == 1
    assert len(done.data["controls"]) == 20
    assert done.data["folder"] is None
    assert "could not be written" in done.data["message"]


def test_a_disk_that_is_full_after_the_plan_keeps_the_plan(place: Path) -> None:
    done = with_full_disk(place, 16_000, "small.yaml", "-q")
    assert done.code == 1
    assert "plans/small: the plan is saved, but its figures could not be drawn (File too large)" in done.err
    assert ec.Plan.load(place / "plans/small").status == "planned"
    assert not list(place.rglob("*.png"))
    assert not list(place.rglob(".*"))


def test_figures_that_can_not_be_drawn_do_not_lose_the_plan(
    command: Command, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ensemble_ctrl.report import figures

    def broken(*_: object) -> Callable[[], None]:
        raise RuntimeError("no font")

    monkeypatch.setattr(figures, "write_figures", broken)
    done = command("small.yaml", "-q")
    assert done.code == 1
    assert "figures could not be drawn (RuntimeError: no font)" in done.err
    assert done.out.splitlines()[-1] == "  files      plans/small"
    assert (place / "plans/small/plan.npz").exists()
