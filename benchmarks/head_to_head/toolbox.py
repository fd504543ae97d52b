"""The side of `mujoco.sysid`: its documented pipeline with its defaults, on the files of a case.

Where a choice had to be made, the kinder one was: the held command is handed over at the model's step, since
the toolbox joins samples by straight lines; and the joint's state is compared, since the sensors of a rollout
carry the stamp of the step that follows them. `observe="sensor"` undoes the second, to say what it costs.
"""

import contextlib
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any, Literal

import numpy as np

from benchmarks.head_to_head.files import FIELD, JOINT, TIMESTEP, read_runs
from benchmarks.head_to_head.servo import TOOL, TUNED, Log, Servo

BOUND = 20.0  # bounds are the guess divided and multiplied by this: out of every answer's way
# start, least, most; s, kg. Below a step the delay has no slope, so that a fit which gets there stays
OWN = {"delay": (0.005, TIMESTEP, 0.06), "payload": (0.05, 0.0, 1.0)}
SAMPLES = 80  # of the actuator's history buffer: more than the longest delay over the step


@dataclass(frozen=True)
class Fit:
    """What the toolbox returned: values and half-widths of its 95 % intervals by our names, and its report's words."""

    values: dict[str, float]
    half_widths: dict[str, float]
    says: str
    seconds: float


def fit(
    folder: Path,
    given: Servo,
    own: str | None,
    observe: Literal["state", "sensor"] = "state",
    report: Path | None = None,
) -> Fit:
    """Fit armature, damping and friction, and `own` (delay, payload) where it is named, to the runs of a case.

    observe: compare the joint's state or a jointpos sensor with the encoder; report: a folder for the toolbox's own
    report.html. Raises ModuleNotFoundError without `mujoco[sysid]`.
    """
    sysid = _toolbox()
    spec = _spec(folder / "servo.xml", own, observe)
    parameters = _parameters(sysid, given, own)
    sequences = [_sequences(sysid, spec, read_runs(folder / "runs"))]
    residual = sysid.build_residual_fn(models_sequences=sequences, n_threads=1)
    begin = perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # every iteration is printed, and nothing turns that off
        found, result = sysid.optimize(initial_params=parameters, residual_fn=residual)
    seconds = perf_counter() - begin
    left, _, _ = residual(found.as_vector(), found)
    _, intervals = sysid.calculate_intervals(left, result.jac)
    names = found.get_non_frozen_parameter_names()
    return Fit(
        dict(zip(names, found.as_vector().tolist(), strict=True)),
        dict(zip(names, np.asarray(intervals).tolist(), strict=True)),
        _words(sysid, sequences, parameters, found, residual, result, report),
        seconds,
    )


def _toolbox() -> ModuleType:
    sysid = import_module("mujoco.sysid")
    # with parts of its extra missing the module comes without names rather than not at all
    if not hasattr(sysid, "optimize"):
        raise ModuleNotFoundError("mujoco.sysid came without its names: pip install 'residual-mpc[sysid]'")
    from absl import logging

    logging.set_verbosity(logging.ERROR)  # a state in place of a sensor is warned of at every call
    return sysid


def _spec(model: Path, own: str | None, observe: str) -> Any:
    """The model of the guess, with the means to carry `own` where it is free."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(model))
    if own == "delay":
        actuator = spec.actuator(JOINT)
        # a linear history makes the delay continuous, so that a difference quotient of it exists
        actuator.nsample, actuator.interp, actuator.delay = SAMPLES, 1, OWN["delay"][0]
    if own == "payload":
        body = spec.body("arm").add_body(name="payload", pos=[0.0, 0.0, -TOOL])
        body.explicitinertial, body.mass, body.inertia = True, OWN["payload"][0], [1e-9] * 3
        body.ipos = [0.0, 0.0, 0.0]
    if observe == "sensor":
        spec.add_sensor(
            name="angle", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=JOINT
        )
    return spec


def _parameters(sysid: ModuleType, given: Servo, own: str | None) -> Any:
    parameters = sysid.ParameterDict()
    for name in TUNED:
        value = getattr(given, name)
        parameters.add(sysid.Parameter(name, value, value / BOUND, value * BOUND, modifier=_on_joint(FIELD[name])))
    if own is not None:
        parameters.add(sysid.Parameter(own, *OWN[own], modifier=_set_delay if own == "delay" else _set_payload))
    return parameters


def _on_joint(field: str) -> Callable[[Any, Any], None]:
    def set_it(spec: Any, parameter: Any) -> None:
        joint, value = spec.joint(JOINT), float(parameter.value[0])
        if field == "damping":  # a polynomial in MuJoCo 4
            joint.damping[0] = value
        else:
            setattr(joint, field, value)

    return set_it


def _set_delay(spec: Any, parameter: Any) -> None:
    spec.actuator(JOINT).delay = float(parameter.value[0])


def _set_payload(spec: Any, parameter: Any) -> None:
    spec.body("payload").mass = max(float(parameter.value[0]), 1e-9)


def _sequences(sysid: ModuleType, spec: Any, logs: list[Log]) -> Any:
    model = spec.compile()
    observed = ["angle"] if model.nsensor else [(f"{JOINT}_qpos", sysid.SignalType.MjStateQPos)]
    control, sensors, starts = [], [], []
    for log in logs:
        fine = np.arange(round(log.t[-1] / TIMESTEP) + 1) * TIMESTEP
        held = sysid.TimeSeries(log.t, log.command[:, None]).resample(fine + 1e-9, method="zero_order_hold").data
        control.append(sysid.TimeSeries.from_control_names(fine, held, model))
        sensors.append(sysid.TimeSeries.from_names(log.t, log.position[:, None], model, names=observed))
        starts.append(sysid.create_initial_state(model, np.zeros(1), np.zeros(1)))
    return sysid.ModelSequences(
        "servo", spec, [log.name for log in logs], starts, control, sensors, allow_missing_sensors=True
    )


def _words(
    sysid: ModuleType, sequences: Any, parameters: Any, found: Any, residual: Any, result: Any, report: Path | None
) -> str:
    """What the toolbox's own report says of the fit, in its first section."""
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
    built = sysid.default_report(
        sequences, parameters, found, residual, result, title="servo", save_path=report, generate_videos=False
    )
    titles = re.findall(r'insight-message">\s*<strong>(.*?):</strong>', built.build())
    return ", ".join(titles) or "nothing"
