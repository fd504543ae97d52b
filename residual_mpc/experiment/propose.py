"""What a diagnosis proposes to do next: its words made concrete where planning costs little."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.experiment.command_file import command_table
from residual_mpc.experiment.plan import SECONDS, Plan, plan_next
from residual_mpc.experiment.sensors import sensors_for
from residual_mpc.models.protocol import Robot

FILE = "next.csv"
# numbers in the start state: a plan for a robot of equations and of this size costs seconds; for a larger one, or one
# that a physics engine simulates, it costs minutes and is left to `excite`
AT_ONCE = 3
LISTED = 4  # sensors in the sentence
TIMES = 6.0  # the shortest run that shows an effect, in a plan that is to show it


@dataclass(frozen=True)
class Proposal:
    """next_experiment: as diagnosis.json has it; table: the content of FILE, None where none is written."""

    next_experiment: dict[str, Any] | None
    table: str | None


def propose(
    document: Mapping[str, Any], robot: Robot, excite: str, seed: int, logged: Collection[str] = ()
) -> Proposal:
    """The experiment of a diagnosis.json that leaves something open; excite: the command that plans it (again); logged:
    columns that the runs have."""
    said = document["next_experiment"]
    if said is None:
        return Proposal(None, None)
    wanted = () if said["parts"] else sensors_for(document["remainder"], robot.actuators, logged)
    said = {**said, "what": said["what"] + _besides(wanted), "sensors": list(wanted), "excite": excite}
    if robot.step is not None or sum(1 if s.velocity is None else 2 for s in robot.states) > AT_ONCE:
        return Proposal(said, None)
    try:
        seconds = _seconds(said["parts"])
        rng = np.random.default_rng(seed)
        plan = plan_next(document, robot, "diagnosis.json", {}, seconds, rng, parts=said["parts"])
    except BadInput:
        return Proposal(said, None)  # a robot that cannot be planned for keeps the words
    if plan.purpose == "protocol":
        return Proposal(said, None)
    table = command_table([p.motion for p in plan.played], plan.setup.actuators)
    sensors = list(dict.fromkeys([*plan.document["sensors"], *wanted]))
    long = f" for {seconds:g} s" if seconds > SECONDS else ""
    planned = {"what": _words(plan) + long + _besides(sensors), "commands": FILE, "sensors": sensors}
    return Proposal({**said, **planned, "told_apart": plan.document["told_apart"]}, table)


def _seconds(parts: Collection[str]) -> float:
    """s of a motion that is to tell these effects apart: one that takes a long run to show gets one."""
    return max([SECONDS, *(TIMES * BY_NAME[name].seconds for name in parts if name in BY_NAME)])


def _words(plan: Plan) -> str:
    names = [p.motion.name for p in plan.played]
    verb = "drive" if plan.setup.wheeled else "command the motion"
    if plan.purpose == "explore":
        return f"{verb} {names[0]} twice" + "".join(f", then {n}" for n in names[2:])
    return f"{verb} {', then '.join(names)}"


def _besides(sensors: Sequence[str]) -> str:
    if len(sensors) > LISTED:
        sensors = [*sensors[: LISTED - 1], "others"]
    return f"; also log {' and '.join(sensors)}" if sensors else ""
