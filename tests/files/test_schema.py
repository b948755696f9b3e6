"""The JSON Schema that editors use: kept equal to the models, true of every problem file, and described throughout."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ensemble_ctrl.cli.init import schema_text
from ensemble_ctrl.files.config import load, schema
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.problem.arguments.units import WANTED, pattern, quantity
from tests.paths import ROOT

jsonschema = pytest.importorskip("jsonschema")

STORED = ROOT / "schema" / "problem.schema.json"
CONFIGS = sorted((ROOT / "configs").rglob("*.yaml"))
FIVE = ROOT / "configs" / "five_obstacles.yaml"
BARE = ["1", "-1.5", "1e3", ".5", "1.", "m", "", "1 2", "one", "0x10", "1,5", "+2e-3 "]
WITH_A_UNIT = [" 2 m ", "2m", "3 deg", "3deg", "5 km/h", "5 km / h", "2 rad/s", "1 m/rad", "4 min", "4 mins", "7 s/m"]


def complaints(data: Any) -> list[str]:
    """What an editor would underline."""
    return [error.message for error in jsonschema.Draft202012Validator(schema()).iter_errors(data)]


def test_the_stored_schema_is_that_of_the_models() -> None:
    assert STORED.read_text(encoding="utf-8") == schema_text(), (
        "run: ensemble-plan schema -o schema/problem.schema.json"
    )


def test_it_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(schema())


def test_every_field_says_what_it_means() -> None:
    sections = {"ProblemFile": schema(), **schema()["$defs"]}
    silent = [
        f"{section}.{name}"
        for section, described in sections.items()
        for name, field in described["properties"].items()
        if not field.get("description", "").endswith(".")
    ]
    assert silent == [], "give these fields a sentence below them, in config/"
    assert (
        sections["Horizon"]["properties"]["duration"]["description"]
        == "Duration of the plan, `T` in the task; or `{at_most: ..., at_least: ...}` for minimum time."
    )


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_problem_file_names_it_and_agrees_with_it(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    named = re.match(r"# yaml-language-server: \$schema=(\S+)\n# \S", text)
    assert named is not None, "the first line names the schema, the second begins with a title"
    assert (path.parent / named[1]).resolve() == STORED
    assert complaints(yaml.safe_load(text)) == []


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("fleet.model", "unicicle"),
        ("fleet.colour", "red"),
        ("fleet.radius", -0.1),
        ("fleet.radius", "5 deg"),
        ("fleet.start.position", [1, 2, 3]),
        ("fleet.start.heading", "45 dge"),
        ("fleet.input_bounds.v", ["1 rad/s", 2]),
        ("fleet.parameters.traction.distribution", "gauss"),
        ("horizon.duration", 0),
        ("moments.order", 51),
        ("moments.order", "automatic"),
        ("solve.routes", 0),
        ("solve.method", "milp"),
        ("verify.certificate", "yes"),
        ("obstacles.o1.circle", [1, 2]),
        ("obstacles.o1.box", [[1, 2]]),
    ],
)
def test_it_refuses_what_the_reader_refuses(path: str, value: Any) -> None:
    data = yaml.safe_load(FIVE.read_text(encoding="utf-8"))
    assert complaints(data) == []
    *parents, last = path.split(".")
    section = data
    for name in parents:
        section = section.setdefault(name, {})
    section[last] = value
    assert complaints(data)
    with pytest.raises(Exception, match=re.escape(parents[0])):
        load(FIVE, [f"{path}={json.dumps(value)}"])


@pytest.mark.parametrize("kind", WANTED)
@pytest.mark.parametrize(
    "text",
    [*BARE, *WITH_A_UNIT],
)
def test_a_text_with_a_unit_matches_exactly_when_it_is_read(kind: str, text: str) -> None:
    try:
        quantity(kind)(text)
    except FieldError:
        assert not re.search(pattern(kind), text)
    else:
        assert re.search(pattern(kind), text)


def test_the_schema_says_what_it_is_the_schema_of() -> None:
    described = schema()
    assert described["$id"] == f"urn:ensemble-ctrl:problem-file:{described['properties']['version']['default']}"
