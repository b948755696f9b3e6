"""``report``, ``plot`` and ``animate``: where files go, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from .conftest import Command


def test_report_is_written_into_the_results(command: Command, results: Path) -> None:
    done = command("report", "results")
    assert (done.code, done.out) == (0, "results/report.html\n")
    text = (results / "report.html").read_text(encoding="utf-8")
    assert "<p>Proven: every robot" in text
    assert "Convergence" in text  # from solver.log
    assert "<dt>command</dt>" in text  # from provenance.json


def test_report_with_what_the_plan_tolerates(command: Command, results: Path) -> None:
    title = "<h2>Tolerated errors of the model</h2>"
    command("report", "results")
    assert title not in (results / "report.html").read_text(encoding="utf-8")
    done = command("report", "results", "--tolerance")
    assert (done.code, done.out) == (0, "results/report.html\n")
    assert done.err.startswith("tolerance: drift of the position\n")
    text = (results / "report.html").read_text(encoding="utf-8")
    _, _, section = text.partition(title)
    measured = json.loads(command("tolerance", "results", "--json", "-q").out)
    kinds = [*measured["kinds"], measured["mix"]]
    assert re.findall(r"<li><span>(.*?)</span>", section) == [one["kind"] for one in kinds]
    for ends, one in zip(re.findall(r"<small>then (.*?)</small>", section), kinds, strict=True):
        assert ends.startswith(one["ends"])


def test_an_attack_of_a_report_adds_to_its_tolerances(command: Command, results: Path) -> None:
    done = command("report", "results", "--attack")
    assert (done.code, done.err) == (2, "error: --attack: expected with --tolerance, which it adds to\n")


def test_report_of_a_plan_of_its_own(command: Command, results: Path, place: Path) -> None:
    shutil.copy(results / "plan.npz", place / "mine.npz")
    assert command("report", "mine.npz").out == "mine.html\n"
    assert "Convergence" not in (place / "mine.html").read_text(encoding="utf-8")
    assert command("report", "mine.npz", "-o", "other.html").out == "other.html\n"
    (results / "provenance.json").write_text("{", encoding="utf-8")
    assert command("report", "results").code == 0


def test_report_that_can_not_be_written(command: Command, results: Path) -> None:
    done = command("report", "results", "-o", "nowhere/a.html")
    assert (done.code, done.err) == (1, "error: nowhere/a.html: No such file or directory\n")
    done = command("report", "small.yaml")
    assert done.code == 2
    assert "expected a plan.npz" in done.err


def test_plot_writes_all_kinds_beside_the_plan(command: Command, results: Path) -> None:
    done = command("plot", "results")
    assert done.code == 0
    assert len(done.out.splitlines()) == 7
    assert all(Path(line).read_bytes().startswith(b"\x89PNG") for line in done.out.splitlines())


@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        (("moments", "-o", "a.pdf"), ["a.pdf"]),
        (("moments", "-o", "a"), ["a.png"]),
        (("moments", "-o", "a", "--format", "svg"), ["a.svg"]),
        (("moments", "controls", "moments", "-o", "b"), ["b/figure-moments.png", "b/figure-controls.png"]),
    ],
)
def test_plot_goes_where_it_is_told(
    command: Command, results: Path, arguments: tuple[str, ...], written: list[str]
) -> None:
    done = command("plot", "results", *arguments)
    assert (done.code, done.out.splitlines()) == (0, written)
    assert all(Path(name).is_file() for name in written)


SVG = ("--format", "svg")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("moment",),
            "moment: expected kinds among trajectories, controls, moments, robustness, clearance, spread, "
            "certificate; did you mean 'moments'?",
        ),
        (("moments", "-o", "a.gif"), "a.gif: expected a name that ends in .png, .pdf or .svg"),
        (
            ("moments", "-o", "a.pdf", "--format", "svg"),
            "a.pdf: expected a name that ends in .svg, or another --format",
        ),
        (("moments", "controls", "-o", "a.pdf"), "a.pdf: expected a folder for 2 pictures, got a file's name"),
        (("--format", "bmp"), "--format: expected one of png, pdf, svg, got bmp"),
    ],
)
def test_plot_refuses(command: Command, results: Path, arguments: tuple[str, ...], message: str) -> None:
    done = command("plot", "results", *arguments)
    assert (done.code, done.err) == (2, f"error: {message}\n")


def test_animate(command: Command, results: Path) -> None:
    done = command("animate", "results", "--seconds", "0.5")
    assert (done.code, done.out) == (0, "results/animation.gif\n")
    assert (results / "animation.gif").read_bytes().startswith(b"GIF89a")
    done = command("animate", "results", "-o", "a.avi")
    assert (done.code, done.err) == (2, "error: a.avi: expected an animation as .gif or .mp4\n")


def test_run_animates_and_overwrites_pictures(command: Command, results: Path) -> None:
    assert command("plot", "results", "controls").code == 0
    run = ("small.yaml", "-q", "--guess", "results", "-o", "results", "--overwrite")
    done = command(*run, "--no-plots", "--animate", "gif")
    assert done.code == 0, done.err
    assert (results / "animation.gif").is_file()
    assert not (results / "figure-controls.png").exists()
    done = command(*run, "--animate", "avi")
    assert (done.code, done.err) == (2, "error: --animate avi: expected an animation as .gif or .mp4\n")


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("report", "results", "-o", "mine.txt"), "mine.txt"),
        (("report", "mine.npz"), "mine.html"),
        (("animate", "mine.npz", "--seconds", "0.2"), "mine.gif"),
        (("plot", "results", "controls", "-o", "mine"), "mine.png"),
        (("plot", "mine.npz", "moments", "controls"), "figure-controls.png"),
        (("plot", "results", "moments", "controls", "-o", "pictures"), "pictures/figure-controls.png"),
        (("report", "results", "-o", "results/notes.html"), "results/notes.html"),
    ],
)
def test_a_file_that_no_run_wrote_is_not_replaced_unasked(
    command: Command, results: Path, place: Path, arguments: tuple[str, ...], name: str
) -> None:
    shutil.copy(results / "plan.npz", place / "mine.npz")
    file = place / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("mine", encoding="utf-8")
    done = command(*arguments)
    assert (done.code, done.err) == (2, f"error: {name}: this exists already; add --overwrite to replace it\n")
    assert file.read_text(encoding="utf-8") == "mine"
    assert command(*arguments, "--overwrite").code == 0
    assert file.read_bytes() != b"mine"


def test_pictures_of_a_results_folder_are_drawn_again(command: Command, results: Path) -> None:
    for arguments in (
        ("report", "results"),
        ("plot", "results", "controls"),
        ("animate", "results", "--seconds", "0.2"),
    ):
        assert (command(*arguments).code, command(*arguments).code) == (0, 0)
    assert command("report", "results", "-o", "results/report.html").code == 0
