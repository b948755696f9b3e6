"""Several plans on one map, with a table of what differs between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ensemble_ctrl.api.edit.drawing import drawing
from ensemble_ctrl.api.edit.scene import ground
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.files.config.tree import Tree
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.text import summary_rows, verdict

Data = dict[str, Any]
MOST = 6
"""Plans on one map: so many colours and line styles are told apart."""
NONE = "—"
"""In a table, of a plan that has none."""


def overlay(plans: Mapping[str, Plan]) -> Data:
    """What a page shows of several plans.

    Parameters
    ----------
    plans : mapping of str to Plan
        By their names, judged.

    Returns
    -------
    dict
        Strict JSON data: ``map`` with what all plans have in common, ``plans`` with the drawing of each and, in its
        views, what its ``own`` map has besides; and ``table``: what each row says of every plan, and whether that
        differs.

    Raises
    ------
    EnsembleError
        If there are too many, or they can't be drawn on one map.
    """
    if len(plans) > MOST:
        raise EnsembleError(f"PLAN: expected at most {MOST} plans, got {len(plans)}")
    _require_one_space(plans)
    drawings = {name: drawing(plan) for name, plan in plans.items()}
    views = [one["views"] for one in drawings.values()]
    for k in range(len(views[0])):
        common = [area for area in views[0][k]["areas"] if all(area in view[k]["areas"] for view in views)]
        for view in views:
            view[k]["own"] = [area for area in view[k]["areas"] if area not in common]
    first = next(iter(plans.values())).problem
    shared = [area for area in views[0][0]["areas"] if area not in views[0][0]["own"]]
    return {
        "mode": "view",
        "file": ", ".join(plans),
        "map": ground(first, shared),
        "plans": [{"name": name, "drawing": one} for name, one in drawings.items()],
        "table": {"names": list(plans), "rows": differences(plans)},
    }


def differences(plans: Mapping[str, Plan]) -> list[Data]:
    """Rows of a table: the summary of each plan, then what differs between their problem files.

    Returns
    -------
    list of dict
        ``label``, ``cells`` in the order of `plans`, and whether they ``differ``.
    """
    summaries = [_summary(plan) for plan in plans.values()]
    fields = [_fields(plan.problem) for plan in plans.values()]
    return [*_rows(summaries), *(row for row in _rows(fields) if row["differ"])]


def _require_one_space(plans: Mapping[str, Plan]) -> None:
    """Refuse plans on a line, in the plane and in space beside each other."""
    spaces = {name: ", ".join(plan.problem.fleet.places) for name, plan in plans.items()}
    (first, wanted), *others = spaces.items()
    for name, space in others:
        if space != wanted:
            raise EnsembleError(f"{name}: expected a plan in {wanted} like {first}, got one in {space}")


def _rows(columns: list[dict[str, str]]) -> list[Data]:
    """Columns by label as rows, in the order in which labels come first."""
    labels = dict.fromkeys(label for column in columns for label in column)
    found = []
    for label in labels:
        cells = [column.get(label, NONE) for column in columns]
        found.append({"label": label, "cells": cells, "differ": len(set(cells)) > 1})
    return found


def _summary(plan: Plan) -> dict[str, str]:
    """The summary by labels; lines that belong to one label are below each other."""
    found, last = {"result": verdict(plan)}, ""
    for label, text in summary_rows(plan):
        last = label or last
        found[last] = f"{found[last]}\n{text}" if last in found else text
    return found


def _fields(problem: Problem) -> dict[str, str]:
    """Every value of a problem file by its path."""
    return dict(_leaves(Tree.read(dump(problem)).data, ""))


def _leaves(data: Any, path: str) -> Iterator[tuple[str, str]]:
    """Values below a path; lists are values."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _leaves(value, f"{path}.{key}" if path else str(key))
    else:
        yield path, str(data)
