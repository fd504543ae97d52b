"""One step of the differential drive with its effects, for any array library: what exports and controllers use.

The equations are those of the replay, effect by effect; here they are strung together in time order, with what they
remember as states, so that the step can be differentiated and put into an optimiser.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.effects.actuator import backlash_step, gain_step, lag_step, sag_step, saturation_step
from residual_mpc.effects.command import dead_zone_step, delay_step
from residual_mpc.effects.contact import ground_twist, slope_drift
from residual_mpc.effects.library import BY_NAME, ORDER, PLUGGED
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import TUNE, Settings
from residual_mpc.models.stepping import Correction, Kinks, Number, StepOptions, Stepped

WHEELS = ("left", "right")
POSE = ("pose.x", "pose.y", "pose.theta")
BODY = ("body.forward", "body.sideways", "body.yaw")  # m/s, m/s, rad/s
WORLD = ("twist.x", "twist.y", "twist.theta")  # m/s, m/s, rad/s
COMMANDS = ("command.left", "command.right")  # rad/s
CONTACT = ("wheel_radius", "wheel_radius_mismatch", "track_width", "lateral_slip", "longitudinal_slip", "slope")
ACTUATOR = ("actuator_gain", "voltage_sag", "saturation")  # in the order of the replay
SENSOR = ("sensor_delay", "sensor_bias", "sensor_mounting", "sensor_outliers")  # the estimator's part, not the model's
ENDLESS = 1e4  # rad/s for a wheel that has no limit: a smoothed minimum would make NaN of infinity
UNIT = dict(zip((*POSE, *BODY, *WORLD), ("m", "m", "rad", *("m/s", "m/s", "rad/s") * 2), strict=True))


@dataclass(frozen=True)
class DriveStep:
    """What the step needs to know beside its numbers: which effects there are, and how long each memory is."""

    dt: float  # s
    effects: frozenset[str]
    line: int  # past commands a wheel
    span: int  # past speeds a wheel, over which its acceleration is taken
    options: StepOptions
    index: Mapping[tuple[str, str, str], int]  # (effect, slot, parameter) -> place in p

    @property
    def states(self) -> tuple[str, ...]:
        """Pose first, then what is remembered, newest first."""
        names = [*POSE]
        for wheel in WHEELS:
            names += [f"sent.{wheel}.{j}" for j in range(1, self.line + 1)]
        if "actuator_lag" in self.effects:
            names += [f"lag.{wheel}" for wheel in WHEELS]
        if "backlash" in self.effects:
            names += [f"play.{wheel}" for wheel in WHEELS]
        if "longitudinal_slip" in self.effects:
            names += [f"speed.{wheel}.{j}" for wheel in WHEELS for j in range(1, self.span + 1)]
        names += [f"last.{s}" for s in self.options.remember]
        names += [f"disturbance.{s}" for s in self.options.disturbances]
        if "voltage_sag" in self.effects:
            names.append("clock")
        return tuple(names)

    def __call__(
        self,
        kinks: Kinks,
        x: Sequence[Array],
        u: Sequence[Array],
        p: Sequence[Array],
        correction: Correction | None,
    ) -> tuple[Array, ...]:
        dt, ops = self.dt, kinks.exact
        now = dict(zip(self.states, x, strict=True))
        new: dict[str, Array] = {}
        wheel = [self._wheel(kinks, i, u[i], p, now, new) for i in (0, 1)]
        body = self._ground(kinks, wheel, p, now, new)
        signals: dict[str, Array] = dict(zip(BODY, body, strict=True))
        signals |= dict(zip(COMMANDS, u, strict=True))
        signals |= {name: now[name] for name in self.states if name.startswith("last.")}
        drift = self._drift(ops, p)
        half = now[POSE[2]] + 0.5 * dt * body[2]
        c, s = ops.cos(half), ops.sin(half)
        world = (body[0] * c - body[1] * s + drift[0], body[0] * s + body[1] * c + drift[1], body[2])
        signals |= {f"model.{name}": v for name, v in zip(WORLD, world, strict=True)}
        added = dict(correction(signals)) if correction is not None else {}
        unknown = set(added) - {*BODY, *WORLD}
        if unknown:
            raise KeyError(
                f"a correction may add only to {(*BODY, *WORLD)} of the differential drive, got {sorted(unknown)}"
            )
        for name in self.options.disturbances:
            added[name] = added[name] + now[f"disturbance.{name}"] if name in added else now[f"disturbance.{name}"]
            new[f"disturbance.{name}"] = now[f"disturbance.{name}"]
        forward, sideways, yaw = (signals[s] + added[s] if s in added else signals[s] for s in BODY)
        if WORLD[2] in added:
            yaw = yaw + added[WORLD[2]]
        middle = now[POSE[2]] + 0.5 * dt * yaw  # exact to second order for a speed held over the step
        c, s = ops.cos(middle), ops.sin(middle)
        rate = [forward * c - sideways * s + drift[0], forward * s + sideways * c + drift[1], yaw]
        for i in (0, 1):
            if WORLD[i] in added:
                rate[i] = rate[i] + added[WORLD[i]]
        along = (rate[0] * c + rate[1] * s, rate[1] * c - rate[0] * s, yaw)  # all that moves it, in its own frame
        moving = dict(zip((*BODY, *WORLD), (*along, *rate), strict=True))
        new |= {f"last.{s}": moving[s] for s in self.options.remember}
        new |= {name: now[name] + dt * v for name, v in zip(POSE, rate, strict=True)}
        if "clock" in now:
            new["clock"] = now["clock"] + dt
        return tuple(new[name] for name in self.states)

    def _drift(self, ops: Ops, p: Sequence[Array]) -> tuple[Array, Array]:
        return slope_drift(ops, self._values("slope", 0, p)) if "slope" in self.effects else (0.0, 0.0)

    def _values(self, effect: str, slot: int, p: Sequence[Array]) -> dict[str, Array]:
        name = WHEELS[slot] if (effect, WHEELS[slot], BY_NAME[effect].parameters[0].name) in self.index else ""
        return {q.name: p[self.index[effect, name, q.name]] for q in BY_NAME[effect].parameters}

    def _wheel(
        self, kinks: Kinks, i: int, u: Array, p: Sequence[Array], now: Mapping[str, Array], new: dict[str, Array]
    ) -> Array:
        """Mean speed of wheel i over the step, rad/s, from its command; fills its part of the new memory."""
        dt, wheel, ops = self.dt, WHEELS[i], kinks.exact
        rough = kinks.rough(1.0)
        y = u
        if self.line:
            past = tuple(now[f"sent.{wheel}.{j}"] for j in range(1, self.line + 1))
            y, line = delay_step(ops, self._values("command_delay", i, p), (*past, past[-1]), u, dt)
            new |= {f"sent.{wheel}.{j + 1}": line[j] for j in range(self.line)}
        if "dead_zone" in self.effects:
            value = self._values("dead_zone", i, p)
            if kinks.width > 0:
                y = soft_dead_zone(ops, value["width"], y, kinks.width)
            else:
                y, _ = dead_zone_step(ops, value, (), y, dt)
        if "actuator_lag" in self.effects:
            y, new[f"lag.{wheel}"] = lag_step(ops, self._values("actuator_lag", i, p), now[f"lag.{wheel}"], y, dt)
        laws: dict[str, Any] = {"actuator_gain": gain_step, "voltage_sag": sag_step, "saturation": saturation_step}
        for name in ACTUATOR:
            if name in self.effects:
                clock = now["clock"] + 0.5 * dt if "clock" in now else 0.0
                table = rough if name == "saturation" else ops
                y, _ = laws[name](table, self._values(name, i, p), (), y, clock, dt)
        if "backlash" in self.effects:
            name = f"play.{wheel}"
            y, new[name] = backlash_step(kinks.rough(dt), self._values("backlash", i, p), now[name], y, 0.0, dt)
        return y

    def _ground(
        self, kinks: Kinks, w: Sequence[Array], p: Sequence[Array], now: Mapping[str, Array], new: dict[str, Array]
    ) -> tuple[Array, Array, Array]:
        values = {e: self._values(e, 0, p) for e in CONTACT if e in self.effects}
        accel: list[Array] = [0.0, 0.0]
        if "longitudinal_slip" in self.effects:
            for i, wheel in enumerate(WHEELS):
                past = [now[f"speed.{wheel}.{j}"] for j in range(1, self.span + 1)]
                accel[i] = (w[i] - past[-1]) / (self.span * self.dt)
                new |= {f"speed.{wheel}.{j + 1}": v for j, v in enumerate((w[i], *past[:-1]))}
        radius, track = (p[self.index[TUNE, "", n]] for n in ("wheel_radius", "track_width"))
        # the slip's |r a| is in m/s^2: a command changed by 1 rad/s within a step of dt is r / dt of it
        return ground_twist(kinks.rough(0.033 / self.dt), values, radius, track, (w[0], w[1]), (accel[0], accel[1]))


def soft_dead_zone(ops: Ops, width: Array, u: Array, eps: float) -> Array:
    """A dead zone whose edge is eps wide, so that its derivative shows the way out: u / (1 + exp(-(|u| - width) /
    eps)).
    """
    away = ops.minimum((width - (u * u + eps * eps) ** 0.5) / eps, 40.0)  # exp stays finite
    return u / (1.0 + ops.exp(away))


def drive_step(
    nominal: Mapping[str, float], name: str, settings: Settings, options: StepOptions, response: float
) -> Stepped:
    """The step of a differential drive. nominal: wheel_radius and track_width, m; response: s, over which a wheel's
    acceleration is taken.

    Raises BadInput for settings of several rows, or a signal that the step does not have.
    """
    if settings.rows != 1:
        raise BadInput(f"a step needs settings with one row, got {settings.rows}", name)
    unknown = {*options.remember, *options.disturbances} - {*BODY, *WORLD}
    if unknown:
        known = ", ".join((*BODY, *WORLD))
        raise BadInput(f"unknown signal {', '.join(sorted(unknown))}", name, f"the signals are {known}")
    numbers = [Number(TUNE, "", n, float(settings.tuned.get(n, np.array([v]))[0]), "m") for n, v in nominal.items()]
    yours = {e.name for e in PLUGGED}
    live = sorted((e for e in settings.effects if e not in SENSOR and e not in yours), key=ORDER.__getitem__)
    left_out = tuple(f"{e}: a user-defined effect is not part of this step" for e in settings.effects if e in yours)
    for effect in live:
        for q in BY_NAME[effect].parameters:
            row = settings.effects[effect][q.name][0]
            slots = WHEELS if len(row) == 2 else ("",)
            numbers += [
                Number(effect, s, q.name, min(float(v), ENDLESS), q.unit) for s, v in zip(slots, row, strict=True)
            ]
    line = 0
    if "command_delay" in live:
        line = max(1, math.ceil(float(settings.effects["command_delay"]["delay"].max()) / options.dt - 1e-9))
    span = max(1, round(response / options.dt))
    index = {(n.effect, n.slot, n.parameter): i for i, n in enumerate(numbers)}
    step = DriveStep(options.dt, frozenset(live), line, span, options, index)
    rest = np.zeros(len(step.states))
    if "clock" in step.states:
        rest[step.states.index("clock")] = options.clock
    return Stepped(
        options.dt, step.states, POSE, tuple(_unit(s) for s in step.states), WHEELS, tuple(numbers),
        (*BODY, *WORLD, *COMMANDS, *(f"model.{w}" for w in WORLD)), rest, step, left_out=left_out,
    )  # fmt: skip


def _unit(state: str) -> str:
    kind, _, rest = state.partition(".")
    if kind in ("last", "disturbance"):
        return UNIT[rest]
    return UNIT.get(state) or {"play": "rad", "clock": "s"}.get(kind, "rad/s")
