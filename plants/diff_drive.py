"""The differential drive of the paper (the equation labelled wheel_prop), batched in numpy, with its effects."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from plants.diff_drive_step import RATES, drive_step
from plants.outline import two_wheels
from residual_mpc.effects.chain import OUTPUT, in_turn, where_it_acts
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.ground import ground_twist, radius_factor, with_fitted_rates, world_drift
from residual_mpc.effects.library import Effects, Sites, present, slots_of
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.speed_chain import speeds_and_ends
from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import StepOptions, Stepped

WHEELS = ("left", "right")
POSE = ("pose.x", "pose.y", "pose.theta")
TURTLEBOT3 = {"wheel_radius": 0.033, "track_width": 0.16}  # m, the Burger's: the built-in robot
RESPONSE = 0.05  # s, over which a wheel's acceleration is taken: a tyre's relaxation and a small motor's response


@dataclass(frozen=True)
class DiffDrive:
    """A planar robot on two driven wheels; commands are wheel speeds in rad/s."""

    name: str
    wheel_radius: float  # m
    track_width: float  # m, wheel centre to wheel centre
    actuators: tuple[str, ...] = WHEELS
    command_kinds: tuple[str, ...] = ("speed", "speed")
    step: float | None = None

    @property
    def states(self) -> tuple[State, ...]:
        return tuple(State(c, None) for c in POSE)

    @property
    def channels(self) -> tuple[str, ...]:
        return (*POSE, "twist.x", "twist.y", "twist.theta", "velocity.left", "velocity.right")

    @property
    def sites(self) -> Sites:
        """Where effects can act. A bias of pose.x or pose.y only shifts the world and is not observable; a bias of
        twist.theta is that of a gyroscope. Another scale of it is what another track gives, and another scale of an
        encoder what other gains give: neither can be told where it shows, and beside a pose neither shows."""
        robot = (self.name,)
        return {
            **dict.fromkeys(("command", "strength", "limit", "output", "play", "roundness"), WHEELS),
            **dict.fromkeys(("pair", "pair command", "rolling", "rim", "side", "drift", "point", "samples"), robot),
            **dict.fromkeys(("delay", "filter", "clock"), ("pose",)),
            "rate": RATES,
            "offset": ("pose.theta", "twist.theta"),
            "range": ("pose.theta",),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return -np.inf, np.inf

    def reference(self, kind: str, slot: str | None) -> float:
        return {"length": self.track_width}.get(kind, 1.0)

    def nominal(self) -> Mapping[str, float]:
        return {"wheel_radius": self.wheel_radius, "track_width": self.track_width}

    @property
    def outline(self) -> np.ndarray:
        """See residual_mpc.models.drawing.Outlined: its wheels where they are, its body guessed."""
        return two_wheels(self.track_width, self.wheel_radius)

    def outputs_from(self, value: Mapping[str, float], rate: Mapping[str, float]) -> Mapping[str, float]:
        """Wheel speeds, rad/s, that move the pose at this rate: the inverse of the paper's wheel_prop."""
        theta, yaw = value["pose.theta"], rate["pose.theta"]
        forward = np.cos(theta) * rate["pose.x"] + np.sin(theta) * rate["pose.y"]
        half = 0.5 * self.track_width * yaw
        return {"left": (forward - half) / self.wheel_radius, "right": (forward + half) / self.wheel_radius}

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """See residual_mpc.models.stepping.Stepping."""
        return drive_step(self.nominal(), self.name, settings, options, RESPONSE)

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        dt, effects = drive.dt, settings.effects
        slips = any(present(effects, "rim"))
        remembers = slips or any(e.remembers for e, _ in present(effects, "play", *OUTPUT))
        # play and acceleration know the motion before the window; an encoder read at its start shows the step before
        lead = drive.lead if remembers else min(1, drive.lead)
        encoders = any(c.startswith(("velocity.", "output.")) for c in wanted)
        motor, reached = _motor_speed(effects, drive, lead, encoders)  # (B, lead + K, 2) rad/s
        wheel = _wheel_speed(effects, motor, dt)
        accel = _acceleration(wheel, lead, dt) if slips else np.zeros((1, 1, 2))
        wheel, reached = wheel[:, lead:], reached[:, max(lead - 1, 0) :]
        radius = settings.tuned.get("wheel_radius", np.array([self.wheel_radius]))[:, None]
        track = settings.tuned.get("track_width", np.array([self.track_width]))[:, None]
        forward, sideways, yaw = ground_twist(
            NUMPY, effects, radius, track, (wheel[..., 0], wheel[..., 1]), (accel[..., 0], accel[..., 1]),
            _roundness(effects, wheel, drive),
        )  # fmt: skip
        laws = [{e.name: {k: v[:, [i]] for k, v in p.items()} for e, p in present(effects, "rate")} for i in range(3)]
        forward, sideways, yaw = with_fitted_rates(NUMPY, (forward, sideways, yaw), laws)
        theta = _integrate(start["pose.theta"], yaw, dt)
        middle = 0.5 * (theta[:, 1:] + theta[:, :-1])  # exact to second order for a speed held over the step
        c, s = np.cos(middle), np.sin(middle)
        rates = {"x": forward * c - sideways * s, "y": forward * s + sideways * c, "theta": yaw}
        drift = world_drift(NUMPY, effects)
        if drift is not None:
            rates["x"], rates["y"] = rates["x"] + drift[0], rates["y"] + drift[1]
        out: dict[str, np.ndarray] = {}
        for channel in wanted:
            kind, _, axis = channel.partition(".")
            if channel == "pose.theta":
                out[channel] = theta
            elif kind == "pose":
                out[channel] = _integrate(start[channel], rates[axis], dt)
            elif kind == "twist":
                out[channel] = _at_nodes(rates[axis])
            else:  # velocity.<wheel>, output.<wheel>: an encoder is read before the command of its stamp acts
                speed = reached[..., WHEELS.index(axis)]
                out[channel] = speed if lead else np.concatenate([speed[:, :1], speed], axis=1)
        return out


def build(robot: RobotFile) -> DiffDrive:
    """The robot of a file whose plant is `diff_drive`. Raises BadInput for parameters that are missing or not
    positive.
    """
    parameters = {**TURTLEBOT3, **robot.parameters}
    where = robot.source or robot.name
    for name, value in parameters.items():
        if name not in TURTLEBOT3:
            raise BadInput(
                f"unknown parameter {name!r}",
                where,
                "the parameters of diff_drive are wheel_radius (m) and track_width (m)",
            )
        if not (np.isfinite(value) and value > 0):
            raise BadInput(f"parameter {name} must be a positive length in metres, got {value}", where)
    if robot.parameters and len(robot.parameters) < 2:
        missing = (TURTLEBOT3.keys() - robot.parameters.keys()).pop()
        raise BadInput(f"parameter {missing} is missing", where, f"add {missing} in metres under [parameters]")
    return DiffDrive(robot.name, parameters["wheel_radius"], parameters["track_width"])


def _motor_speed(effects: Effects, drive: Drive, lead: int, ends: bool) -> tuple[np.ndarray, np.ndarray]:
    """(B, lead + K, 2) rad/s: the motors' mean speeds over the steps from `lead` before the window on, and at their
    ends, which an encoder on the motor sees."""
    begin = drive.lead - lead
    mean, end = speeds_and_ends(effects, drive.command, drive.on, drive.clock_at_steps, drive.dt, ends)
    return mean[:, begin:], end[:, begin:]


def _wheel_speed(effects: Effects, motor: np.ndarray, dt: float) -> np.ndarray:
    """(B, lead + K, 2) rad/s: the wheels' speeds behind the play of their gears."""
    for effect, p in present(effects, "play"):
        motor = where_it_acts(effect, p, motor, partial(_behind_play, effect, dt))
    return motor


def _behind_play(effect: Effect, dt: float, p: Values, motor: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(B, K, 2) rad/s: wheels' speeds behind a play, in all of these rows."""
    assert effect.start is not None and effect.step is not None
    step, clock = effect.step, np.zeros(1)
    moving = np.argmax(motor != 0, axis=1)  # (B, 2) first step in motion: it tells which stop the play rests on
    x = effect.start(NUMPY, p, np.take_along_axis(motor, moving[:, None, :], axis=1)[:, 0])
    return in_turn(lambda k, now, x: step(NUMPY, p, x, now, clock, dt), motor, x)


def _acceleration(wheel: np.ndarray, lead: int, dt: float) -> np.ndarray:
    """(B, K, 2) rad/s^2: mean acceleration over the last RESPONSE s, from speeds (B, lead + K, 2).

    Held commands are a staircase, on which an acceleration is a spike as high as the step is short; neither a motor
    nor a tyre answers so fast.
    """
    span = max(1, round(RESPONSE / dt))
    earlier = np.concatenate([np.repeat(wheel[:, :1], span, axis=1), wheel[:, :-span]], axis=1)
    return np.asarray((wheel - earlier)[:, lead:] / (span * dt))


def _roundness(effects: Effects, wheel: np.ndarray, drive: Drive) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Factors (B, K) on the radii of the left and the right wheel in the middle of each step; None for 1. wheel
    (B, K, 2) rad/s; a drive that knows no angle begins at 0."""
    uneven = list(present(effects, "roundness"))
    if not uneven:
        return None, None
    angle = drive.dt * (np.cumsum(wheel, axis=1) - 0.5 * wheel)
    angle = angle if drive.angle is None else angle + drive.angle[:, None, :]
    each = [{e.name: {k: v[:, [i]] for k, v in p.items()} for e, p in uneven} for i in (0, 1)]
    left, right = (radius_factor(NUMPY, each[i], angle[..., i]) for i in (0, 1))
    return left, right


def _integrate(start: np.ndarray, rate: np.ndarray, dt: float) -> np.ndarray:
    """(B, K + 1) from start (B,) and the rate held over each step (B, K)."""
    out = np.empty((rate.shape[0], rate.shape[1] + 1))
    out[:, 0] = 0.0
    np.cumsum(rate * dt, axis=1, out=out[:, 1:])
    return out + start[:, None]


def _at_nodes(held: np.ndarray) -> np.ndarray:
    """(B, K + 1) values at the nodes from values held over the steps (B, K)."""
    ends = np.concatenate([held[:, :1], held, held[:, -1:]], axis=1)
    return 0.5 * (ends[:, 1:] + ends[:, :-1])
