"""The diagnosed effects as parameters that a MuJoCo specification is edited by, each a line in its value."""

import os
from collections.abc import Mapping
from math import ceil, isinf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.edits.batch import tool_places
from plants.mujoco_robot.loading.compile import mark_simple
from plants.mujoco_robot.mjcf import apart, not_held, write_memory, write_numbers
from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.body import TOOL_AXES
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.surroundings import GRAVITY_COMPENSATION
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import TUNE, Knob, Settings, Values, assemble
from residual_mpc.models.simulating import Edit, SysidParameter, SysidSet

if TYPE_CHECKING:
    import mujoco

LINES = {
    "command",
    "strength",
    "position gain",
    "limit",
    "dry friction",
    "damping",
    "rotor",
    "tool",
    "link",
    "length",
}  # sites of effects
JOINT = {"dof_damping": "damping", "dof_armature": "armature", "dof_frictionloss": "frictionloss"}
MEMORY = {"command delay": ("delay", None), "command lag": ("dynprm", 0)}  # quantity -> where an actuator keeps it


def to_sysid(
    robot: CompiledRobot, values: Values, intervals: Mapping[Knob, tuple[float, float]], folder: Path
) -> SysidSet:
    """See WritesSysid. Raises BadInput for a robot without a model file of its own, or with several settings."""
    if robot.spec is None or robot.settings:
        raise BadInput(f"{robot.name!r} has no model file of its own, or several", "`to=sysid`", "export to casadi")
    free, fixed, left_out = _sorted(values, intervals)
    spec = robot.spec.copy()
    at_rest = _settings(robot, fixed)
    write_numbers(spec, robot, at_rest)
    write_memory(spec, _settings(robot, {k: v for k, v in values.items() if k in free or k in fixed}))
    parameters: list[SysidParameter] = []
    taken: dict[tuple[Any, ...], str] = {}
    for knob in free:
        edits = _edits(spec, robot, knob, fixed, values[knob], intervals[knob])
        rival = next((taken[e[:4]] for e in edits if e[:4] in taken), None)
        name = ".".join(filter(None, (knob.effect, knob.target, knob.parameter)))
        if rival is not None:
            left_out.append(f"{name}: it changes the same numbers as {rival}")
            continue
        taken |= {e[:4]: name for e in edits}
        parameters.append(SysidParameter(name, values[knob], *intervals[knob], tuple(edits)))
    for parameter in parameters:
        apply(spec, parameter)
    model = spec.compile()
    said = _settings(robot, {k: v for k, v in values.items() if k in free or k in fixed})
    if model.nmesh or model.ntex or model.nhfield:  # seen from where the file will lie
        spec.meshdir = spec.texturedir = os.path.relpath(Path(spec.modelfiledir, spec.meshdir), folder)
    mark_simple(spec, True)
    text = spec.to_xml()
    spec.meshdir, spec.texturedir = robot.spec.meshdir, robot.spec.texturedir
    (some, whole), points = apart(robot, (said, _settings(robot, values)), spec)
    return SysidSet(text, tuple(parameters), tuple(left_out), some, whole, points)


def apply(spec: "mujoco.MjSpec", parameter: SysidParameter, value: float | None = None) -> None:
    """Write a parameter's value (its own by default) into a specification."""
    x = parameter.value if value is None else value
    for kind, name, field, index, base, slope in parameter.edits:
        at = getattr(spec, kind)(name)
        if index is None:
            setattr(at, field, base + slope * x)
        else:
            getattr(at, field)[index] = base + slope * x


def _sorted(
    values: Values, intervals: Mapping[Knob, tuple[float, float]]
) -> tuple[list[Knob], dict[Knob, float], list[str]]:
    """Numbers that become parameters, those that the specification holds as they are, and what it cannot hold."""
    free: list[Knob] = []
    fixed: dict[Knob, float] = {}
    left_out: list[str] = []
    for knob, value in values.items():
        effect = None if knob.effect == TUNE else BY_NAME[knob.effect]
        if effect is not None and (effect.own or not_held(effect)):
            left_out.append(f"{effect.name}: {not_held(effect)}")
        elif effect is GRAVITY_COMPENSATION:
            left_out.append(f"{effect.name}: a specification of parameters has no controller")
        elif effect is COMMAND_DELAY and value <= 0.0:
            left_out.append(f"{effect.name}: commands that act before their stamps are a fault of the log")
        elif effect is not None and _line(effect) == knob.parameter and knob in intervals:
            free.append(knob)
        elif effect is not None and effect.parameter(knob.parameter).quantity in TOOL_AXES.values():
            fixed[knob] = value
        elif effect is not None and any(k.term == knob.term for k in free):
            if value != 0.0:
                left_out.append(f"{knob.effect}.{knob.parameter}: only its {_line(effect)} is a parameter")
        else:
            fixed[knob] = value
    return free, fixed, list(dict.fromkeys(left_out))


def _line(effect: Effect) -> str | None:
    """The parameter that a specification follows in a line: of those, the first; None where there is none."""
    return effect.parameters[0].name if effect.place in LINES else None


def _settings(robot: CompiledRobot, values: Values) -> Settings:
    return assemble([values], {e: robot.slots(e) for e in {k.effect for k in values if k.effect != TUNE}})


def _edits(
    spec: "mujoco.MjSpec", robot: CompiledRobot, knob: Knob, fixed: Values, value: float, reach: tuple[float, float]
) -> list[Edit]:
    """How the specification follows one number; makes what it needs for it."""
    slots = robot.slots(knob.effect) if knob.target is None else (knob.target,)
    parameter = next(p for p in BY_NAME[knob.effect].parameters if p.name == knob.parameter)
    if parameter.quantity in MEMORY:
        field, index = MEMORY[parameter.quantity]
        for name in slots if field == "delay" else ():
            spec.actuator(name).nsample = ceil(max(reach[1], value) / robot.step) + 2
        return [("actuator", name, field, index, 0.0, 1.0) for name in slots]
    if isinf(parameter.null):  # a limit
        for name in slots:
            spec.actuator(name).forcelimited = True
        return [("actuator", name, "forcerange", k, 0.0, sign) for name in slots for k, sign in ((0, -1.0), (1, 1.0))]
    if parameter.quantity in ("tool mass", "link mass"):
        tool = parameter.quantity == "tool mass"
        where = tool_places(robot, _settings(robot, {**fixed, knob: value}).effects, 1)[0] if tool else None
        return [("body", _loaded(spec, robot, knob.effect, slot, where), "mass", None, 0.0, 1.0) for slot in slots]
    before = corrected_constants(robot, _settings(robot, fixed))
    after = corrected_constants(robot, _settings(robot, {**fixed, knob: value}))
    null = parameter.null
    out: list[Edit] = []
    for field, new in after.items():
        old = before.get(field, getattr(robot.model, field))
        for place in np.argwhere(new != old).tolist():
            slope = float((new[tuple(place)] - old[tuple(place)]) / (value - null))
            out.append((*_place(robot, field, place), float(old[tuple(place)]) - slope * null, slope))
    return [_constant(e, robot, after) for e in out]


def _constant(edit: Edit, robot: CompiledRobot, after: dict[str, np.ndarray]) -> Edit:
    """How firmly friction holds does not grow with it."""
    if edit[2] != "solimp_friction":
        return edit
    dof = int(robot.dofs[robot.joints.index(edit[1])])
    return (*edit[:4], float(after["dof_solimp"][dof][edit[3]]), 0.0)


def _place(robot: CompiledRobot, field: str, place: list[int]) -> tuple[str, str, str, int | None]:
    """(kind, name, attribute, index) of a number of the compiled model in the specification."""
    at, rest = place[0], place[1:]
    if field.startswith("dof_"):
        joint = robot.joints[robot.dofs.tolist().index(at)]
        if field == "dof_solimp":
            return "joint", joint, "solimp_friction", rest[0]
        return "joint", joint, JOINT[field], 0 if field == "dof_damping" else None
    kind, _, attribute = field.partition("_")
    name = robot.model.actuator(at).name if kind == "actuator" else robot.model.body(at).name
    return kind, name, attribute, rest[0]


def _loaded(spec: "mujoco.MjSpec", robot: CompiledRobot, effect: str, slot: str, tool: np.ndarray | None) -> str:
    """The name of a point mass that is added to a body: where the tool is (3,) m, or at the body's own centre."""
    body = robot.links.index(slot) + 1 if tool is None else robot.payload[0]
    pos = robot.model.body_ipos[body] if tool is None else tool
    load = spec.body(robot.model.body(body).name).add_body(name=f"{effect}.{slot}", pos=pos)
    load.explicitinertial, load.mass, load.ipos, load.inertia = True, 1.0, (0, 0, 0), (0, 0, 0)
    return str(load.name)
