"""A part of the campaign against the proof; ``make campaign`` runs all of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.certificate.enclosure import Flow
from tests.examples import quick

from .cases import of_family
from .judge import judge
from .membership import excluded
from .model import Floats
from .mutate import MARK, as_markdown, every_mutant, mutants
from .run import lines
from .survivors import reason_of, stale
from .table import MOST_OPEN, Table, read

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "proof_campaign.md"
SEED = 1000
CHUNKS, SIZE = 6, 100
MUTANTS = 100
"""That have to be tried, over all modules that prove."""


@pytest.mark.parametrize("chunk", quick(range(CHUNKS), 0))
def test_no_claim_is_false(chunk: int) -> None:
    table = Table(SEED)
    found = lines(SEED, range(chunk * SIZE, (chunk + 1) * SIZE))
    for line in found:
        table.add(line)
    assert [(line.index, line.faults) for line in found if line.faults] == []
    assert table.total["left open"] <= 2 * MOST_OPEN * table.total["decidable"]


@pytest.mark.parametrize(
    ("broken", "family"), [("growth", "bulging"), ("remainder", "tight"), ("rounding", "touching")]
)
def test_a_broken_proof_is_found_out(broken: str, family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = getattr(Flow, broken)
    monkeypatch.setattr(Flow, broken, lambda *args: 0 * whole(*args))
    cases = (of_family(family, np.random.default_rng([SEED, index])) for index in range(100))
    assert any(judge(case).faults for case in cases)


def test_mutants_are_of_the_code_as_it_is() -> None:
    names = [mutant.name for mutant in every_mutant()]
    assert len(names) == len(set(names)) >= 60
    assert stale(names) == []
    source = next(mutant.source for mutant in mutants("certificate/enclosure.py"))
    compile(source, "mutant", "exec")


def test_the_page_prints_the_result() -> None:
    table = Table.of_json((HERE / "result.json").read_text())
    assert not table.is_bad
    assert read(PAGE.read_text()) == table.as_markdown()


def test_the_page_prints_what_became_of_mutants() -> None:
    found = json.loads((HERE / "mutants.json").read_text())
    assert len(found) >= MUTANTS
    assert [name for name, killed in found.items() if not (killed or reason_of(name))] == []
    assert read(PAGE.read_text(), MARK) == as_markdown(found)


@pytest.mark.parametrize("chunk", quick(range(4), 0))
def test_membership_never_excludes_the_truth(chunk: int) -> None:
    assert [what for index in range(25 * chunk, 25 * chunk + 25) for what in excluded(SEED, index)] == []


def test_membership_without_drift_and_slips_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(commands: object, errors: object, factors: object, since: Floats, until: Floats) -> tuple[Floats, Floats]:
        return np.zeros(np.shape(since)), np.zeros(np.shape(since))

    monkeypatch.setattr("ensemble_ctrl.planning.online.membership.departure", none)
    assert any(list(excluded(SEED, index)) for index in range(100))


JUDGED_WRONGLY = {
    ("shares", 8056): "obstacles of a share were grown by the radius with sharp corners",
    ("nested", 20001): "the oracle's until went on to times at which only the beginning of its window fits",
    ("nested", 29580): "the same within always",
    ("shares", 23755): "the oracle did not see that members of a share drive through a region between two times",
    ("shares", 28151): "the same",
}


@pytest.mark.parametrize(("family", "index"), JUDGED_WRONGLY, ids=str)
def test_cases_that_were_judged_wrongly_once(family: str, index: int) -> None:
    rng = np.random.default_rng([0, index])
    rng.random()  # chose the family
    assert judge(of_family(family, rng)).faults == (), JUDGED_WRONGLY[family, index]
