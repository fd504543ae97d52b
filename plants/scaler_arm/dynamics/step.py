"""One step of the arm with its effects, for any array library: what exports and controllers use.

The paper's task-space model, eq. (fk_prop): the tool moves by FK(q + q' dt) - FK(q) plus what was learned, and q' is
what the servos make of their commands. Joint angles are the state; the five-bar is closed analytically. What is learned
of the tool's velocity adds up beside the kinematics, and begins anew at every measurement of the joints, as the paper's
prediction does.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plants.scaler_arm.dynamics.gravity import BODIES, centres, masses
from plants.scaler_arm.dynamics.servo import Load, Servo, advance, torque, weights
from plants.scaler_arm.kinematics.forward import chain, forward_kinematics, posture
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, Arm, Triple
from plants.scaler_arm.kinematics.rotation import Vector, cross
from residual_mpc.effects.body import TOOL_AXES
from residual_mpc.effects.chain import Chain, chain_of, scaled
from residual_mpc.effects.effect import Site
from residual_mpc.effects.library import BY_NAME, ORDER, changes, present
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import TUNE, Settings
from residual_mpc.models.stepping import Correction, Kinks, Number, StepOptions, Stepped, finite

POSITIONS = tuple(f"position.{m}" for m in MOTORS)
COMMANDS = tuple(f"command.{m}" for m in MOTORS)
RATES = tuple(f"velocity.{m}" for m in MOTORS)  # rad/s, of the step: the network's input
TOOL = ("tool.x", "tool.y", "tool.z")  # m
TASK = ("task.x", "task.y", "task.z")  # m/s, what a correction adds to the tool's velocity
TURN = ("turn.x", "turn.y", "turn.z")  # the gripper against home: sine of the angle times its axis
ON_MOTORS: tuple[Site, ...] = ("command", "strength", "position gain", "damping", "dry friction", "friction")
WEIGHS: tuple[Site, ...] = ("tool", "link")
NO_GEAR = "this step does not model the motor side of a gear separately"
LEFT_OUT: Mapping[str, str] = {
    "limit": "this step has no inertia, so a torque limit has no effect",
    "rotor": "this step has no inertia",
    "length": "this step solves the five-bar linkage with the nominal lengths",
    "spring": NO_GEAR,
    "play": NO_GEAR,
}
UNIT = {"position": "rad", "speed": "rad/s", "offset": "m", "clock": "s", "disturbance": "rad/s"}


@dataclass(frozen=True)
class ArmStep:
    """What the step needs to know beside its numbers: which effects there are, and how long each memory is."""

    arm: Arm
    dt: float  # s
    effects: tuple[str, ...]  # in the order of the chain
    sent: Chain  # of a command on its way to a servo
    errors: Chain  # what acts on a servo's error
    options: StepOptions
    index: Mapping[tuple[str, str, str], int]  # (effect, slot, parameter) -> place in p
    along: Mapping[str, Triple]  # unit vectors, along which a link's centre of mass is moved
    numbers: tuple[float, ...]  # p as it is now

    @property
    def states(self) -> tuple[str, ...]:
        """Angles first, then what is remembered, newest first."""
        names = [*POSITIONS]
        names += [*self.sent.states, *self.errors.states]
        if any(BY_NAME[e].place == "friction" for e in self.effects):
            names += [f"speed.{m}" for m in MOTORS]
        names += [f"offset.{s}" for s in self.options.corrected]
        names += [f"disturbance.{s}" for s in self.options.disturbances]
        if any(BY_NAME[e].place == "strength" and BY_NAME[e].timed for e in self.effects):
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
        ops, dt = kinks.exact, self.dt
        now = dict(zip(self.states, x, strict=True))
        new: dict[str, Array] = {}
        q = [now[c] for c in POSITIONS]
        weight = weights(ops, self.arm, chain(self.arm), q, self._load(p))
        signals: dict[str, Array] = dict(zip(COMMANDS, u, strict=True))

        def values(effect: str, slot: str) -> dict[str, Array]:
            return self._values(effect, slot, p)

        for i, m in enumerate(MOTORS):
            sent = self.sent(kinks, m, u[i], values, now, new)
            law = self._law(ops, i, now, sent - q[i], p)
            error = self.errors(kinks, m, sent - q[i], values, now, new)
            rate = advance(ops, kinks.rough(self.arm.servo.stiffness), law, error, weight[i], dt) / dt
            if f"disturbance.{RATES[i]}" in now:
                rate = rate + now[f"disturbance.{RATES[i]}"]
            if f"speed.{m}" in now:
                new[f"speed.{m}"] = rate
            new[POSITIONS[i]] = q[i] + dt * rate
            signals[RATES[i]] = rate
        added = dict(correction(signals)) if correction is not None else {}
        if set(added) - set(self.options.corrected):
            raise KeyError(f"a correction may add only to {self.options.corrected}, got {sorted(added)}")
        for s in self.options.corrected:
            held = now[f"offset.{s}"]
            new[f"offset.{s}"] = held + dt * added[s] if s in added else held
        new |= {s: now[s] for s in self.states if s.startswith("disturbance.")}
        if "clock" in now:
            new["clock"] = now["clock"] + dt
        return tuple(new[s] for s in self.states)

    def output(self, ops: Ops, x: Sequence[Array]) -> tuple[Array, ...]:
        """Tool point (m), what was learned included, and how far the gripper is turned from home (rad, small)."""
        now = dict(zip(self.states, x, strict=True))
        at = posture(ops, chain(self.arm), [now[c] for c in POSITIONS])
        tool = [v + now[f"offset.{s}"] if f"offset.{s}" in now else v for v, s in zip(at.tool, TASK, strict=True)]
        axes = [_half_cross(home, now) for home, now in zip(_home_axes(self.arm), at.gripper, strict=True)]
        return (*tool, *(axes[0][i] + axes[1][i] + axes[2][i] for i in range(3)))

    def resting(self, pose: Mapping[str, float]) -> np.ndarray:
        """(nx,) at rest at these angles; every command on its way is the one that holds them but for the weight."""
        at = {m: pose.get(f"position.{m}", home) for m, home in zip(MOTORS, HOME, strict=True)}

        def values(effect: str, slot: str) -> dict[str, float]:
            return self._values(effect, slot, self.numbers)

        known = {
            **{f"position.{m}": q for m, q in at.items()},
            **self.sent.resting(at, values),
            **self.errors.resting(dict.fromkeys(MOTORS, 0.0), values),
            "clock": self.options.clock,
        }
        return np.array([known.get(name, 0.0) for name in self.states])

    def holding(self, x: np.ndarray) -> np.ndarray:
        """(6,) rad: where the joints are; the arm's weight then draws it down by its sag."""
        return np.array(x[: len(POSITIONS)])

    def _number(self, effect: str, slot: str, parameter: str, p: Sequence[Array], default: float) -> Array:
        at = self.index.get((effect, slot, parameter))
        return default if at is None else p[at]

    def _values(self, effect: str, slot: str, p: Sequence[Array]) -> dict[str, Array]:
        return {q.name: self._number(effect, slot, q.name, p, q.null) for q in BY_NAME[effect].parameters}

    def _law(self, ops: Ops, i: int, now: Mapping[str, Array], error: Array, p: Sequence[Array]) -> Servo:
        m = MOTORS[i]
        kp, kv = (p[self.index[TUNE, "", f"actuator.{m}.{k}"]] for k in ("kp", "kv"))
        b = p[self.index[TUNE, "", f"joint.{m}.damping"]]
        effects = {e: self._values(e, m, p) for e in self.effects}
        damping = changes(effects, "viscous damping")
        b = b if damping is None else b + damping
        stiffness = changes(effects, "servo stiffness")
        kp = kp if stiffness is None else kp * stiffness
        clock = now["clock"] + 0.5 * self.dt if "clock" in now else 0.0
        for one in present(effects, "strength"):
            scale = scaled(ops, [one], 1.0, clock, self.dt)
            kp, kv = scale * kp, scale * kv
        bare = Servo(kp, kv, b)
        level: Array | None = None
        speed = now.get(f"speed.{m}", 0.0)
        for effect, value in present(effects, "dry friction", "friction"):
            assert effect.step is not None
            part = effect.step(ops, value, speed, torque(bare, error, speed))
            level = part if level is None else level + part
        return Servo(kp, kv, b, level)

    def _load(self, p: Sequence[Array]) -> Load:
        mass: dict[str, Array] = {n: p[self.index[TUNE, "", f"body.{n}.mass"]] for n in BODIES}
        shifts: dict[str, Array] = {}
        for n in BODIES:
            effects = {e: self._values(e, n, p) for e in self.effects if BY_NAME[e].place == "link"}
            added, moved = changes(effects, "link mass"), changes(effects, "link centre")
            if added is not None:
                mass[n] = mass[n] + added
            if moved is not None:
                shifts[n] = moved
        carried = {e: self._values(e, "", p) for e in self.effects if BY_NAME[e].place == "tool"}
        tool = changes(carried, "tool mass")
        payload = 0.0 if tool is None else tool
        known = any((e, "", axis) in self.index for e in carried for axis in TOOL_AXES)
        beside = [changes(carried, quantity) for quantity in TOOL_AXES.values()] if known else None
        return Load(mass, payload, shifts, self.along, beside)


@lru_cache(maxsize=8)
def _home_axes(arm: Arm) -> tuple[Triple, Triple, Triple]:
    """The gripper's axes at home."""
    _, frame = forward_kinematics(np.array(HOME), arm)
    x, y, z = ((float(c[0]), float(c[1]), float(c[2])) for c in frame.T)
    return x, y, z


def _half_cross(u: Triple, v: Vector) -> Vector:
    x, y, z = cross(u, v)
    return 0.5 * x, 0.5 * y, 0.5 * z


def nominal(arm: Arm) -> dict[str, float]:
    """The model's own numbers: of each motor kp (N m/rad), kv and its bearings' damping (N m s/rad); masses (kg)."""
    out: dict[str, float] = {}
    for m in MOTORS:
        out |= {f"actuator.{m}.kp": arm.servo.stiffness, f"actuator.{m}.kv": arm.servo.damping}
        out[f"joint.{m}.damping"] = arm.servo.friction
    return out | {f"body.{n}.mass": mass for n, mass in masses(arm).items()}


def arm_step(
    arm: Arm, name: str, settings: Settings, options: StepOptions, slots: Callable[[str], tuple[str, ...]]
) -> Stepped:
    """The step of the arm. slots: the robot's targets of each effect.

    Raises BadInput for settings of several rows, or a signal that the step does not have.
    """
    if settings.rows != 1:
        raise BadInput(f"a step needs settings with one row, got {settings.rows}", name)
    unknown = {*options.remember} | ({*options.corrected} - {*TASK}) | ({*options.disturbances} - {*RATES})
    if unknown:
        raise BadInput(
            f"unknown signal {', '.join(sorted(unknown))}", name, f"corrections may use {', '.join(TASK)}, "
            f"disturbances {', '.join(RATES)}, and no signal can be remembered",
        )  # fmt: skip
    numbers = _tuned(arm, settings)
    left_out = [f"{n}: only servo, friction and mass parameters are part of this step"
                for n in settings.tuned if n not in {x.parameter for x in numbers}]  # fmt: skip
    live = sorted((e for e in settings.effects if BY_NAME[e].stage != "sensor"), key=ORDER.__getitem__)
    hosted = []
    for effect in live:
        place = BY_NAME[effect].place
        if place not in (*ON_MOTORS, *WEIGHS):
            left_out.append(f"{effect}: {LEFT_OUT.get(place, 'not part of this step')}")
            continue
        hosted.append(effect)
        targets = slots(effect)
        for q in BY_NAME[effect].parameters:
            for slot, v in zip(targets, settings.effects[effect][q.name][0], strict=True):
                if place in ON_MOTORS and slot not in MOTORS:
                    if v != q.null and not q.shape:
                        left_out.append(f"{effect} [{slot}]: a passive joint follows the others")
                    continue
                if q.optional and v == q.null:
                    continue
                numbers.append(Number(effect, "" if slot == name else slot, q.name, finite(float(v)), q.unit))
    effects = {e: settings.effects[e] for e in hosted}
    sent, errors = (chain_of(effects, ("command",), MOTORS, options.dt, on_error=own) for own in (False, True))
    index = {(n.effect, n.slot, n.parameter): i for i, n in enumerate(numbers)}
    order = tuple(e.name for e, _ in present(effects, *ON_MOTORS, *WEIGHS))
    step = ArmStep(
        arm, options.dt, order, sent, errors, options, index, _along(arm), tuple(n.value for n in numbers)
    )  # fmt: skip
    units = tuple(_unit(s) for s in step.states)
    return Stepped(
        options.dt,
        step.states,
        POSITIONS,
        units,
        MOTORS,
        tuple(numbers),
        (*RATES, *TASK, *COMMANDS),
        step.resting({}),
        step,
        outputs=(*TOOL, *TURN),
        output_units=("m",) * 3 + ("rad",) * 3,
        output=step.output,
        resting=step.resting,
        holding=step.holding,
        restarts=tuple(s for s in step.states if s.startswith("offset.")),
        reach=arm.limits,
        left_out=tuple(left_out),
    )


def _tuned(arm: Arm, settings: Settings) -> list[Number]:
    unit = {"kp": "N m/rad", "kv": "N m s/rad", "damping": "N m s/rad", "mass": "kg"}
    return [
        Number(TUNE, "", n, float(settings.tuned.get(n, np.array([v]))[0]), unit[n.rpartition(".")[2]])
        for n, v in nominal(arm).items()
    ]


def _along(arm: Arm) -> dict[str, Triple]:
    """From each link's joint towards the next one; at a chain's end towards the centre of mass, as in the replay."""
    out = {}
    for n in BODIES:
        ahead = next((j.frame.xyz for j in arm.joints if j.parent == n), None)
        line = ahead or centres(arm)[n]
        length = math.hypot(*line)
        out[n] = (1.0, 0.0, 0.0) if length < 1e-9 else (line[0] / length, line[1] / length, line[2] / length)
    return out


def _unit(state: str) -> str:
    kind = state.partition(".")[0]
    return UNIT.get(kind) or next((e.memory_unit for e in BY_NAME.values() if e.label == kind and e.memory_unit), "rad")
