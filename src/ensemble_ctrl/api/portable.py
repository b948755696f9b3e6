"""Plans as texts, for another process or another machine."""

from __future__ import annotations

import io
import json
from base64 import b64decode, b64encode
from dataclasses import asdict
from typing import Any

import numpy as np

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import Certificate, as_data
from ensemble_ctrl.certificate.bound import Bound, CounterExample
from ensemble_ctrl.certificate.task import TaskBound
from ensemble_ctrl.files.config.portable import problem_of, problem_text
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.clearance import Clearance
from ensemble_ctrl.problem.evaluation.sampled import Replay, ShareSeen


def plan_text(plan: Plan) -> str:
    """A plan with its problem, its replay and its certificate, without its baseline."""
    arrays: dict[str, Any]
    facts: dict[str, Any]
    arrays, facts = {"controls": plan.controls}, {"status": plan.status, "details": plan.details}
    facts["problem"] = problem_text(plan.problem)
    if plan.replayed is not None:
        run = plan.replayed
        arrays |= {"parameters": run.parameters, "robustness": run.robustness, "violating": run.violating}
        facts["replay"] = {
            "names": run.names,
            "clearances": [asdict(one) for one in run.clearances],
            "shares": [asdict(one) for one in run.shares],
            **{name: getattr(run, name) for name in ("substeps", "seconds", "corners", "starts")},
        }
    if plan.certificate is not None:
        facts["certificate"] = as_data(plan.certificate)
    content = io.BytesIO()
    np.savez_compressed(content, facts=np.array(json.dumps(facts)), **arrays)
    return b64encode(content.getvalue()).decode()


def plan_of(text: str, problem: Problem) -> Plan:
    """The plan of a text.

    Parameters
    ----------
    text : str
        Of `plan_text`.
    problem : Problem
        What was planned. The plan's own problem is the same, or where a time was to be as short as possible that of the
        time found.
    """
    with np.load(io.BytesIO(b64decode(text)), allow_pickle=False) as arrays:
        facts = json.loads(str(arrays["facts"]))
        if facts["problem"] != problem_text(problem):
            with problem_of(facts["problem"]) as found:
                problem = found.with_(fleet=problem.fleet)
        certificate = _certificate(facts["certificate"]) if "certificate" in facts else None
        replayed = _replay(facts["replay"], arrays) if "replay" in facts else None
        return Plan(problem, arrays["controls"], facts["status"], facts["details"], replayed, certificate)


def _replay(facts: dict[str, Any], arrays: Any) -> Replay:
    """A replay from its facts and its arrays."""
    return Replay(
        parameters=arrays["parameters"],
        names=tuple(facts["names"]),
        robustness=arrays["robustness"],
        clearances=tuple(Clearance(**one) for one in facts["clearances"]),
        violating=arrays["violating"],
        substeps=facts["substeps"],
        seconds=facts["seconds"],
        corners=facts["corners"],
        shares=tuple(ShareSeen(**one) for one in facts["shares"]),
        starts=tuple(facts["starts"]),
    )


def _certificate(facts: dict[str, Any]) -> Certificate:
    """A certificate from its facts; its clearance and robustness follow from its bounds."""
    counter = facts["counter_example"]
    return Certificate(
        proven=facts["proven"],
        clearances=tuple(Bound(**one) for one in facts["clearances"]),
        parts=tuple(TaskBound(**one) for one in facts["parts"]),
        counter_example=None if counter is None else CounterExample(**counter),
        ranges={name: (low, high) for name, (low, high) in facts["ranges"].items()},
        boxes=facts["boxes"],
        seconds=facts["seconds"],
        inputs=facts["inputs_sha256"],
        reason=facts["reason"],
        uncertainty=facts.get("uncertainty", {}),
        enough=facts.get("enough"),
    )
