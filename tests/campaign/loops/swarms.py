"""Swarms of which only mean and covariance are seen: what is proven of all commands, held against every member."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.planning.online.swarm import Aggregate, Swarm

from .judge import TOLERANCE, Judge, Judged
from .robot import PARTS, Adversary
from .scene import Scene
from .world import Floats, World, body_of, options_of, problem_of

MEMBERS = 9
EXACT = {"position": 0.0, "heading": 0.0, "drift": 0.0}


def judge_swarm(scene: Scene) -> Judged | None:
    """Run a swarm and judge it; None if the package refuses its problem."""
    name = next(iter(scene.parameters))
    parameters = {name: scene.parameters[name]}
    scene = replace(scene, family="swarm", parameters=parameters, errors=EXACT, bounds={}, spread=0.0, added=None)
    try:
        problem = problem_of(scene)
    except ProblemError:
        return None
    swarm = Swarm(problem, options_of(scene), np.array(scene.controls), timer=lambda: 0.0)
    referee = Judge(scene)
    sent = np.zeros((0, 2))
    while True:
        _proven(referee, swarm, sent)
        if swarm.over:
            break
        places = np.array([track[-1, :2] for track in _tracks(scene, sent)])
        swarm.observe(Aggregate(len(sent) * scene.step, places.mean(axis=0), np.cov(places.T)))
        sent = np.concatenate([sent, swarm.step()])
    proofs = {"whole" if swarm.certificate.proven else "none": 1}
    ending = "proven" if swarm.certificate.proven else "open"
    return Judged(scene.family, ending, proofs, referee.checks, tuple(referee.faults))


def _tracks(scene: Scene, controls: Floats) -> list[Floats]:
    """Where members go."""
    name, (low, high) = next(iter(scene.parameters.items()))
    tracks = []
    for value in np.linspace(low, high, MEMBERS):
        adversary = Adversary({name: float(value)})
        body = body_of(scene, adversary, np.array([*scene.position, scene.heading]))
        for _ in range(len(controls) * PARTS):
            body.drive(dict(enumerate(controls)).__getitem__)
        tracks.append(np.array(body.track))
    return tracks


def _proven(referee: Judge, swarm: Swarm, sent: Floats) -> None:
    """What is said of all commands, those sent and those planned."""
    if not swarm.certificate.proven:
        return
    scene, certificate = referee.scene, swarm.certificate
    referee.hold(bool((swarm.plan[: len(sent)] == sent).all()), "log", "other commands than those sent are proven")
    world = cast(World, SimpleNamespace(came=math.inf))
    for track in _tracks(scene, swarm.plan):
        clear = referee.clearance(world, track, 0.0, *scene.duty)
        referee.hold(certificate.clearance <= clear + TOLERANCE, "clearance", f"{certificate.clearance}", clear)
        for part in scene.parts:
            value = referee.margin(part, track, 0.0)
            referee.hold(certificate.robustness <= value + TOLERANCE, "robustness", part.text, value)
