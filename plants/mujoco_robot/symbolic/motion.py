"""Positions and velocities of the joints after one step, as a CasADi function.

The step is divided into substeps of at most STRETCH s. M and c are evaluated at the middle of a substep and held over
it, while servos and friction are integrated by Alexander's L-stable method of order 2 (SIAM J. Numer. Anal. 14(6),
1977, theorem 5 with s = 2).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.surroundings import tilted
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.symbolic.description import Changes, describe
from plants.mujoco_robot.symbolic.implicit import linear_step, velocities
from plants.mujoco_robot.symbolic.numbers import Parameters
from plants.mujoco_robot.symbolic.rigid_body import gravity_torques, mass_and_bias, tool_place
from plants.mujoco_robot.symbolic.torques import JointTorques, dry_clip
from residual_mpc.effects.body import TOOL_AXES
from residual_mpc.effects.chain import Chain
from residual_mpc.effects.library import changes
from residual_mpc.effects.ops import Kinks
from residual_mpc.extras import extra

STRETCH = 0.02  # s
GAMMA = 1.0 - math.sqrt(0.5)  # of a stretch: each implicit step of the method


def motion(robot: CompiledRobot, parameters: Parameters, errors: Chain, kinks: Kinks, dt: float) -> Any:
    """(q (n,), v (n,), u (nu,), p, push (n,) N m, clock s) -> (q+, v+), exact or smoothed according to `kinks`."""
    with extra("arm"):
        import casadi as ca

    n, nu = len(robot.joints), len(robot.actuators)
    q, v, u = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", nu)
    p, push, clock = ca.SX.sym("p", len(parameters.numbers)), ca.SX.sym("push", n), ca.SX.sym("clock")
    each = ca.vertsplit(p) if len(parameters.numbers) else []
    drives = JointTorques(robot, parameters, errors, kinks)
    body = describe(robot, changed(robot, parameters, each))
    pull = _gravity(robot, parameters, each, kinks)
    stretches = max(1, math.ceil(dt / STRETCH - 1e-9))
    whole = dt / stretches
    at, speed = q, v
    held: list[Any] = [0.0] * n
    for _ in range(stretches):
        middle = at + 0.5 * whole * speed
        mass, bias = mass_and_bias(body, pull, middle, speed)
        bias = bias - _compensated(robot, parameters, each, middle)
        at, speed, held = _stretch(drives, mass, bias, (at, speed, held), (u, each, push, clock), whole)
    names = ["q", "v", "u", "p", "push", "clock"]
    return ca.Function("motion", [q, v, u, p, push, clock], [at, speed], names, ["q_next", "v_next"], {"cse": True})


def forces(robot: CompiledRobot, parameters: Parameters, errors: Chain, kinks: Kinks) -> Any:
    """(q (n,), v (n,), u (nu,), p, clock s) -> (nu,) actuator forces before any force limit."""
    with extra("arm"):
        import casadi as ca

    n, nu = len(robot.joints), len(robot.actuators)
    q, v, u = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", nu)
    p, clock = ca.SX.sym("p", len(parameters.numbers)), ca.SX.sym("clock")
    each = ca.vertsplit(p) if len(parameters.numbers) else []
    drives = JointTorques(robot, parameters, errors, kinks)
    found = drives.forces(ca.vertsplit(q), ca.vertsplit(v), ca.vertsplit(u), each, clock)
    return ca.Function("forces", [q, v, u, p, clock], [ca.vertcat(*found)], ["q", "v", "u", "p", "clock"], ["force"])


def tool(robot: CompiledRobot, parameters: Parameters) -> Any:
    """(q (n,), p) -> (3,) position of the payload site in the world, m."""
    with extra("arm"):
        import casadi as ca

    q, p = ca.SX.sym("q", len(robot.joints)), ca.SX.sym("p", len(parameters.numbers))
    each = ca.vertsplit(p) if len(parameters.numbers) else []
    place, _ = tool_place(describe(robot, changed(robot, parameters, each)), q)
    return ca.Function("tool", [q, p], [place], ["q", "p"], ["place"])


def changed(robot: CompiledRobot, parameters: Parameters, p: Sequence[Any]) -> Changes:
    """The changes of masses, centres and lengths that the numbers p describe."""
    masses, added, shifts, offsets = {}, {}, {}, {}
    for b, link in enumerate(robot.links, start=1):
        name = f"body.{robot.model.body(b).name or b}.mass"
        if ("tune", "", name) in parameters.index:
            masses[b] = parameters.own(name, p)
        here = parameters.at(link, p, "link")
        more, moved = changes(here, "link mass"), changes(here, "link centre")
        if more is not None:
            added[b] = more
        if moved is not None:
            shifts[b] = moved
        longer = changes(parameters.at(link, p, "length"), "link length")
        if longer is not None and robot.lengths is not None and b in robot.lengths.lines:
            offsets[b] = longer
    here = parameters.at(robot.name, p, "tool")
    carried = changes(here, "tool mass")
    axes = tuple(TOOL_AXES.values())
    beside = [changes(here, quantity) for quantity in axes] if parameters.change(*axes) else None
    return Changes(masses, added, shifts, offsets, 0.0 if carried is None else carried, beside)


def _gravity(robot: CompiledRobot, parameters: Parameters, p: Sequence[Any], kinks: Kinks) -> tuple[Any, Any, Any]:
    """Gravity in the base frame, m/s^2."""
    here = parameters.at(robot.name, p, "gravity")
    roll, pitch = changes(here, "gravity roll"), changes(here, "gravity pitch")
    still = robot.model.opt.gravity.tolist()
    return tuple(still) if roll is None or pitch is None else tilted(still, roll, pitch, kinks.exact)


def _compensated(robot: CompiledRobot, parameters: Parameters, p: Sequence[Any], q: Any) -> Any:
    """(n,) N m (N) that the controller adds at positions q: a share of the gravity torques of the nominal model, at
    joints with a motor."""
    import casadi as ca

    share = changes(parameters.at(robot.name, p, "compensation"), "compensated gravity")
    if share is None or not parameters.change("compensated gravity"):
        return 0.0
    driven = ca.DM(np.isin(np.arange(len(robot.joints)), robot.driven).astype(float))
    return share * driven * gravity_torques(describe(robot, Changes()), robot.model.opt.gravity.tolist(), q)


def _stretch(
    drives: JointTorques, mass: Any, bias: Any, state: tuple[Any, Any, list[Any]], given: tuple[Any, ...], whole: float
) -> tuple[Any, Any, list[Any]]:
    """Integrate servos and friction over `whole` s with M and c held: Alexander's method of order 2, as two implicit
    steps. The second starts from the first's result extrapolated along its slope.
    """
    (at, speed, held), (u, p, push, clock) = state, given
    n = at.shape[0]
    rotors = drives.rotors(p)
    rows = [[mass[i, j] + (rotors[i] if i == j else 0.0) for j in range(n)] for i in range(n)]
    law = _Law(drives, rows, bias - push, u, p, clock, drives.limits(p), GAMMA * whole)
    first, fast, held = law.step(at, speed, held)
    ahead = (1.0 - GAMMA) / GAMMA
    return law.step(at + ahead * (first - at), speed + ahead * (fast - speed), held)


@dataclass(frozen=True, eq=False)
class _Law:
    """Quantities that are constant over a substep. h: length of an implicit step, s."""

    drives: JointTorques
    mass: list[list[Any]]
    bias: Any
    u: Any
    p: Sequence[Any]
    clock: Any
    limited: bool
    h: float

    def step(self, at: Any, speed: Any, held: list[Any]) -> tuple[Any, Any, list[Any]]:
        """Positions, velocities and dry friction after an implicit step."""
        import casadi as ca

        h, now, place, command = self.h, ca.vertsplit(speed), ca.vertsplit(at), ca.vertsplit(self.u)
        bias = ca.vertsplit(self.bias)
        torques = self.drives.torques(place, now, command, self.p, self.clock)
        step = linear_step(self.mass, bias, torques, now, h)
        if self.limited:  # the step without limits shows which forces reach theirs
            change = step.changes(held, h), h
            torques = self.drives.torques(place, now, command, self.p, self.clock, change)
            step = linear_step(self.mass, bias, torques, now, h)
        new, held = velocities(step, torques.dry, now, h, dry_clip(self.drives.kinks))
        after = ca.vertcat(*new)
        return at + h * after, after, held
