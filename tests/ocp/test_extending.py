"""Parts of the optimal-control program that are added from outside the package, each in under 40 lines."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.guesses import GUESSES, Guess, Request
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.parametrisation import PARAMETRISATIONS, Entry, Iterate, parametrise
from ensemble_ctrl.ocp.positions import Positions
from ensemble_ctrl.ocp.solvers import SOLVERS, Nlp, Outcome, Solver, SolverOptions, Status, Watch
from ensemble_ctrl.ocp.truncation import choose, points
from ensemble_ctrl.planning.planner import solve

from .problems import five

Floats = NDArray[np.float64]


def near(**options: Any) -> ec.Problem:
    """Five obstacles, of which only the first is left."""
    problem = five()
    obstacles = dict(list(problem.obstacles.items())[:1])
    how = replace(problem.solve, **({"routes": 1} | options))
    return problem.with_(obstacles=obstacles, steps=40, task=parse("F in(goal) and G avoid(obstacles)"), solve=how)


@dataclass
class Twice:
    """A solver of one's own: IPOPT, and again from what it found with another barrier."""

    inner: Solver
    calls: int = 0

    @property
    def statuses(self) -> Mapping[str, Status]:
        return self.inner.statuses

    def solve(self, nlp: Nlp, options: SolverOptions, watch: Watch | None = None) -> Outcome:
        self.calls += 1
        first = self.inner.solve(nlp, options, watch)
        return self.inner.solve(replace(nlp, guess=first.x), replace(options, barrier=1e-4), watch)


def test_a_solver_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = Twice(SOLVERS["ipopt"])
    monkeypatch.setitem(SOLVERS, "twice", mine)
    monkeypatch.setattr(parallel, "endable", lambda: False)
    assert solve(near(solver="twice")).status == "planned"
    assert mine.calls > 0
    with pytest.raises(ec.ProblemError, match="expected one of ipopt, sqp, bonmin, twice, got thrice"):
        solve(near(solver="thrice"))


class Halves:
    """Guesses of one's own: straight ahead for a part of the time."""

    at_once = True

    def accepts(self, problem: ec.Problem) -> bool:
        return problem.fleet.system.name == "unicycle"

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        ahead = np.arange(request.steps) < request.steps // 2
        yield [Guess(np.column_stack([ahead * 1.0, ahead * 0.0]), name="half the time", kind="mine")]


def test_guesses_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(GUESSES, "halves", Halves())
    found = solve(near())
    assert [(route.name, route.kind) for route in found.routes][-1] == ("half the time", "mine")
    monkeypatch.delitem(GUESSES, "routes")
    alone = solve(near())
    assert [route.kind for route in alone.routes] == ["mine"]
    assert alone.status == "planned"


class NodePositions(Positions):
    """A choice of variables of one's own: where the Gauss-node robots are, in place of the points around them."""

    @cached_property
    def layout(self) -> Layout:
        return Layout(len(self.guess.controls), self.truncation.collocation.count)

    @property
    def places(self) -> Floats:
        return self.truncation.to_points

    @property
    def image(self) -> Floats:
        return np.eye(self.truncation.collocation.count)

    @cached_property
    def curve(self) -> Floats:
        return points(self.problem, self.guess.controls, replace(self.truncation, hull=False))


def test_a_parametrisation_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other variables, the same optimum."""
    problem = near()
    before = solve(problem)
    monkeypatch.setitem(PARAMETRISATIONS, "nodes", Entry("nodes", lambda problem: True, NodePositions))
    model = parametrise(problem, choose(problem, before.controls), Iterate(before.controls))
    assert isinstance(model, NodePositions)
    after = solve(problem)
    assert after.status == "planned"
    assert after.attempt.value.cost == pytest.approx(before.attempt.value.cost, abs=1e-2)


@pytest.mark.parametrize("part", [Twice, Halves, NodePositions])
def test_each_takes_fewer_than_forty_lines(part: Callable[..., Any]) -> None:
    assert len(inspect.getsource(part).splitlines()) < 40
