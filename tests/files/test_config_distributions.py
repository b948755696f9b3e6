"""Distributions of the parameter in problem files: every form, there and back, and errors with line and column."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load, load_text, schema
from ensemble_ctrl.files.config.distributions import distribution_data
from ensemble_ctrl.moments import Beta, Distribution, Interval, Mixture, Samples, TruncatedNormal
from ensemble_ctrl.problem.checks import MAX_SAMPLES

NORMAL = "{range: [0.9, 1.1], distribution: normal, mean: 1.0, deviation: 0.03}"
FORMS: dict[str, Distribution] = {
    "{}": Interval(0.9, 1.1),
    "{range: [0.8, 1.1]}": Interval(0.8, 1.1),
    "{range: [0.9, 1.1], distribution: uniform}": Interval(0.9, 1.1),
    "{range: [0.9, 1.1], distribution: beta, a: 2, b: 5}": Beta(0.9, 1.1, 2, 5),
    "{distribution: beta, a: 0.5, b: 0.5}": Beta(0.9, 1.1, 0.5, 0.5),
    NORMAL: TruncatedNormal(0.9, 1.1, 1.0, 0.03),
    f"{{mixture: [{{range: [0.8, 0.9], weight: 2}}, {NORMAL}]}}": Mixture(
        (Interval(0.8, 0.9), 2), (TruncatedNormal(0.9, 1.1, 1.0, 0.03), 1)
    ),
    "{samples: [1.02, 0.95, 1.0, 1.0]}": Samples([0.95, 1.0, 1.0, 1.02]),
    "{samples: [1]}": Samples([1.0]),
    "{mixture: [{samples: [0.9, 1.0]}, {range: [1, 1.1], weight: 0.5}]}": Mixture(
        (Samples([0.9, 1.0]), 1), (Interval(1.0, 1.1), 0.5)
    ),
}
TABLES = {
    "plain": "0.95\n1.0\n1.02\n",
    "one named column": "whatever\n0.95\n1.0\n1.02\n",
    "with remarks": "# measured on Monday\n\n0.95\n# and on Tuesday\n 1.0 \n1.02",
    "several columns": "robot,traction,mass\n1,0.95,2\n2,1.0,2\n3,1.02,2\n",
    "semicolons": "robot;traction\n1;0.95\n2;1.0\n3;1.02\n",
    "tabs": "traction\trobot\n0.95\t1\n1.0\t2\n1.02\t3\n",
    "Windows": "\ufefftraction\r\n0.95\r\n1.0\r\n1.02\r\n",
    "quotes": '"traction","mass"\n"0.95","1"\n"1.0","1"\n"1.02","1"\n',
}


def text(distribution: str) -> str:
    """A problem with this distribution, on line 4 from column 15."""
    return f"""fleet:
  model: unicycle
  parameters:
    traction: {distribution}
  start: {{position: [0, 0], heading: 0}}
horizon: {{duration: 4 s}}
task: F[0, T] x >= 1
"""


def wrong(distribution: str, folder: Path) -> tuple[int | None, int | None, str, str, str]:
    """The one error of a problem with this distribution."""
    path = folder / "problem.yaml"
    path.write_text(text(distribution), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load(path)
    (error,) = caught.value.diagnostics
    field = error.path.removeprefix("fleet.parameters.traction")
    return error.line, error.column, field, error.message.replace(f"{folder}/", ""), error.hint


@pytest.mark.parametrize(("written", "distribution"), FORMS.items())
def test_every_form_is_read(written: str, distribution: Distribution) -> None:
    assert load_text(text(written)).fleet.parameters["traction"] == distribution


@pytest.mark.parametrize("written", FORMS)
def test_every_form_is_written_and_read_again(written: str) -> None:
    problem = load_text(text(written))
    again = load_text(dump(problem))
    assert again.fleet.parameters["traction"] == problem.fleet.parameters["traction"]
    assert dump(again) == dump(problem)


def test_the_uniform_distribution_is_written_as_before() -> None:
    assert distribution_data(Interval(0.9, 1.1)) == {"range": [0.9, 1.1]}


def test_mixtures_in_mixtures_are_written_flat() -> None:
    inner = Mixture((Interval(0.9, 1.0), 1), (Interval(1.0, 1.1), 3))
    distribution = Mixture((inner, 2), (Samples([1.0]), 2))
    parts = distribution_data(distribution)["mixture"]
    assert [part["weight"] for part in parts] == [0.5, 1.5, 2]
    psi = np.linspace(0.9, 1.1, 9)
    flat = load_text(text(str(distribution_data(distribution)))).fleet.parameters["traction"]
    np.testing.assert_allclose(flat.cdf(psi), distribution.cdf(psi), atol=1e-15)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_table_is_read_and_written_inline(table: str, tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_bytes(table.encode())
    (tmp_path / "problem.yaml").write_text(text("{samples: measured.csv}"))
    problem = load(tmp_path / "problem.yaml")
    assert problem.fleet.parameters["traction"] == Samples([0.95, 1.0, 1.02])
    assert "samples: [0.95, 1.0, 1.02]" in dump(problem)
    assert load_text(dump(problem)).fleet.parameters["traction"] == problem.fleet.parameters["traction"]


def test_a_table_in_a_mixture(tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_text("robot,traction\n1,0.95\n2,1.05\n")
    (tmp_path / "problem.yaml").write_text(text("{mixture: [{samples: measured.csv}, {range: [0.9, 1.1]}]}"))
    assert load(tmp_path / "problem.yaml").fleet.parameters["traction"] == Mixture(
        (Samples([0.95, 1.05]), 1), (Interval(0.9, 1.1), 1)
    )


CASES = {
    "{distribution: bta}": (30, ".distribution", "'bta' is not one of uniform, beta, normal", "did you mean 'beta'?"),
    "{distribution: beta, a: 2}": (
        30,
        ".distribution",
        "expected a and b for beta, but b is missing",
        "for example  b: 5",
    ),
    "{distribution: normal}": (
        30,
        ".distribution",
        "expected mean and deviation for normal, but mean is missing",
        "for example  mean: 1.0",
    ),
    "{a: 2}": (19, ".a", "expected no a for uniform", "a is for distribution: beta"),
    "{distribution: beta, a: 0, b: 1}": (39, ".a", "expected a number from 0.001 to 1e+06, got 0", ""),
    "{distribution: beta, a: 1, b: -1}": (45, ".b", "expected a number from 0.001 to 1e+06, got -1", ""),
    "{distribution: normal, mean: .nan, deviation: 1}": (44, ".mean", "expected a finite number, got .nan", ""),
    "{distribution: normal, mean: 1, deviation: 0}": (58, ".deviation", "expected a number above 0, got 0", ""),
    "{distribution: normal, mean: 99, deviation: 0.01}": (
        44,
        ".mean",
        "expected at most 1000 deviations outside of [0.9, 1.1], got 99",
        "",
    ),
    "{range: [-1, 1], distribution: beta, a: 1, b: 1}": (23, ".range", "expected a range above 0, got [-1, 1]", ""),
    "{mixture: []}": (25, ".mixture", "expected at least one distribution, got an empty list", ""),
    "{mixture: {range: [1, 2]}}": (25, ".mixture", "expected a list, got a section", ""),
    "{mixture: [{range: [1, 2], weight: 0}]}": (
        50,
        ".mixture[0].weight",
        "expected a number without a unit, above 0, got 0",
        "",
    ),
    "{mixture: [{range: [1, 2]}, {distribution: beta, a: 1}]}": (
        58,
        ".mixture[1].distribution",
        "expected a and b for beta, but b is missing",
        "for example  b: 5",
    ),
    "{mixture: [{rnge: [1, 2]}]}": (27, ".mixture[0].rnge", "unknown field", "did you mean 'range'?"),
    "{mixture: [{range: [1, 2]}], range: [1, 2]}": (
        51,
        ".range",
        "expected mixture without range",
        "leave one of them out",
    ),
    "{samples: [1], distribution: uniform}": (
        44,
        ".distribution",
        "expected samples without distribution",
        "leave one of them out",
    ),
    "{samples: [1, 2 m]}": (29, ".samples[1]", "expected a number without a unit, got '2 m', which is a length", ""),
    "{samples: [1, .nan]}": (29, ".samples[1]", "expected a finite number, got .nan", ""),
    "{samples: [1, 0]}": (29, ".samples[1]", "expected a number without a unit, above 0, got 0", ""),
}


@pytest.mark.parametrize(("written", "expected"), CASES.items())
def test_what_is_wrong_is_said_at_its_place(written: str, expected: tuple[int, str, str, str], tmp_path: Path) -> None:
    assert wrong(written, tmp_path) == (4, *expected)


EXAMPLE = "for example [0.95, 1.0, 1.02], or measured.csv with one number a line"
BAD_TABLES = {
    "text": ("0.95\nx\n", "measured.csv, line 2: expected a finite number above 0, got 'x'", ""),
    "negative": ("1\n\n-1\n", "measured.csv, line 3: expected a finite number above 0, got '-1'", ""),
    "NaN first": ("nan\n1\n", "measured.csv, line 1: expected a finite number above 0, got 'nan'", ""),
    "infinity": ("1\ninf\n", "measured.csv, line 2: expected a finite number above 0, got 'inf'", ""),
    "hole": ("a,traction\n1,\n", "measured.csv, line 2: expected a finite number above 0, got ''", ""),
    "ragged": ("a,traction\n1\n", "measured.csv, line 2: expected 2 cells, got 1", ""),
    "no names": (
        "1,2\n3,4\n",
        "measured.csv, line 1: expected a first line that names the columns, got 2 columns of numbers",
        "",
    ),
    "other names": (
        "a,tracton\n1,2\n",
        "measured.csv: expected a column 'traction', got a, tracton",
        "did you mean 'tracton'?",
    ),
    "empty": ("\n", "measured.csv: expected numbers, got an empty file", EXAMPLE),
    "names only": ("traction\n", "measured.csv: expected numbers below the names of the columns, got none", EXAMPLE),
    "an endless cell": (
        "1\n" + "1" * 200_000 + "\n",
        "measured.csv, line 2: expected cells, got what can't be read (field larger than field limit (131072))",
        "",
    ),
    "binary": ("\0\1", "measured.csv: expected a text file, got a binary one", ""),
    "too many": (
        "1\n" * (MAX_SAMPLES + 1),
        f"measured.csv: expected at most {MAX_SAMPLES} lines, got {MAX_SAMPLES + 1}",
        "keep every tenth, say: the distribution hardly changes",
    ),
    "too large": (
        "1.00000000\n" * 500_000,
        "measured.csv: expected at most 5 MB, got more",
        "keep every tenth, say: the distribution hardly changes",
    ),
}


@pytest.mark.parametrize(("table", "message", "hint"), BAD_TABLES.values(), ids=BAD_TABLES)
def test_what_is_wrong_with_a_table_is_said(table: str, message: str, hint: str, tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_text(table)
    assert wrong("{samples: measured.csv}", tmp_path) == (4, 25, ".samples", message, hint)
    assert wrong("{mixture: [{samples: measured.csv}]}", tmp_path) == (4, 36, ".mixture[0].samples", message, hint)


def test_a_table_that_is_missing(tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_text("1\n")
    expected = (4, 25, ".samples", "mesured.csv: no such file", "did you mean 'measured.csv'?")
    assert wrong("{samples: mesured.csv}", tmp_path) == expected


@pytest.mark.parametrize("name", ["../secret.csv", "/etc/passwd", "/dev/stdin", "/proc/self/environ", "link.csv"])
@pytest.mark.parametrize("key", ["{samples: NAME}", "{mixture: [{samples: NAME}]}"])
def test_a_table_elsewhere_is_not_read(name: str, key: str, tmp_path: Path) -> None:
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.csv").write_text("1\n")
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    *_, message, hint = wrong(key.replace("NAME", name), folder)
    assert message == f"expected a file in the same folder or below, got '{name}'"
    assert hint == "copy it there"


def test_measured_robots_elsewhere_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.csv").write_text("traction\n1\n")
    (tmp_path / "inner/problem.yaml").write_text(
        "fleet: {model: unicycle, samples: ../secret.csv, start: {position: [0, 0], heading: 0}}\n"
        "horizon: {duration: 1 s}\ntask: F x >= 1\n"
    )
    with pytest.raises(ConfigError, match=r"fleet\.samples: expected a file in the same folder or below, got"):
        load(tmp_path / "inner/problem.yaml")


def test_a_table_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert wrong("{samples: pipe}", tmp_path)[-2] == "expected the name of a file, got 'pipe', which is none"


def test_as_many_samples_as_allowed_are_written_and_read_again() -> None:
    values = np.random.default_rng(0).normal(1.0, 0.03, MAX_SAMPLES)
    problem = load_text(text("{}"))
    many = problem.with_(fleet=replace(problem.fleet, parameters={"traction": Samples(values)}))
    assert load_text(dump(many)).fleet.parameters["traction"] == Samples(values)


def test_a_problem_with_distributions_that_no_file_can_hold_is_refused() -> None:
    problem = load_text(text("{}"))
    for distribution, field in (
        (Samples(np.ones(MAX_SAMPLES + 1)), "samples: expected at most 40000 measured values, got 40001"),
        (Samples([-1.0, 1.0]), r"samples: expected a range above 0, got \[-1, 1\]"),
        (Mixture((Interval(-1.0, 1.0), 1)), r"mixture: expected a range above 0, got \[-1, 1\]"),
    ):
        with pytest.raises(ProblemError, match=rf"^fleet.parameters.traction.{field}"):
            problem.with_(fleet=replace(problem.fleet, parameters={"traction": distribution}))


def test_editors_know_the_fields() -> None:
    described = schema()["$defs"]["DistributionSection"]["properties"]
    assert set(described) == {"range", "distribution", "a", "b", "mean", "deviation", "numbers", "samples", "mixture"}
