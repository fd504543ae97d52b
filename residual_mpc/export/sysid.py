"""A parameter set for mujoco.sysid: the diagnosed numbers, with their intervals as bounds."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from pprint import pformat
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.export.agreement import position_unit
from residual_mpc.export.augmented import settings_from
from residual_mpc.files import write_atomically
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.logged_laws import at_values, columns_at
from residual_mpc.models.model_file import Written, model_in
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob
from residual_mpc.models.simulating import WritesSysid

MODEL, FILE = "nominal.xml", "sysid_parameters.py"
SOURCE = '''"""Diagnosed parameters of {robot}, with 95 % intervals as bounds, for mujoco.sysid (`mujoco[sysid]`).

    import sysid_parameters as diagnosed
    from mujoco import sysid
    spec, parameters = diagnosed.nominal(), diagnosed.parameters()
    model = sysid.apply_param_modifiers(parameters, spec)
{notes}"""

from pathlib import Path

import mujoco

# name, value, lower and upper bound, and what it sets: kind, name, attribute, index (None: a scalar), base, slope;
# the attribute becomes base + slope * value
PARAMETERS = {rows}


def nominal():
    """The model that the parameters apply to, a mujoco.MjSpec, with the parameters at their values."""
    return mujoco.MjSpec.from_file(str(Path(__file__).with_name("{model}")))


def parameters():
    """A mujoco.sysid.ParameterDict."""
    from mujoco import sysid

    found = sysid.ParameterDict()
    for name, value, low, high, edits in PARAMETERS:
        found.add(sysid.Parameter(name, value, low, high, modifier=_modifier(edits)))
    return found


def _modifier(edits):
    def modify(spec, parameter):
        value = float(parameter.value[0])
        for kind, name, attribute, index, base, slope in edits:
            element = getattr(spec, kind)(name)
            if index is None:
                setattr(element, attribute, base + slope * value)
            else:
                getattr(element, attribute)[index] = base + slope * value

    return modify
'''


def write_sysid(
    written: Written, explanation: Sequence[Mapping[str, Any]], robot: Robot, folder: Path
) -> dict[str, Any]:
    """Write the effects of a diagnosis as a parameter set, with the model that it applies to, and describe them.

    Args:
        explanation: of the diagnosis.json, for the intervals.

    Raises:
        BadInput: a robot that is no MuJoCo model, a model of another robot, one with a network, or one without
            intervals, such as a model.json.
    """
    settings_from(written, robot)
    if not isinstance(robot, WritesSysid):
        raise BadInput(f"{robot.name!r} is no MuJoCo model", "`to=sysid`", "export to casadi, c or jax")
    if residual_in(written) is not None:
        raise BadInput("a parameter set cannot contain a network", written.where, "export the diagnosis itself")
    raw, intervals = model_in(written)[1], _intervals(explanation)
    values, columns = at_values(raw), columns_at(raw)
    intervals = {k: ends for k, ends in intervals.items() if values.get(k) == raw.get(k)}  # a law moves its carrier
    if values and not intervals:
        raise BadInput("it states no intervals", written.where, "give the diagnosis.json instead of the model.json")
    made = robot.to_sysid(values, intervals, folder)
    rows = [(p.name, p.value, p.low, p.high, list(p.edits)) for p in made.parameters]
    left_out = [*made.left_out, *(f"fitted_law: fixed at {x:.4g} of {c}" for c, x in columns.items())]
    notes = "".join(f"\nNot in it: {what}" for what in left_out)
    text = SOURCE.format(
        robot=robot.name, notes=f"{notes}\n" if notes else "", rows=pformat(rows, width=110), model=MODEL
    )
    write_atomically(folder / MODEL, made.text)
    write_atomically(folder / FILE, text)
    document = {
        "to": "sysid",
        "robot": robot.name,
        "files": {FILE: "nominal() and parameters() for mujoco.sysid", MODEL: "the model that the parameters apply to"},
        "parameters": [{"name": p.name, "value": p.value, "bounds": [p.low, p.high]} for p in made.parameters],
        "left_out": left_out,
        "largest_difference": {
            "joints": made.apart, "largest": made.apart, "points": made.points, "from_all_effects": made.apart_from_all,
            "unit": position_unit(robot),
        },
    }  # fmt: skip
    write_atomically(folder / "export.json", json.dumps(document, indent=2) + "\n")
    return document


def _intervals(explanation: Sequence[Mapping[str, Any]]) -> dict[Knob, tuple[float, float]]:
    return {
        Knob(e["effect"], e["target"], name): (float(p["ci95"][0]), float(p["ci95"][1]))
        for e in explanation
        for name, p in e["parameters"].items()
        if p.get("ci95") is not None
    }
