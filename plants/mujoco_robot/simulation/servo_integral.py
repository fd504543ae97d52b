"""The integral parts of position servos: what they add to the setpoints, and what they hold as a window begins."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.force_ranges import raised
from plants.mujoco_robot.simulation.gravity_compensation import Compensation, compensation_of
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.library import changes, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.position_servo import held_integral
from residual_mpc.models.past_errors import PastErrors
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

SETTLING = 15.0  # s for which the servos are taken to have worked before a run begins


@dataclass(frozen=True, eq=False)
class ServoIntegrals:
    """effect, p: with parameters (B, nu), null at other actuators. low, high (B, nu): limits of the force over the
    servo's stiffness, command unit; derivative_time (B, nu): its damping over its stiffness, s. enabled (B, K, nu) or
    None: an actuator that is off forgets. value (B, nu): added now, command unit; changed in place."""

    effect: Effect
    p: Values
    low: np.ndarray
    high: np.ndarray
    derivative_time: np.ndarray
    enabled: np.ndarray | None
    value: np.ndarray

    def through(self, k: int, u: np.ndarray, length: np.ndarray, speed: np.ndarray, dt: float) -> np.ndarray:
        """The setpoints (B, nu) of step number k for commands u, at lengths and speeds of the actuators; then goes on
        by dt."""
        assert self.effect.step is not None
        out, error = u + self.value, u - length
        after = self.effect.step(NUMPY, self.p, self.value, error, dt)
        after = held_integral(NUMPY, self.value, after, error, self.derivative_time * speed, self.low, self.high)
        self.value[:] = after if self.enabled is None else after * (self.enabled[:, k] > 0)
        return out


def begin_integrals(
    batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive, setpoint: np.ndarray | None = None
) -> ServoIntegrals | None:
    """The integral parts at a window's start; None where no row has any. The batch holds the start's positions and
    velocities, and is left as it came. setpoint (B, nu): what reaches the servos at the start, where the drive has a
    past.

    What they held as the run began is what its first half second lacks in the balance of torques: gravity and springs
    less the servos' own. An integral part that takes long to settle is taken to have worked on that for SETTLING s.
    Since then it has summed up the logged errors, of the setpoints that a dead time and a lag had let through. Where
    nothing is known of the past, it holds the start's positions.
    """
    found = list(present(settings.effects, "servo"))
    if not found:
        return None
    effect, slots = found[0]
    servos = np.flatnonzero(robot.servo)
    p = {k: np.zeros((settings.rows, robot.model.nu)) for k in slots}
    for name, values in slots.items():
        p[name][:, servos] = values
    gain = batch.expand("actuator_gainprm")[:, :, 0]
    reach = raised(batch.expand("actuator_forcerange"), settings.effects)
    limited = (reach != 0.0).any(axis=2)
    stiff = np.where(gain > 0.0, gain, np.inf)
    low, high = (np.where(limited, reach[:, :, side] / stiff, end) for side, end in ((0, -np.inf), (1, np.inf)))
    rate, past, gear = p["gain"], drive.past, robot.model.actuator_gear[:, 0]
    bias = batch.expand("actuator_biasprm")[:, :, 2]  # less than 0 where a servo damps
    derivative_time = -bias / stiff
    borne = compensation_of(robot, settings, drive.setting)
    if past is None:
        at = batch.bind("qpos")[:, robot.places[robot.driven]].copy()
        value = _needed(batch, robot, at, np.zeros_like(at), borne) / (gear * stiff)
    else:
        needed = _needed(batch, robot, past.first_at, past.first_rate, borne) / gear - gear * bias * past.first_rate
        first = needed / stiff - (past.first_sent - gear * past.first_at)
        first = (1.0 - np.exp(-SETTLING * rate)) * (first - rate * (past.early_sent - gear * past.early_turned))
        arrived = past.sent - _held_back(settings, drive, past, setpoint)
        value = past.known * (past.whole * first + rate * (arrived - gear * past.turned))
    if past is None or setpoint is None:
        value = np.clip(value, low, high)
    else:
        q, v = batch.bind("qpos")[:, robot.places[robot.driven]], batch.bind("qvel")[:, robot.dofs[robot.driven]]
        nothing = np.zeros_like(value)
        value = held_integral(NUMPY, nothing, value, setpoint - gear * q, derivative_time * gear * v, low, high)
    value = np.where(rate > 0.0, value, 0.0)
    if drive.enabled is not None and drive.steps:
        value = value * (drive.enabled[:, 0] > 0)
    return ServoIntegrals(effect, p, low, high, derivative_time, drive.enabled, value)


def _held_back(settings: Settings, drive: Drive, past: PastErrors, setpoint: np.ndarray | None) -> np.ndarray | float:
    """(B, nu) command unit s: how far the integral of the setpoint lags behind that of the command. A dead time D still
    holds the integral over the last D, a lag T holds T times its output; less what both held at the beginning. Commands
    that act before their stamps count as in time."""
    delay, lag = changes(settings.effects, "command delay"), changes(settings.effects, "command lag")
    if setpoint is None or (delay is None and lag is None):
        return 0.0
    late, slow = (np.zeros_like(setpoint) if x is None else np.maximum(x, 0.0) for x in (delay, lag))
    steps = np.minimum(late / drive.dt, drive.lead)
    last = drive.command[:, : drive.lead][:, ::-1]
    total = np.concatenate([np.zeros_like(last[:, :1]), np.cumsum(last, axis=1)], axis=1)  # of the last 0, 1, ... steps
    whole = np.minimum(steps.astype(int), max(drive.lead - 1, 0))[:, None]
    less, more = (np.take_along_axis(total, np.minimum(whole + n, drive.lead), axis=1)[:, 0] for n in (0, 1))
    recent = drive.dt * (less + (steps - whole[:, 0]) * (more - less))
    return np.asarray(recent + slow * setpoint - (late + slow) * past.begun_sent)


def _needed(
    batch: Any, robot: CompiledRobot, at: np.ndarray, rate: np.ndarray, borne: Compensation | None
) -> np.ndarray:
    """(B, nu) N m that the motors' joints need at these positions and rates (B, nu), accelerations apart, beside what
    the controller compensates."""
    q, v = batch.bind("qpos"), batch.bind("qvel")
    bias, passive = batch.bind("qfrc_bias"), batch.bind("qfrc_passive")
    kept = q.copy(), v.copy()
    known = robot.servo
    q[:, robot.places[robot.driven[known]]] = at[:, known]
    v[:] = 0.0
    v[:, robot.dofs[robot.driven[known]]] = rate[:, known]
    if robot.loops is not None:
        robot.loops.close(q, v)
    batch.forward()
    dofs = robot.dofs[robot.driven]
    needed = bias[:, dofs] - passive[:, dofs] - (0.0 if borne is None else borne.torques(q)[:, dofs])
    q[:], v[:] = kept
    return np.asarray(needed)
