"""Values are changed in the text of a problem file, and nothing else in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from yaml.nodes import MappingNode, SequenceNode

from ensemble_ctrl.files.config.splice import SpliceError, put, removed, renamed
from ensemble_ctrl.files.config.tree import Tree
from tests.paths import ROOT

CONFIGS = sorted((ROOT / "configs").rglob("*.yaml"))
EVERY = 9
"""Every so many paths of a file are tried."""


def lines(text: str) -> set[str]:
    return set(text.splitlines())


@pytest.mark.parametrize("file", CONFIGS, ids=lambda file: file.stem)
def test_every_value_of_the_examples_can_be_changed_alone(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    tree = Tree.read(text)
    for path in list(tree.values)[1::EVERY]:
        node = tree.values[path]
        changed = put(text, path, 7.25)
        first, end = node.start_mark.index, node.end_mark.index
        assert changed.startswith(text[:first])
        assert changed.endswith(text[end:])
        comments = [line.partition("#")[2] for line in text[:first].splitlines() + text[end:].splitlines()]
        assert all(comment in changed for comment in comments)
        removed(text, path)
        if isinstance(node, MappingNode):
            put(text, (*path, "zz"), {"box": [[0, 1], [2, 3]]})
        elif isinstance(node, SequenceNode):
            put(text, (*path, len(node.value)), "3 deg")


def test_only_the_numbers_that_differ_are_written_anew() -> None:
    text = "o1: {box: [[2.0, 3.0], [1.50,  3.0]]}   # wide\n"
    assert put(text, ("o1", "box"), [[2.5, 3.0], [1.5, 3]]) == "o1: {box: [[2.5, 3.0], [1.50,  3.0]]}   # wide\n"


def test_new_sections_are_in_lines_and_entries_behind_the_last() -> None:
    text = put("version: 1  # of the format\n", ("obstacles", "o1"), {"box": [[0, 1], [2, 3]]})
    assert text == "version: 1  # of the format\nobstacles:\n  o1: {box: [[0, 1], [2, 3]]}\n"
    more = put(text + "\n# the end\n", ("obstacles", "o2"), {"wkt": "POLYGON ((0 0, 1 0, 1 1, 0 0))"})
    assert more.splitlines()[3:] == ['  o2: {wkt: "POLYGON ((0 0, 1 0, 1 1, 0 0))"}', "", "# the end"]
    assert put("", ("a", "b"), 1) == "a: {b: 1}\n"
    assert put("a:\n", ("a", "b"), 1) == "a: {b: 1}\n"
    assert put("a: 1", ("b",), True) == "a: 1\nb: true\n"


def test_an_entry_goes_with_its_line_and_its_empty_sections() -> None:
    text = "a: 1\nregions:   # places\n  goal: {box: [[0, 1], [2, 3]]}  # first\n"
    text += "  dock:\n    polygon:\n      - [0, 0]\nb: 2\n"
    one = removed(text, ("regions", "dock"))
    assert one == "a: 1\nregions:   # places\n  goal: {box: [[0, 1], [2, 3]]}  # first\nb: 2\n"
    assert removed(one, ("regions", "goal")) == "a: 1\nb: 2\n"
    assert removed("a: [1, 2, 3]\n", ("a", 0)) == "a: [2, 3]\n"
    assert removed("a: [1, 2, 3]\n", ("a", 2)) == "a: [1, 2]\n"
    assert removed("a:\n- 1  # one\n- 2\n", ("a", 1)) == "a:\n- 1  # one\n"


def test_names_change_in_place() -> None:
    assert renamed("a: {b: 1, c: 2} # x\n", ("a", "b"), "new name") == "a: {new name: 1, c: 2} # x\n"
    with pytest.raises(SpliceError, match="new one"):
        renamed("a: {b: 1, c: 2}\n", ("a", "b"), "c")


@pytest.mark.parametrize(
    "value",
    [
        "true",
        "null",
        "~",
        "1e3",
        ".5",
        "45 deg",
        "a: b",
        "x # y",
        "- z",
        "é\n\t",
        "",
        "'",
        '"',
        "{",
        "@x",
        "*a",
        " x",
        "yes",
    ],
)
def test_texts_stay_texts(value: str) -> None:
    assert Tree.read(put("a: 1\n", ("a",), value)).data == {"a": value}
    assert Tree.read(put("a: {b: 1}\n", ("a", value or "k"), "x")).data["a"][value or "k"] == "x"


@pytest.mark.parametrize(
    ("text", "path", "message"),
    [
        ("a: &x [1, 2]\nb: *x\n", ("b", 0), "can't be changed by itself"),
        ("a: [1\n", ("a", 0), "has to be mended first"),
        ("a: 1\na: 2\n", ("a",), "each key once"),
        ("a: [1, 2]\n", ("a", 5), "expected a place"),
        ("a: 3\n", ("a", "b"), "expected a place"),
        ("- 1\n", ("a",), "each key once"),
    ],
)
def test_what_can_not_be_changed_alone_is_refused(text: str, path: tuple[str | int, ...], message: str) -> None:
    with pytest.raises(SpliceError, match=message):
        put(text, path, 9)


def test_numbers_are_finite() -> None:
    with pytest.raises(SpliceError, match="finite"):
        put("a: 1\n", ("a",), float("nan"))
