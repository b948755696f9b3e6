"""The shortest plan and the earliest passage: against closed forms, a scan of values, and in problem files."""

from __future__ import annotations

import pytest

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.constraints.stl import parse, resolve
from ensemble_ctrl.constraints.stl.robustness import fits_grid
from ensemble_ctrl.core.errors import ConfigError, ProblemError
from ensemble_ctrl.files.config import dump, load, load_text, read
from ensemble_ctrl.ocp.guesses import Guess, Request, first_guesses
from ensemble_ctrl.planning import planner
from ensemble_ctrl.planning.minimum_time import TOLERANCE, _Search, solve
from ensemble_ctrl.planning.minimum_time.goals import Duration, Passage, bound, goal_of
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import findings
from ensemble_ctrl.problem.evaluation.sampled import replay, trajectories
from tests.examples import quick
from tests.paths import CONFIGS

FILES = CONFIGS / "time"
STRAIGHT = """
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [-1, 2], omega: [-2, 2]}
horizon: {duration: {at_most: 8 s}, steps: 20}
regions: {goal: {box: [[3, 4], [-0.5, 0.5]]}}
task: F in(goal)
objective: {robustness: 0.1, effort: 0.01}
verify: {members: 200}
"""
BLOCK = STRAIGHT.replace(
    "task: F in(goal)", "obstacles: {o: {box: [[1.2, 1.8], [-0.6, 1.0]]}}\ntask: F in(goal) and G avoid(o)"
)
FASTEST = 3 / (0.9 * 2)
"""Seconds that the slowest member needs at top speed."""


def proven(solution: planner.Solution) -> bool:
    """Whether there is a certified plan."""
    certificate = solution.certificate
    return solution.status == "planned" and certificate is not None and certificate.proven == "yes"


def test_straight_ahead_it_takes_what_top_speed_allows() -> None:
    found, shortest = solve(load_text(STRAIGHT))
    assert shortest is not None
    assert proven(found)
    assert shortest.bound == pytest.approx(FASTEST, rel=1e-4)
    assert FASTEST <= shortest.value <= (1 + TOLERANCE) * (FASTEST + 0.01 / 1.8)  # with the margin of 1 cm
    assert found.problem.duration == shortest.value
    assert found.controls[:, 0].mean() > 1.97


def test_a_search_that_is_stopped_says_what_it_did() -> None:
    """Before there is a plan: the iterations on the coarse grid are counted, too."""
    seen: list[str] = []

    def progress(phase: str, iteration: object) -> bool:
        seen.append(phase)
        return seen.count("coarse solve") > 25

    found, shortest = solve(load_text(BLOCK), progress=progress)
    assert shortest is None
    assert found.iterations > 0
    assert found.solve_seconds > 0
    assert found.seconds["search"] > 0


@pytest.mark.slow
def test_around_a_block_it_is_within_two_percent_of_a_scan() -> None:
    problem = load_text(BLOCK)
    found, shortest = solve(problem)
    assert shortest is not None
    assert shortest.missed is not None
    assert proven(found)
    for share in (0.96, 0.98):
        assert not proven(planner.solve(problem.with_(duration=share * shortest.value, least_duration=None)))
    assert replay(found.problem, found.controls, members=500, substeps=10).satisfied == 1.0


@pytest.mark.parametrize(
    ("task", "least"),
    [
        ("F in(goal)", FASTEST),
        ("F[5, T] in(goal)", 5.0),
        ("F[1, 6] in(goal)", 6.0),
        ("F[0, 1] x >= 1 and G[0, T] x >= -1", 1.0),
    ],
)
def test_the_bound_knows_windows(task: str, least: float) -> None:
    problem = load_text(STRAIGHT).with_(task=parse(task))
    assert bound(Duration(problem)) == pytest.approx(least, rel=1e-4)


def test_at_least_is_kept() -> None:
    found, shortest = solve(load_text(STRAIGHT.replace("at_most: 8 s", "at_most: 8 s, at_least: 3 s")))
    assert shortest is not None
    assert (shortest.bound, shortest.missed) == (3.0, None)
    assert 3.0 <= shortest.value <= 3.0 * (1 + TOLERANCE)
    assert proven(found)


@pytest.mark.slow
def test_nothing_within_the_longest_is_no_plan() -> None:
    wall = BLOCK.replace("[-0.6, 1.0]", "[-50, 50]").replace("steps: 20", "steps: 8").replace("8 s", "3 s")
    found, shortest = solve(load_text(wall))
    assert (found.status, shortest) == ("infeasible", None)
    assert found.problem.duration == 3.0


@pytest.mark.parametrize("longest", [2.5, 3.2])
def test_a_plan_that_only_one_value_leads_to_is_found_for_every_limit(
    monkeypatch: pytest.MonkeyPatch, longest: float
) -> None:
    """Routes lead to a solution at 1.35^4 = 3.322 s and nowhere else; from there it is driven faster."""

    def only(request: Request) -> list[Guess]:
        return first_guesses(request) if request.problem.duration == 3.322 else []

    monkeypatch.setattr("ensemble_ctrl.planning.minimum_time.first_guesses", only)
    _, shortest = solve(load_text(STRAIGHT.replace("at_most: 8 s", f"at_most: {longest} s")))
    assert shortest is not None
    assert shortest.value == pytest.approx(FASTEST, rel=2 * TOLERANCE)


@pytest.mark.parametrize("longest", [2.0, 2.4, 3.0, 8.0])
def test_the_ladder_of_a_longer_limit_has_the_values_of_a_shorter_one(longest: float) -> None:
    def ladder(most: float) -> list[float]:
        goal = goal_of(load_text(STRAIGHT.replace("at_most: 8 s", f"at_most: {most} s")))
        assert goal is not None
        return list(_Search(goal, None, None)._ladder(bound(goal), most))

    short, long = ladder(longest), ladder(8.0)
    assert short == sorted(short)
    assert set(short) - {longest} <= set(long)


def test_a_proven_guess_for_the_longest_is_the_plan_where_no_value_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    proven_one = planner.solve(load_text(STRAIGHT.replace("{at_most: 8 s}", "8 s")))
    assert proven(proven_one)
    nothing = planner.solve(load_text(BLOCK.replace("{at_most: 8 s}", "8 s")), progress=lambda *_: True)
    monkeypatch.setattr(_Search, "_narrow", lambda *_: nothing)
    found, shortest = solve(load_text(STRAIGHT), guess=proven_one.controls)
    assert shortest is not None
    assert shortest.value == 8.0
    assert proven(found)


def passing(text: str = BLOCK) -> Problem:
    """A check point on the way, to be passed early."""
    return load_text(
        text.replace("{at_most: 8 s}", "8 s")
        .replace("steps: 20", "steps: 40")
        .replace("regions: {", "regions: {home: {box: [[-1, 0.5], [-0.5, 0.5]]}, ")
        .replace("task: ", "task: F[7, 8] in(home) and ")
        .replace("robustness: 0.1", "earliest: goal, robustness: 0.1")
    )


@pytest.mark.parametrize("text", quick([STRAIGHT, BLOCK], STRAIGHT), ids=["straight", "block"])
def test_a_passage_is_as_early_as_can_be_and_the_task_goes_on(text: str) -> None:
    problem = passing(text)
    found, shortest = solve(problem)
    assert shortest is not None
    assert proven(found)
    paths = trajectories(problem, found.controls, problem.fleet.grid(50))
    inside = problem.regions["goal"].margin(paths) >= 0
    first = inside.argmax(axis=1).max() * problem.step
    assert inside.any(axis=1).all()
    assert first <= shortest.value + 1e-9
    assert shortest.bound == pytest.approx(FASTEST, rel=1e-3)
    assert shortest.value - (shortest.missed or shortest.bound) <= problem.step + 1e-9
    assert replay(found.problem, found.controls, members=200).satisfied == 1.0
    assert bool((paths[:, -6:, 0].min(axis=1) <= 0.5).all())


def test_a_plan_tells_what_was_found() -> None:
    made = plan(load_text(STRAIGHT))
    told = made.details["minimum_time"]
    assert (told["of"], told["value"]) == ("duration", made.problem.duration)
    assert goal_of(made.problem) is None
    assert "none exists below 1.667 s" in made._repr_html_()


@pytest.mark.parametrize("name", ["minimum_time", "earliest_passage"])
def test_configs_load_without_a_warning_and_are_written_again(name: str) -> None:
    loaded = read(FILES / f"{name}.yaml")
    assert loaded.warnings == ()
    again = load_text(dump(loaded.problem))
    assert (again.least_duration, again.duration) == (loaded.problem.least_duration, loaded.problem.duration)
    assert again.objective.earliest == loaded.problem.objective.earliest
    assert type(goal_of(again)) is {"minimum_time": Duration, "earliest_passage": Passage}[name]


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("at_most: 8 s", "at_least: 8 s", "horizon.duration: expected at_most, the longest that the plan may take"),
        ("at_most: 8 s", "at_most: 8 s, least: 2", "horizon.duration.least: unknown field"),
        ("at_most: 8 s", "at_most: 8 m", "expected a time in s, ms, min or h, got '8 m', which is a length"),
        ("at_most: 8 s", "at_most: 8 s, at_least: 9 s", "expected at_least up to at_most, got 9 s and 8 s"),
        ("at_most: 8 s", "at_most: 1 s", "drives 1.8 m by 1 s"),
        ("robustness: 0.1", "earliest: gaol", "expected the name of a region (goal), got 'gaol'"),
        ("robustness: 0.1", "earliest: goal", "ask for one or the other"),
    ],
)
def test_mistakes_are_told(old: str, new: str, wanted: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_text(STRAIGHT.replace(old, new))
    assert wanted in str(error.value)


def test_the_deadline_of_a_passage_reads_like_a_time() -> None:
    problem = load(FILES / "earliest_passage.yaml")
    goal = goal_of(problem)
    assert isinstance(goal, Passage)
    texts = [str(goal.at(k * problem.step).task) for k in range(20, problem.steps)]
    assert max(len(text.split(" and ")[-1]) for text in texts) <= len("F[0,9.9] in(checkpoint)")


def test_bounds_from_python_are_checked() -> None:
    with pytest.raises(ProblemError, match="expected at_least from 0 s up to at_most, 8 s, got 9 s"):
        load(FILES / "minimum_time.yaml").with_(duration=8.0, least_duration=9.0)


INSTANT = STRAIGHT.replace("at_most: 8 s}, steps: 20", "at_most: 5.3 s}, steps: 7").replace(
    "traction: {range: [0.9, 1.1]}", ""
)


@pytest.mark.parametrize(
    "task",
    [
        "F[3, 3.1] in(goal)",
        "F[3, 3] in(goal)",
        "F[2.5, 2.5] x >= 1 and F[3, 3] in(goal)",
        "F[T-0.1, T-0.05] in(goal)",
        "F in(goal)",
    ],
)
@pytest.mark.parametrize("value", [5.3, 4.4, 3.6, 3.01])
def test_durations_are_tried_where_windows_hold_the_end_of_a_step(task: str, value: float) -> None:
    goal = goal_of(load_text(INSTANT.replace("F in(goal)", task)))
    assert isinstance(goal, Duration)
    near = goal.nearest(value, bound(goal), 5.301)
    if near is None:  # no step ends within a tenth of a second before the end
        assert task.startswith("F[T")
        return
    problem = goal.at(near)
    assert fits_grid(resolve(problem.task, near), problem.step)
    assert abs(near - value) <= {"F in(goal)": 1e-9, "F[3, 3.1] in(goal)": 0.5}.get(task, 2.0)
    assert goal.nearest(value, near, near + 1e-9) is None


@pytest.mark.parametrize(("task", "value"), [("F[3, 3.1] in(goal)", 3.1), ("F[4, 4] in(goal)", 4.0)])
def test_a_window_between_steps_is_planned_in_a_duration_that_fits(task: str, value: float) -> None:
    found, shortest = solve(load_text(INSTANT.replace("F in(goal)", task)))
    assert shortest is not None
    assert proven(found)
    assert shortest.value == pytest.approx(value, rel=0.01)


def test_a_window_between_steps_of_a_fixed_duration_is_a_warning() -> None:
    text = INSTANT.replace("{at_most: 5.3 s}", "5 s").replace("F in(goal)", "F[3, 3.1] in(goal)")
    (found,) = findings(load_text(text))
    assert (found.severity, found.path) == ("warning", ("task",))
    assert "holds no end of a step (0.714 s)" in found.message
    assert findings(load_text(text.replace("steps: 7", f"steps: {found.hint.split()[1]}"))) == ()
