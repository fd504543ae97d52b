"""An augmented model written to files for others, each with how far it lies from its source."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.agreement import NETWORK_UNIT, Agreement, Step, agreement, far_from_replay, position_unit
from residual_mpc.export.augmented import Augmented, settings_from
from residual_mpc.export.casadi_model import CasadiModel, casadi_model
from residual_mpc.extras import extra
from residual_mpc.files import write_atomically
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.logged_laws import columns_at
from residual_mpc.models.model_file import Written, model_in
from residual_mpc.models.parameter_units import command_units, parameter_unit
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob
from residual_mpc.models.simulating import WritesMjcf

Target = Literal["casadi", "c", "jax", "onnx"]
TARGETS: tuple[Target, ...] = ("casadi", "c", "jax", "onnx")


def write_model(model: Augmented, to: Target, folder: Path, rng: np.random.Generator) -> dict[str, Any]:
    """Write the files of one target and describe them: names, order and values of p, differences from the source.

    Raises BadInput for a target that this model cannot have, with the reason.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if to == "onnx":
        return write_network(model.residual, model.robot.name, folder)
    if to == "jax":
        _import_jax()  # first, since its extra installs CasADi as well
    c = casadi_model(model)
    writers = {"casadi": _casadi, "c": _c, "jax": _jax}
    files, step = writers[to](model, c, folder)
    apart = agreement(model, step, rng)
    if not math.isfinite(apart.largest):
        for name in (*files, "export.json"):
            (folder / name).unlink(missing_ok=True)
        raise BadInput(
            "the exported step gives values that are not finite where the model is sampled", f"`to={to}`",
            "export without `smooth`; if that fails too, a number of the model may be far out of range",
        )  # fmt: skip
    document = describe(model, c, to, files, apart)
    write_atomically(folder / "export.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    return document


def write_mjcf(written: Written, robot: Robot, folder: Path) -> dict[str, Any]:
    """Write the effects of a diagnosis.json or model.json into the robot's MJCF, and describe it.

    Raises BadInput for a robot that is no MuJoCo model, a model of another robot, or one with a network.
    """
    settings = settings_from(written, robot)
    if not isinstance(robot, WritesMjcf):
        raise BadInput(
            f"{robot.name!r} is not a rigid-body model and cannot be exported as MJCF", "`to=mjcf`",
            "export to casadi, c or jax",
        )  # fmt: skip
    if residual_in(written) is not None:
        raise BadInput("an MJCF cannot contain a network", written.where, "export the diagnosis that it was learned on")
    made, logged = robot.to_mjcf(settings, folder), columns_at(model_in(written)[1])
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "model.xml", made.text)
    document = {
        "to": "mjcf",
        "robot": robot.name,
        "files": {"model.xml": "the model with the effects that MuJoCo can express"},
        "approximated": [*made.approximated, *(f"fitted_law: at {x:.4g} of {c}" for c, x in logged.items())],
        "left_out": list(made.left_out),
        "largest_difference": {
            "joints": made.apart, "largest": made.apart, "points": made.points, "from_all_effects": made.apart_from_all,
            "unit": position_unit(robot),
        },
    }  # fmt: skip
    write_atomically(folder / "export.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    return document


def describe(model: Augmented, c: CasadiModel, to: str, files: Mapping[str, str], apart: Agreement) -> dict[str, Any]:
    """What a user of the files needs to know; also export.json."""
    return {
        "to": to,
        "robot": model.robot.name,
        "dt": model.build.dt,
        "smooth": model.build.smooth,
        "logged": dict(model.build.logged),
        "states": [{"name": n, "unit": u} for n, u in zip(c.x_names, _state_units(model), strict=True)],
        "outputs": [
            {"name": n, "unit": u} for n, u in zip(model.stepped.outputs, model.stepped.output_units, strict=True)
        ],
        "approximated": _at_another_step(model),
        "left_out": list(model.stepped.left_out),
        "warnings": far_from_replay(apart, model),
        "commands": list(c.u_names),
        "command_units": list(command_units(model.robot)),
        "parameters": [
            {"name": n, "value": float(v), "unit": u} for n, v, u in zip(c.p_names, c.p0, _units(model), strict=True)
        ],
        "rest": model.start().tolist(),
        "sensor_effects": {
            e: {p: v[0].tolist() for p, v in ps.items()}
            for e, ps in model.settings.effects.items()
            if e.startswith("sensor_")
        },
        "files": dict(files),
        "largest_difference": {**asdict(apart), "largest": apart.largest},
    }


def _at_another_step(model: Augmented) -> list[str]:
    """What a network loses at another step than its own is not measured here."""
    r, dt = model.residual, model.build.dt
    if r is None or math.isclose(r.step, dt):
        return []
    return [f"the network, learned at a step of {r.step:.3g} s and used at {dt:.3g} s: what that costs is not measured"]


def _state_units(model: Augmented) -> list[str]:
    """Of x; a command that is remembered has that of its actuator."""
    units = dict(zip(model.robot.actuators, command_units(model.robot), strict=True))
    out = []
    for name, unit in zip(model.stepped.states, model.stepped.units, strict=True):
        rest = name.partition(".")[2]
        mine = next((u for a, u in units.items() if rest == a or rest.startswith(f"{a}.")), unit)
        out.append(mine if unit == "command unit" else unit)
    return out


def _units(model: Augmented) -> list[str]:
    """Of p; the network's weights have none."""
    numbers = model.stepped.numbers
    known = [parameter_unit(model.robot, Knob(n.effect, n.slot or None, n.parameter)) or n.unit for n in numbers]
    return [*known, *("1",) * (len(model.parameters) - len(known))]


def _casadi(model: Augmented, c: CasadiModel, folder: Path) -> tuple[dict[str, str], Step]:
    import casadi as ca

    c.f.save(str(folder / "step.casadi"))
    c.stage.save(str(folder / "stage.casadi"))
    if c.output is not None:
        c.output.save(str(folder / "output.casadi"))
    loaded = ca.Function.load(str(folder / "step.casadi"))
    files = {
        "step.casadi": "casadi.Function.load: (x, u, p) -> x_next",
        "stage.casadi": "(x, u, p) -> x_next, A = dx_next/dx, B = dx_next/du",
    }
    if c.output is not None:
        files["output.casadi"] = "x -> y, C = dy/dx: the output that a controller tracks"
    return files, _mapped(loaded, c.p0)


def _c(model: Augmented, c: CasadiModel, folder: Path) -> tuple[dict[str, str], Step]:
    import casadi as ca

    from residual_mpc.export.compiled import compiled, compiler

    generator = ca.CodeGenerator("model.c", {"with_header": True})
    generator.add(c.f)
    generator.add(c.stage)
    if c.output is not None:
        generator.add(c.output)
    generator.generate(f"{folder}/")
    header = folder / "model.h"
    write_atomically(header, _signature(model, c) + header.read_text(encoding="utf-8"))
    # where no compiler is found the functions behind the source are compared, and the file says so
    files = {
        "model.c": "C functions step and stage (and output, if the robot tracks a task), which need only libm"
        + ("" if compiler() else "; not compiled, since no C compiler was found"),
        "model.h": "their declarations",
    }
    return files, _mapped(compiled(c.f, compiler()), c.p0)


def _signature(model: Augmented, c: CasadiModel) -> str:
    """A comment that names the entries of x, u and p with their units and values."""
    commands = command_units(model.robot)
    rows = [
        *(f"x[{i}] {n} [{u}]" for i, (n, u) in enumerate(zip(c.x_names, _state_units(model), strict=True))),
        *(f"u[{i}] {n} [{u}]" for i, (n, u) in enumerate(zip(c.u_names, commands, strict=True))),
        *(
            f"p[{i}] {n} [{u}] = {v:.12g}"
            for i, (n, u, v) in enumerate(zip(c.p_names, _units(model), c.p0, strict=True))
        ),
    ]
    lines = "".join(f"\n   {row.replace('*/', '* /')}" for row in rows)
    return f"/* step: (x, u, p) -> x_next of {model.robot.name}, dt = {model.build.dt:g} s{lines}\n*/\n"


def _jax(model: Augmented, c: CasadiModel, folder: Path) -> tuple[dict[str, str], Step]:
    from residual_mpc.export.jax_source import jax_source

    jax, jnp = _import_jax()
    source = jax_source(c, f"The augmented model of {model.robot.name}.", model.start().tolist())
    write_atomically(folder / "model_jax.py", source)
    space: dict[str, Any] = {}
    exec(compile(source, "model_jax.py", "exec"), space)  # the very file that was written

    def step(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        before = bool(getattr(jax.config, "jax_enable_x64", False))
        jax.config.update("jax_enable_x64", True)
        try:
            many = jax.jit(jax.vmap(space["step"], in_axes=(0, 0, None)))
            return np.asarray(many(jnp.asarray(x), jnp.asarray(u), jnp.asarray(c.p0)))
        finally:
            jax.config.update("jax_enable_x64", before)

    return {"model_jax.py": "step(x, u, p), for jit, vmap and grad"}, step


def _import_jax() -> tuple[Any, Any]:
    with extra("jax"):
        import jax
        import jax.numpy as jnp
    return jax, jnp


def write_network(residual: Residual | None, robot: str, folder: Path) -> dict[str, Any]:
    """Write a learned network as ONNX, which needs nothing else of the robot. Raises BadInput where there is none."""
    from residual_mpc.export.onnx_network import to_onnx

    if residual is None:
        raise BadInput("the model contains no network", "`to=onnx`", "learn one with `residual-mpc learn`")
    folder.mkdir(parents=True, exist_ok=True)
    apart = to_onnx(residual, folder / "residual.onnx")
    document = {
        "to": "onnx",
        "robot": robot,
        "inputs": list(residual.inputs),
        "outputs": list(residual.outputs),
        "files": {"residual.onnx": "only the network: z -> delta, in physical units"},
        "largest_difference": {"network": apart, "largest": apart, "points": 500, "unit": NETWORK_UNIT},
    }
    write_atomically(folder / "export.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    return document


def _mapped(function: Any, p: np.ndarray) -> Step:
    def step(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array(function.map(len(x))(x.T, u.T, np.tile(p[:, None], len(x)))).T

    return step
