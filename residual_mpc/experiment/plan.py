"""From a diagnosis.json to the runs that it is worth driving next."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.checkpoint import at_once
from residual_mpc.errors import BadInput
from residual_mpc.experiment.choose import Keep, choose, parted, protocol
from residual_mpc.experiment.drive_setup import DriveSetup, setup_from_model, setup_from_runs
from residual_mpc.experiment.explanations import explanations_of
from residual_mpc.experiment.explore import explore, regimes_of
from residual_mpc.experiment.separate import Planned
from residual_mpc.models.protocol import Robot

SECONDS = 20.0  # of a motion

Limits = Mapping[str, tuple[float, float]]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Plan:
    """purpose: "tell apart", "explore" or "protocol"; played: the motions to drive; document: the plan as plain values,
    as `excite --json` prints it."""

    purpose: str
    setup: DriveSetup
    played: tuple[Planned, ...]
    document: dict[str, Any]


def plan_next(
    document: Mapping[str, Any],
    robot: Robot,
    where: str,
    limits: Limits,
    seconds: float,
    rng: np.random.Generator,
    progress: Progress = lambda text, done: None,
    keep: Keep = at_once,
    parts: Collection[str] = (),
) -> Plan:
    """What a diagnosis leaves open decides: explanations that were not told apart, a gap that nothing explains, or
    nothing. keep: see `choose`; parts: see `explanations_of`. Raises BadInput where the diagnosis cannot be read, or is
    of another robot."""
    setup = setup_from_runs(document, robot, where, limits)
    explanations = explanations_of(document, robot, where, parts)
    if len(explanations) > 1:
        found = choose(robot, setup, [e.values for e in explanations], seconds, rng, progress, keep)
        return Plan("tell apart", setup, tuple(s.planned for s in found.played), {
            "purpose": "tell apart", "parts": [e.name for e in explanations],
            "motions": [{**_described(s.planned, s.ratio), "separates": parted(s.losses)} for s in found.motions],
            "pairs": len(explanations) * (len(explanations) - 1) // 2, "separates": parted(found.losses),
            "played": [s.planned.motion.name for s in found.played], "ratio": found.ratio,
            "told_apart": found.parts, "sensors": list(found.sensors), "switches": found.switches, "not_testable": [],
        })  # fmt: skip
    if document.get("verdict") not in ("unknown", "partial"):
        return _protocol(robot, setup, seconds, rng)
    try:
        regimes = regimes_of(document["where"]["regimes"])
    except (KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"its list of regimes cannot be read: {error!r}", where, "diagnose the runs again") from error
    explored = explore(robot, setup, explanations[0].values, regimes, seconds, rng)
    return Plan("explore", setup, tuple(e.planned for e in explored), {
        "purpose": "explore", "parts": [], "told_apart": None, "sensors": [], "switches": False, "not_testable": [],
        "motions": [{**_described(e.planned, None), "shows": e.shows, "unseen": list(e.unseen)} for e in explored],
    })  # fmt: skip


def plan_first(robot: Robot, limits: Limits, seconds: float, rng: np.random.Generator) -> Plan:
    """A protocol for a robot that has no runs yet."""
    return _protocol(robot, setup_from_model(robot, limits), seconds, rng)


def _protocol(robot: Robot, setup: DriveSetup, seconds: float, rng: np.random.Generator) -> Plan:
    played, hidden, nowhere = protocol(robot, setup, seconds, rng)
    return Plan("protocol", setup, played, {
        "purpose": "protocol", "parts": [], "motions": [_described(p, None) for p in played], "told_apart": None,
        "sensors": [], "switches": False,
        "not_testable": [
            {"effect": n.term.effect, "target": n.term.target, "nowhere": n.term.effect in nowhere} for n in hidden
        ],
    })  # fmt: skip


def _described(planned: Planned, ratio: float | None) -> dict[str, Any]:
    return {"name": planned.motion.name, "ratio": ratio, "within_limits": planned.within}
