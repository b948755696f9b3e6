"""``verify``, ``compare`` and ``widest``."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.planning.ranges import Oracle, widened

from .conftest import Command
from .tools import FAST, SMALL


def test_a_run_writes_its_certificate_and_says_what_is_proven(results: Path) -> None:
    certificate = json.loads((results / "certificate.json").read_text())
    assert certificate["proven"] == "yes"
    assert certificate["clearance"] >= 0
    assert re.fullmatch("[0-9a-f]{64}", certificate["inputs_sha256"])
    assert json.loads((results / "summary.json").read_text())["verified"] is True


def test_verify_good_results(command: Command, results: Path) -> None:
    outcome = command("verify", "results")
    assert outcome.code == 0
    assert outcome.out.startswith("small: proven\n")
    assert "for every traction 0.9..1.1, every instant" in outcome.out
    assert "agree" in outcome.out
    assert command("verify", "results/plan.npz").code == 0


def test_verify_from_the_table_and_the_problem_alone(command: Command, results: Path) -> None:
    (results / "plan.npz").unlink()
    outcome = command("verify", "results", "--members", "50", "--json")
    assert outcome.code == 0
    assert outcome.data["certificate"]["proven"] == "yes"
    assert outcome.data["replay"]["members"] == 50


def test_each_obstacle_is_refined_on_demand_and_in_files_that_claim_it(command: Command, results: Path) -> None:
    far = SMALL.replace("obstacles:\n", "obstacles:\n  far: {box: [[1, 2], [4, 5]]}\n").replace("block)", "obstacles)")
    (results.parent / "far.yaml").write_text(far)
    assert command("far.yaml", "-q", "--no-plots", "-o", "far").code == 0
    quick, each = command("verify", "far", "--json"), command("verify", "far", "--each", "--json")
    assert (quick.code, each.code) == (0, 0)
    loose, tight = (one.data["certificate"]["clearances"][0]["proven"] for one in (quick, each))
    assert 0.5 <= loose < tight < 4
    claim = json.loads((results.parent / "far/certificate.json").read_text())
    assert claim["enough"] == 0.5
    (results.parent / "far/summary.json").unlink()
    # as releases before wrote it: every obstacle refined, and no word of it
    old = {name: value for name, value in each.data["certificate"].items() if name in claim and name != "enough"}
    (results.parent / "far/certificate.json").write_text(json.dumps(old))
    assert command("verify", "far").code == 0
    old["clearances"][0]["proven"] += 0.01
    (results.parent / "far/certificate.json").write_text(json.dumps(old))
    assert "certificate.json: it says clearances[0].proven" in command("verify", "far").err


def test_more_members_than_can_be_kept_are_for_another_command(command: Command, results: Path) -> None:
    outcome = command("verify", "results", "--members", "100000000")
    assert outcome.code == 2
    assert "--members: expected at most 10000000 members, each of which is kept, got 100000000" in outcome.err
    assert "use ensemble-plan replay results" in outcome.err


def test_another_range(command: Command, results: Path) -> None:
    wide = command("verify", "results", "--range", "traction=0.5:1.5")
    assert wide.code == 4
    assert "REFUTED" in wide.out
    assert re.search(r"traction \d\.\d+ violates .* by \d", wide.out)
    assert command("verify", "results", "--range", "traction=0.99:1.01").code == 0


@pytest.mark.parametrize("text", ["grip=0.9:1.1", "traction=0.9", "traction=a:b", "traction=1.1:0.9", "traction"])
def test_a_range_that_is_none(command: Command, results: Path, text: str) -> None:
    outcome = command("verify", "results", "--range", text)
    assert outcome.code == 2
    assert "traction=LOW:HIGH" in outcome.err
    assert text in outcome.err


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("task", "F in(elsewhere)"),
        ("name", "other"),
        ("steps", 7),
        ("step_seconds", 0.5000001),
        ("certificate.proven", "no"),
        ("certificate.clearance", 99.0),
        ("certificate.ranges.traction", [0.5, 1.5]),
        ("certificate.inputs_sha256", "0" * 64),
        ("certificate", "yes"),
    ],
)
def test_a_changed_summary_is_found_out(command: Command, results: Path, path: str, value: object) -> None:
    """A script reads the verdict there."""
    file = results / "summary.json"
    reported = json.loads(file.read_text())
    *inner, last = path.split(".")
    place = reported
    for name in inner:
        place = place[name]
    assert place[last] != value
    place[last] = value
    file.write_text(json.dumps(reported))
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "summary.json: it " in outcome.err


def test_a_summary_that_says_verified_is_compared_with_the_proof(command: Command, results: Path) -> None:
    """Without a certificate in it, too."""
    (results / "plan.npz").unlink()
    table = results / "controls.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    table.write_text("\n".join(",".join(row) for row in [rows[0], *([t, "0.0", "0.0"] for t, *_ in rows[1:])]) + "\n")
    (results / "certificate.json").unlink()
    file = results / "summary.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "certificate": None}))
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "summary.json: it says verified True, computed again: no" in outcome.err


def test_one_changed_control_is_found_out(command: Command, results: Path) -> None:
    table = results / "controls.csv"
    lines = table.read_text().splitlines()
    first = lines[1].split(",")
    lines[1] = ",".join([first[0], repr(float(first[1]) + 1e-6), first[2]])
    table.write_text("\n".join(lines) + "\n")
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "controls.csv holds other controls" in outcome.err
    (results / "plan.npz").unlink()
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "inputs_sha256 differs" in outcome.err


def test_what_older_releases_wrote_agrees(command: Command, results: Path) -> None:
    """Times with every digit, and no entry where there is nothing to say."""
    table, path = results / "controls.csv", results / "certificate.json"
    lines = table.read_text().splitlines()
    times = [float(line.split(",")[0]) for line in lines[1:]]
    assert all(len(line.split(",")[0]) <= 11 for line in lines[1:])
    apart = [f"{time * (1 + 1e-15)!r},{line.split(',', 1)[1]}" for time, line in zip(times, lines[1:], strict=True)]
    table.write_text("\n".join([lines[0], *apart]) + "\n")
    claim = json.loads(path.read_text())
    del claim["reason"]
    path.write_text(json.dumps(claim))
    assert command("verify", "results").code == 0
    del claim["clearances"]
    path.write_text(json.dumps(claim))
    assert command("verify", "results").code == 4


def test_an_edited_bound_is_found_out(command: Command, results: Path) -> None:
    path = results / "certificate.json"
    claim = json.loads(path.read_text())
    claim["clearances"][0]["proven"] += 1e-3
    path.write_text(json.dumps(claim))
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "computed again" in outcome.err
    assert outcome.out.startswith("small: FILES DISAGREE; from the commands in plan.npz: proven\n")
    assert "DISAGREE, see below" in outcome.out


def test_a_certificate_with_an_entry_twice_is_found_out(command: Command, results: Path) -> None:
    """Some readers take the first one, and Python the last."""
    path = results / "certificate.json"
    path.write_text(path.read_text().replace("{", '{"clearance": 9.9, ', 1))
    assert command("verify", "results").code == 4


@pytest.mark.parametrize(
    ("section", "found"),
    [
        ("input_bounds: {v: [0, 0.3]}", "v is 0.4 at t = 1 s, input bounds 0 to 0.3"),
        ("rate_bounds: {v: 0.5}", "the change of v is 1/s at t = 1 s, rate bounds -0.5 to 0.5"),
    ],
)
def test_commands_beyond_the_bounds_are_named(command: Command, place: Path, section: str, found: str) -> None:
    kind = section[: section.index("_")]
    folder = place / "fast"
    folder.mkdir()
    rows = [f"{0.2 * k},{0.4 if k > 4 else 0.2},0.0" for k in range(20)]
    (folder / "controls.csv").write_text("\n".join(["t [s],v [m/s],omega [rad/s]", *rows]) + "\n")
    (folder / "problem.yaml").write_text(
        "fleet:\n  model: unicycle\n  start: {position: [0, 0], heading: 0, heading_from: x}\n"
        f"  {section}\nhorizon: {{duration: 4, steps: 20}}\ntask: F x >= 1\n"
    )
    outcome = command("verify", "fast")
    assert outcome.code == 4
    assert f"proven, but beyond the {kind} bounds at t = 1 s" in outcome.out
    assert found in outcome.out
    data = command("verify", "fast", "--json").data
    assert (data["verified"], data["exit_code"]) == (False, 4)
    assert (data["beyond_bounds"]["control"], data["beyond_bounds"]["time"]) == ("v", 1.0)
    ignored = command("verify", "fast", "--ignore-bounds")
    assert ignored.code == 0
    assert f"{found} (ignored)" in ignored.out


def test_an_edited_problem_is_found_out(command: Command, results: Path) -> None:
    path = results / "problem.yaml"
    path.write_text(path.read_text().replace("radius: 0.0", "radius: 0.01"))
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "problem.yaml is another problem" in outcome.err


@pytest.mark.parametrize("content", ["", "[1, 2]", '{"proven": "yes"}', "not json"])
def test_a_damaged_certificate_is_no_certificate(command: Command, results: Path, content: str) -> None:
    (results / "certificate.json").write_text(content)
    assert command("verify", "results").code == 4


def test_verify_what_is_not_there(command: Command, place: Path) -> None:
    outcome = command("verify", "nowhere")
    assert outcome.code == 2
    assert "expected a saved plan" in outcome.err


def test_an_unproven_plan_ends_with_four(command: Command, results: Path) -> None:
    unsafe = np.zeros((20, 2))
    unsafe[:, 0] = 0.6
    (results / "plan.npz").unlink()
    rows = [f"{0.2 * k},{v},{w}" for k, (v, w) in enumerate(unsafe)]
    (results / "controls.csv").write_text("\n".join(["t [s],v [m/s],omega [rad/s]", *rows]) + "\n")
    (results / "certificate.json").unlink()
    outcome = command("verify", "results")
    assert outcome.code == 4
    assert "avoid(block)" in outcome.out


@pytest.mark.slow
def test_compare_prints_one_row_a_guarantee(command: Command, place: Path) -> None:
    outcome = command("compare", "small.yaml", "-q")
    assert outcome.code == 0
    rows = {line[:15].strip(): line for line in outcome.out.splitlines()[2:7]}
    assert set(rows) == {"moment", "moment, minlp", "nodes", "hull", "hull, minlp"}
    assert all(" 0 (0.0 %)" in rows[name] for name in ("hull", "hull, minlp"))
    assert (place / "plans" / "small-compare" / "compare.png").read_bytes().startswith(b"\x89PNG")
    data = json.loads((place / "plans" / "small-compare" / "compare.json").read_text())
    assert [row["guarantee"] for row in data["rows"]] == ["moment", "moment", "nodes", "hull", "hull"]
    assert [row["method"] for row in data["rows"]] == ["nlp", "minlp", "nlp", "nlp", "minlp"]
    assert [row["violating"] for row in data["rows"][3:]] == [0, 0]


def test_a_range_that_the_checks_refuse_has_no_plan() -> None:
    reported: list[bool] = []
    oracle, fleet = Oracle(load_text(SMALL), tell=lambda _, good: reported.append(good)), load_text(SMALL).fleet
    assert oracle.certified(widened(fleet, {"traction": 0.95})) is None, "the slowest robot can't be there in time"
    assert (reported, oracle.tried, oracle.failed) == ([False], 1, [])


def test_compare_leaves_out_what_is_not_for_the_problem(command: Command, place: Path) -> None:
    (place / "moving.yaml").write_text(SMALL + "motions: {block: {velocity: [0, -0.1]}}\n")
    outcome = command("compare", "moving.yaml", "-q", "--no-plots")
    assert outcome.code == 0, outcome.err
    rows = outcome.out.splitlines()
    assert [row.split()[0] for row in rows[2:5]] == ["moment", "nodes", "hull"]
    assert rows[5].startswith("moment, minlp  left out: solve.method: minlp is for obstacles that stand still")
    data = json.loads((place / "plans" / "small-compare" / "compare.json").read_text())
    assert list(data["left_out"]) == ["moment, minlp", "hull, minlp"]


def test_widest_names_the_range_and_what_blocks(command: Command, place: Path) -> None:
    outcome = command("widest", "small.yaml", *FAST, "--tolerance", "0.2", "--json", "-q")
    assert outcome.code == 0
    low, high = outcome.data["widest"]
    assert low < 0.9
    assert high > 1.1
    assert low + high == pytest.approx(2.0)


def test_widest_box_of_two_parameters(command: Command, place: Path) -> None:
    offsets = "  parameters: {start_x: {range: [-0.1, 0.1]}, start_y: {range: [-0.1, 0.1]}}\n  start: {position"
    text = SMALL.replace("  start: {position", offsets).replace(
        "F[3, 4] in(goal) and G avoid(block)", "G[3, 4] in(goal)"
    )
    (place / "offsets.yaml").write_text(text)
    outcome = command("widest", "offsets.yaml", "--box", "start_x", "--box", "start_y", "--json", "-q")
    assert outcome.code == 0, outcome.err
    box = {name: (high - low) / 2 for name, (low, high) in outcome.data["box"].items()}
    assert 0.4 < box["start_x"] <= 0.5  # members keep their offsets: the box fits into the goal, 1 m by 1 m
    assert 0.4 < box["start_y"] <= 0.5
    assert outcome.data["curve"][0]["start_y"] >= 0.0
    refused = command("widest", "offsets.yaml", "--box", "start_x")
    assert refused.code == 2
    assert "--box: expected two of the fleet's (start_x, start_y), got start_x" in refused.err
    for option, value in (("--parameter", "start_x"), ("--tolerance", "0.1")):
        both = command("widest", "offsets.yaml", "--box", "start_x", "--box", "start_y", option, value)
        assert both.code == 2
        assert f"{option}: expected none with --box" in both.err


def test_widest_writes_its_plan_and_the_picture_of_a_box(command: Command, place: Path) -> None:
    pair = "  parameters: {traction: {range: [0.98, 1.02]}, start_y: {range: [-0.02, 0.02]}}\n  start: {position"
    text = SMALL.replace("  start: {position", pair)
    (place / "pair.yaml").write_text(text)
    outcome = command("widest", "pair.yaml", "--box", "traction", "--box", "start_y", "-o", "boxed", "--json", "-q")
    assert outcome.code == 0, outcome.err
    assert outcome.data["folder"] == "boxed"
    assert (place / "boxed" / "box.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((place / "boxed" / "widest.json").read_text())["box"] == outcome.data["box"]
    verified = command("verify", "boxed")
    assert verified.code == 0
    assert max(map(len, verified.out.splitlines())) <= 120
    assert outcome.data["box"]["traction"][1] > 1.02


@pytest.mark.slow
def test_widest_without_any_plan(command: Command, place: Path) -> None:
    outcome = command("widest", "walled.yaml", *FAST, "--tolerance", "0.1", "-q")
    assert outcome.code == 3
    assert "no certified plan for any range" in outcome.out
    assert "blocked" in outcome.out
