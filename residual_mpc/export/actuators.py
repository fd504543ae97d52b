"""A table of actuator values, in the names that Isaac Lab and Newton take.

Isaac Lab: keywords of ImplicitActuatorCfg, IdealPDActuatorCfg and DelayedPDActuatorCfg (2.x; 3.x takes the same names).
Newton: the arrays of its Model, a value a joint.
"""

import json
from collections.abc import Mapping, Sequence
from math import ceil, floor, sqrt
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import settings_from
from residual_mpc.files import write_atomically
from residual_mpc.learning.network.written import network_in
from residual_mpc.models.actuator_values import ActuatorValues, ListsActuators
from residual_mpc.models.model_file import MODEL_SCHEMA, Written, model_content
from residual_mpc.models.protocol import Robot

FILE = "actuators.toml"
NUMBERS = ("stiffness", "damping", "armature", "friction", "viscous_friction", "effort_limit", "delay", "lag")
NEWTON = {
    "joint_target_ke": "stiffness",
    "joint_target_kd": "damping",
    "joint_damping": "viscous_friction",
    "joint_armature": "armature",
    "joint_friction": "friction",
    "joint_effort_limit": "effort_limit",
}
HEAD = """# What drives each joint of {robot}, effects of the diagnosis included; at the joint, in rad and N m (m and N
# where it slides). ci95: the intervals of the diagnosis. A delay of n seconds is round(n / physics_dt) steps.
"""

Interval = tuple[float, float]


def write_actuators(
    written: Written, explanation: Sequence[Mapping[str, Any]], robot: Robot, physics_dt: float | None, folder: Path
) -> dict[str, Any]:
    """Write the actuators' values under a diagnosis.json or model.json, and describe the file.

    Args:
        explanation: of the diagnosis.json, for the intervals.
        physics_dt: s, step of the simulation that they are for; None for the robot's own.

    Raises:
        BadInput: a model of another robot, or a robot without actuators of its own, such as a differential drive.
    """
    settings = settings_from(written, robot)
    if not isinstance(robot, ListsActuators):
        raise BadInput(
            f"{robot.name!r} has no table of actuators", "`to=actuators`", "export to casadi, c or jax"
        )  # fmt: skip
    dt = physics_dt or robot.step
    values, left_out = robot.actuator_values(settings), (*robot.not_of_actuators(settings), *network_in(written))
    intervals = _intervals(written, explanation, robot, values)
    notes = [f"{v.actuator}: a filter of {v.lag:.3g} s, which neither tool has: see lag" for v in values if v.lag > 0]
    notes += [f"{v.actuator}: {_geared(v)}" for v in values if v.gear != 1.0]
    write_atomically(folder / FILE, _text(robot.name, dt, values, intervals, [*notes, *left_out]))
    document = {
        "to": "actuators",
        "robot": robot.name,
        "files": {FILE: "values for Isaac Lab, Newton and others, by joint"},
        "physics_dt": dt,
        "approximated": notes,
        "left_out": list(left_out),
    }
    write_atomically(folder / "export.json", json.dumps(document, indent=2) + "\n")
    return document


def _geared(values: ActuatorValues) -> str:
    """What a command stands for that is neither the joint's position or velocity nor its torque."""
    if values.kind == "torque":
        return f"a command of 1 gives {values.gain:.4g} N m at the joint (N where it slides)"
    return f"its command is {values.gear:g} times the joint's {values.kind}"


def _intervals(
    written: Written,
    explanation: Sequence[Mapping[str, Any]],
    robot: ListsActuators,
    values: Sequence[ActuatorValues],
) -> dict[tuple[str, str], Interval]:
    """(joint, number) -> 95 % interval, where the diagnosis states one; several effects count as independent."""
    model = dict(model_content(written))
    apart: dict[tuple[str, str], list[Interval]] = {}
    for member in explanation:
        for name, parameter in member["parameters"].items():
            if parameter.get("ci95") is None:
                continue
            ends = []
            for end in parameter["ci95"]:
                rows = [
                    {**row, "value": end}
                    if (row["effect"], row["target"], row["parameter"]) == (member["effect"], member["target"], name)
                    else row
                    for row in model["values"]
                ]
                changed = Written({**model, "schema": MODEL_SCHEMA, "values": rows}, written.where)
                ends.append(robot.actuator_values(settings_from(changed, robot)))  # type: ignore[arg-type]
            for best, low, high in zip(values, *ends, strict=True):
                for number in NUMBERS:
                    at, a, b = (getattr(v, number) for v in (best, low, high))
                    if at is not None and a is not None and b is not None and a != b:
                        apart.setdefault((best.joint, number), []).append((min(a, b) - at, max(a, b) - at))
    at = {(v.joint, number): getattr(v, number) for v in values for number in NUMBERS}
    return {
        key: (at[key] - sqrt(sum(low**2 for low, _ in parts)), at[key] + sqrt(sum(high**2 for _, high in parts)))
        for key, parts in apart.items()
    }


def _text(
    robot: str,
    dt: float,
    values: Sequence[ActuatorValues],
    ci: Mapping[tuple[str, str], Interval],
    notes: Sequence[str],
) -> str:
    lines = [HEAD.format(robot=robot), *(f"# not in these values: {note}" for note in notes)]
    lines += ["", f"robot = {json.dumps(robot)}", f"physics_dt = {_number(dt)}"]
    for v in values:
        joint = json.dumps(v.joint)
        lines += ["", f"[joint.{joint}]", f"actuator = {json.dumps(v.actuator)}", f"kind = {json.dumps(v.kind)}"]
        lines += [f"gear = {_number(v.gear)}"] if v.gear != 1.0 else []
        lines += [f"{n} = {_number(getattr(v, n))}" for n in NUMBERS if getattr(v, n) is not None]
        known = {n: ci[v.joint, n] for n in NUMBERS if (v.joint, n) in ci}
        if known:
            lines += [f"[joint.{joint}.ci95]"]
            lines += [f"{n} = [{_number(low)}, {_number(high)}]" for n, (low, high) in known.items()]
    for n, (group, keywords) in enumerate(_groups(values, ci, dt), start=1):
        lines += ["", f"[isaac_lab.group{n}]", f"class = {json.dumps(group)}", f"[isaac_lab.group{n}.keywords]"]
        lines += [f"{key} = {_value(value)}" for key, value in keywords.items()]
    lines += ["", "[newton]"]
    for array, number in NEWTON.items():
        lines.append(f"{array} = {_value({v.joint: x for v in values if (x := getattr(v, number)) is not None})}")
    lines.append(f"delay_steps = {_value({v.joint: round(v.delay / dt) for v in values})}")
    return "\n".join(lines) + "\n"


def _groups(
    values: Sequence[ActuatorValues], ci: Mapping[tuple[str, str], Interval], dt: float
) -> list[tuple[str, dict[str, Any]]]:
    """(class, keywords) of Isaac Lab's groups: joints that share a delay and a class. The delay's interval is covered:
    Isaac Lab draws from it."""
    groups: dict[tuple[str, int, int], list[ActuatorValues]] = {}
    for v in values:
        low, high = ci.get((v.joint, "delay"), (v.delay, v.delay))
        steps = (floor(low / dt + 1e-9), ceil(high / dt - 1e-9)) if high > low else (round(v.delay / dt),) * 2
        kind = "IdealPDActuatorCfg" if v.kind == "torque" else "ImplicitActuatorCfg"
        kind = "DelayedPDActuatorCfg" if steps[1] > 0 else kind
        groups.setdefault((kind, max(steps[0], 0), steps[1]), []).append(v)
    out = []
    for (kind, least, most), members in groups.items():
        keywords: dict[str, Any] = {"joint_names_expr": [v.joint for v in members]}
        for name, number in (
            ("stiffness", "stiffness"), ("damping", "damping"), ("armature", "armature"), ("friction", "friction"),
            ("dynamic_friction", "friction"), ("viscous_friction", "viscous_friction"),
            ("effort_limit", "effort_limit"),
        ):  # fmt: skip
            stated = {v.joint: x for v in members if (x := getattr(v, number)) is not None}
            if stated:
                keywords[name] = stated
        if kind == "DelayedPDActuatorCfg":
            keywords |= {"min_delay": least, "max_delay": most}
        out.append((kind, keywords))
    return out


def _value(value: Any) -> str:
    """A TOML value."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, list):
        return "[" + ", ".join(json.dumps(v) for v in value) + "]"
    return str(value) if isinstance(value, int) else _number(value)


def _number(value: float) -> str:
    """To nine digits, and a float for TOML."""
    text = f"{value:.9g}"
    return text if any(c in text for c in ".en") else f"{text}.0"
