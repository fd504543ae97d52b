"""The augmented model as CasADi functions with exact derivatives, parameters as arguments."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.effects.library import LIBRARY
from residual_mpc.effects.ops import casadi_ops
from residual_mpc.export.augmented import Augmented
from residual_mpc.export.soften import kinks
from residual_mpc.extras import extra

# Inside a dead zone or play, or while a joint sticks, a small change of a command has no effect: the exact derivatives
# are 0 there, and an optimiser that linearises never moves. Controllers use the derivatives with these parameters at 0.
STALLING = frozenset((effect.name, parameter) for effect in LIBRARY for parameter in effect.stalls)


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """x (nx, 1), u (nu, 1), p (np, 1): SX symbols; step: x+ as an SX expression of them.

    f: casadi Function (x, u, p) -> x+, named "step"; stage: (x, u, p) -> x+, A = dx+/dx (nx, nx), B = dx+/du (nx, nu).
    through: the same x+, with A and B of a robot whose `STALLING` parameters are 0: no dead zone, play or dry friction.
    y: SX expression of x, and output: x -> y, C = dy/dx (ny, nx), where the robot tracks something else than its poses,
    else None. effort: (x, u, p) -> forces F (nu,), dF/dx, dF/du, where the robot's step states them, else None.
    x_names, u_names, p_names, y_names say the order; p0 (np,) the values now.
    """

    x: Any
    u: Any
    p: Any
    step: Any
    f: Any
    stage: Any
    through: Any
    y: Any
    output: Any
    effort: Any
    x_names: tuple[str, ...]
    u_names: tuple[str, ...]
    p_names: tuple[str, ...]
    y_names: tuple[str, ...]
    p0: np.ndarray
    dt: float


def casadi_model(model: Augmented) -> CasadiModel:
    """The model's step in SX, which is faster than MX for networks of this size."""
    with extra("mpc"):
        import casadi as ca

    x, u, p = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu), ca.SX.sym("p", len(model.p))
    new = ca.vertcat(*model.step(casadi_ops(), ca.vertsplit(x), ca.vertsplit(u), ca.vertsplit(p)))
    names = ["x", "u", "p"]
    f = ca.Function("step", [x, u, p], [new], names, ["x_next"])
    dense: list[Any] = [ca.densify(new), ca.densify(ca.jacobian(new, x)), ca.densify(ca.jacobian(new, u))]
    stage = ca.Function("stage", [x, u, p], dense, names, ["x_next", "A", "B"])
    through, stalling = stage, [n.stalls or (n.effect, n.parameter) in STALLING for n in model.stepped.numbers]
    if any(stalling):
        numbers = ca.vertcat(*(0.0 if s else p[i] for i, s in enumerate(stalling)), p[len(stalling) :])
        through = ca.Function("through", [x, u, p], [dense[0], *stage(x, u, numbers)[1:]], names, ["x_next", "A", "B"])
    output, y = None, None
    if model.stepped.output is not None:
        y = ca.vertcat(*model.stepped.output(casadi_ops(), ca.vertsplit(x)))
        output = ca.Function("output", [x], [ca.densify(y), ca.densify(ca.jacobian(y, x))], ["x"], ["y", "C"])
    effort = None
    if model.stepped.effort is not None:
        how = kinks(casadi_ops(), 0.0)
        own = ca.vertsplit(p)[: len(stalling)]
        force = ca.vertcat(*model.stepped.effort(how, ca.vertsplit(x), ca.vertsplit(u), own))
        slopes: list[Any] = [ca.densify(force), ca.densify(ca.jacobian(force, x)), ca.densify(ca.jacobian(force, u))]
        effort = ca.Function("effort", [x, u, p], slopes, names, ["force", "by_x", "by_u"])
    commands = tuple(f"command.{c}" for c in model.stepped.commands)
    return CasadiModel(
        x, u, p, new, f, stage, through, y, output, effort, model.stepped.states, commands, model.parameters,
        model.stepped.tracked, model.p, model.build.dt,
    )  # fmt: skip
