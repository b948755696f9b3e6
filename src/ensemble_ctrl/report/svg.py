"""A plan as a card for notebooks: its map and what became of it, without a plotting library."""

from __future__ import annotations

from ensemble_ctrl.problem.drawing import card_html, map_svg
from ensemble_ctrl.problem.evaluation.sampled import all_paths
from ensemble_ctrl.report.palette import hexadecimal, shades, viridis
from ensemble_ctrl.report.text import PlanLike, summary_rows, verdict
from ensemble_ctrl.report.transform import conflict_places, some

MEMBERS = 9
"""Members drawn, spread over the parameter's range."""
POINTS = 200
"""Points of a path at most."""


def plan_card(plan: PlanLike) -> str:
    """The map with the paths of a few members, rings where the task fails, and the summary, as HTML."""
    problem = plan.problem
    members = problem.fleet.spread(MEMBERS if problem.fleet.names else 1)
    paths, members = all_paths(problem, plan.controls, members)
    paths = paths[:, some(paths.shape[1], POINTS)]
    colours = [hexadecimal(colour) for colour in viridis(shades(problem.fleet, members))]
    marks = [place for _, place in conflict_places(plan)]
    return card_html(
        map_svg(problem, list(paths), colours, marks), f"{problem.name}: {verdict(plan)}", summary_rows(plan)
    )
