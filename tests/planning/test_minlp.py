"""``solve.method: minlp`` from end to end: never worse than the NLP, whatever becomes of Bonmin."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
import ensemble_ctrl.ocp.mixed as module
import ensemble_ctrl.ocp.solvers.bonmin as bonmin_module
from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import summary, to_json
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import load, load_text
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.rounds import start
from ensemble_ctrl.ocp.solvers import SOLVERS, Iteration, Nlp, Outcome, Status
from ensemble_ctrl.planning.planner import Solution, coarse_fine, positions, solve
from ensemble_ctrl.planning.planner.proving import certified_with_margin
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.report import summary_lines
from tests.examples import quick
from tests.paths import CONFIGS

CONFIG = CONFIGS / "minlp" / "three_obstacles_minlp.yaml"
SMALL = """
name: small
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
horizon: {duration: 8 s, steps: 20}
moments: {order: auto}
regions:
  goal: {box: [[3, 4], [-0.5, 0.5]]}
obstacles:
  post: {box: [[1.4, 2], [-1, 0.3]]}
task: F[6, 8] in(goal) and G avoid(post)
objective: {terminal: {target: [3.5, 0]}}
solve: {method: minlp}
"""


@cache
def small() -> Problem:
    return load_text(SMALL)


def options(problem: Problem, **changes: Any) -> Problem:
    """The problem with other solve options."""
    return problem.with_(solve=replace(problem.solve, **changes))


@cache
def by_nlp(guarantee: str = "hull") -> Solution:
    return solve(options(small(), method="nlp", guarantee=guarantee))


def check_no_worse(solution: Solution, before: Solution) -> None:
    """At most the NLP's cost, by the same account, no less proven, and no member violates."""
    assert solution.status == before.status == "planned"
    assert solution.nlp is not None
    assert solution.nlp.value.cost == pytest.approx(before.attempt.value.cost, abs=1e-9)
    own = evaluate(solution.problem, solution.controls, solution.attempt.truncation)
    assert own.cost == pytest.approx(solution.attempt.value.cost, abs=1e-9)
    assert own.cost <= before.attempt.value.cost + 1e-9
    if before.certificate is not None and before.certificate.proven == "yes":
        assert solution.certificate is not None
        assert solution.certificate.proven == "yes"
        assert not replay(solution.problem, solution.controls, members=500, substeps=10).violating.any()


@pytest.mark.parametrize("guarantee", quick(["hull", "nodes", "moment"], "hull"))
def test_it_is_never_worse_than_the_nlp(guarantee: str) -> None:
    solution = solve(options(small(), guarantee=guarantee))
    check_no_worse(solution, by_nlp(guarantee))
    names = [r.name for r in solution.rounds]
    assert names[:3] == ["hyperplanes chosen again", "hyperplanes on the coarse grid", "facets fixed"]
    assert any(r.binaries for r in solution.rounds), "Bonmin had nothing to do"
    kept = [r.attempt.value.cost for r in solution.rounds if r.kept and r.attempt is not None]
    assert kept == sorted(kept, reverse=True)


@pytest.mark.slow
def test_three_obstacles_get_cheaper() -> None:
    problem = load(CONFIG)
    assert problem.solve.method == "minlp"
    solution = solve(problem)
    assert solution.nlp is not None
    assert solution.attempt.value.cost < solution.nlp.value.cost
    assert solution.certificate is not None
    assert solution.certificate.proven == "yes"


def test_the_report_says_what_improved_and_what_a_gap_is_worth(tmp_path: Path) -> None:
    found = plan(small())
    facts = json.loads(to_json(summary(found)))["details"]["minlp"]
    assert facts["cost"] <= facts["nlp_cost"]
    assert {"name", "status", "nodes", "switches", "bound", "gap", "kept"} <= set(facts["rounds"][0])
    assert "not convex" in facts["note"]
    text = "\n".join(summary_lines(found))
    assert "minlp      cost " in text
    assert "(nlp)" in text
    assert "no proof of optimality: the problem is not convex" in text
    again = Plan.load(found.save(tmp_path / "plan"))
    assert again.details["minlp"] == found.details["minlp"]
    assert "minlp" not in "\n".join(summary_lines(ec.plan(options(small(), method="nlp"))))


def test_nothing_to_keep_out_of_is_just_the_nlp() -> None:
    free = small().with_(task=parse("F[6, 8] in(goal)"))
    solution = solve(free)
    assert solution.status == "planned"
    assert [r.name for r in solution.rounds] == ["hyperplanes chosen again"]


def test_no_binaries_left_is_just_the_nlp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        module.OFFERED, "near", dict.fromkeys(["facets fixed", "again"], lambda s, g, m: module.best(s, g))
    )
    solution = solve(small())
    check_no_worse(solution, by_nlp())
    assert solution.rounds[-1].message == "nothing to choose"
    assert not any(r.binaries for r in solution.rounds)


def test_facets_that_no_plan_keeps_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the left of the post in one step and to its right in the next."""

    def torn(sides: Any, gaps: Any, margin: float) -> Any:
        odd = np.arange(gaps.shape[1]) % 2 == 1
        return np.where(odd, sides.normal[:, :1] > 0.5, sides.normal[:, :1] < -0.5)

    monkeypatch.setitem(module.OFFERED, "near", {"impossible": torn})
    solution = solve(small())
    check_no_worse(solution, by_nlp())
    assert solution.rounds[-1].status == "infeasible"
    assert "fall short by" in solution.rounds[-1].message


@pytest.mark.parametrize("end", quick([signal.SIGKILL, signal.SIGSEGV], signal.SIGKILL))
def test_a_bonmin_that_dies_costs_nothing(end: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    started = bonmin_module._started

    def killed(*files: Any) -> Any:
        child = started(*files)
        child.send_signal(end)
        return child

    monkeypatch.setattr(bonmin_module, "_started", killed)
    solution = solve(small())
    check_no_worse(solution, by_nlp())
    failed = [r for r in solution.rounds if r.binaries]
    assert failed
    assert all(r.status == "failed" and end.name in r.message for r in failed)
    assert end.name in "\n".join(summary_lines(plan(small())))


def test_an_answer_that_breaks_the_constraints_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Straight through the post, for less: neither Bonmin's word nor its cost counts."""

    class Lies:
        statuses: Mapping[str, Status] = {}

        def solve(self, nlp: Nlp, *_: Any) -> Outcome:
            wrong = nlp.guess.copy()
            wrong[: len(wrong) // 50] = 0.0
            return Outcome("solved", wrong, -100.0, 1, "success", -100.0)

    monkeypatch.setitem(SOLVERS, "bonmin", Lies())
    monkeypatch.setattr(
        module, "improve", lambda problem, controls, truncation, *_: start(problem, controls, truncation)
    )
    solution = solve(small())
    check_no_worse(solution, by_nlp())
    assert not any(r.kept for r in solution.rounds if r.binaries)


def test_a_cheaper_plan_of_which_less_is_proven_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    certified = certified_with_margin
    seen: list[float] = []

    def doubted(search: Any, attempt: Any, tightened: Any) -> Any:
        attempt, certificate, work = certified(search, attempt, tightened)
        seen.append(attempt.value.cost)
        return attempt, replace(certificate, proven="undecided") if len(seen) > 1 else certificate, work

    for part in (positions, coarse_fine):
        monkeypatch.setattr(part, "certified_with_margin", doubted)
    solution = solve(small())
    assert len(seen) > 1
    assert min(seen[1:]) < seen[0]
    assert not any(r.kept for r in solution.rounds)
    check_no_worse(solution, by_nlp())


def test_the_time_limit_counts_for_all_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bonmin_module, "OWN_SHARE", 1000.0)
    problem = options(small().with_(steps=160), time_limit=1.0)
    solution = solve(problem)
    assert np.isfinite(solution.controls).all()
    assert sum(solution.seconds.values()) < 4.0
    assert solution.status in ("planned", "limit")


def test_it_can_be_interrupted_while_bonmin_runs() -> None:
    seen: list[str] = []

    def progress(phase: str, iteration: Iteration | None) -> bool:
        if iteration is not None and iteration.bound is not None:
            seen.append(phase)
        return bool(seen)

    solution = solve(small(), progress=progress)
    assert solution.status == "interrupted"
    assert solution.nlp is not None
    assert solution.attempt.value.cost <= by_nlp().attempt.value.cost + 1e-9
    assert solution.attempt.value.keeps(0.0)
