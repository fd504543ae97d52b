"""One step of the differential drive with its effects, for any array library: what exports and controllers use.

The equations are those of the replay, effect by effect; here they are strung together in time order, with what they
remember as states, so that the step can be differentiated and put into an optimiser.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from residual_mpc.effects.chain import OUTPUT, Chain, chain_of
from residual_mpc.effects.effect import Site
from residual_mpc.effects.ground import ground_twist, radius_factor, with_fitted_rates, world_drift
from residual_mpc.effects.laws import rounded
from residual_mpc.effects.library import BY_NAME, ORDER, present
from residual_mpc.effects.ops import Array
from residual_mpc.effects.speed_chain import PairStep, speed_chains
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import TUNE, Settings
from residual_mpc.models.stepping import Correction, Kinks, Number, StepOptions, Stepped, finite

WHEELS = ("left", "right")
POSE = ("pose.x", "pose.y", "pose.theta")
BODY = ("body.forward", "body.sideways", "body.yaw")  # m/s, m/s, rad/s
WORLD = ("twist.x", "twist.y", "twist.theta")  # m/s, m/s, rad/s
COMMANDS = ("command.left", "command.right")  # rad/s
RATES = ("forward", "sideways", "yaw")  # of the base, in its own frame
GROUND: tuple[Site, ...] = ("rolling", "roundness", "rim", "side", "drift", "rate")
SLOTS: Mapping[int, tuple[str, ...]] = {1: ("",), 2: WHEELS, 3: RATES}  # by number
# what a sensor reports is the estimator's part
HOSTED = frozenset(("command", *OUTPUT, "pair", "pair command", "play", *GROUND))
UNIT = dict(zip((*POSE, *BODY, *WORLD), ("m", "m", "rad", *("m/s", "m/s", "rad/s") * 2), strict=True))


@dataclass(frozen=True)
class DriveStep:
    """What the step needs to know beside its numbers: which effects there are, and how long each memory is."""

    dt: float  # s
    ground: tuple[str, ...]  # names of the effects between wheels and ground
    wheels: tuple[Chain, ...]  # of a wheel from its command to its rim, play last
    pairs: tuple[PairStep, ...]  # on the two wheels together, each between one of these chains and the next
    span: int  # past speeds a wheel, over which its acceleration is taken; 0 where nothing asks for it
    options: StepOptions
    index: Mapping[tuple[str, str, str], int]  # (effect, slot, parameter) -> place in p

    @property
    def states(self) -> tuple[str, ...]:
        """Pose first, then what is remembered, newest first."""
        names = [*POSE, *(s for chain in self.wheels for s in chain.states)]
        names += [s for pair in self.pairs for s in pair.states]
        names += [f"speed.{wheel}.{j}" for wheel in WHEELS for j in range(1, self.span + 1)]
        names += [f"angle.{wheel}" for wheel in WHEELS if self.uneven]
        names += [f"last.{s}" for s in self.options.remember]
        names += [f"disturbance.{s}" for s in self.options.disturbances]
        if any(chain.timed for chain in self.wheels):
            names.append("clock")
        return tuple(names)

    @property
    def uneven(self) -> tuple[str, ...]:
        """The effects that make a wheel's radius vary over its turn."""
        return tuple(e for e in self.ground if BY_NAME[e].place == "roundness")

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
        ground = {e: self._values(e, "", p) for e in self.ground if BY_NAME[e].place not in ("rate", "roundness")}
        laws = [{e: self._values(e, r, p) for e in self.ground if BY_NAME[e].place == "rate"} for r in RATES]
        wheel = self._driven(kinks, u, p, now, new)
        body = with_fitted_rates(rounded(kinks), self._ground(kinks, wheel, ground, p, now, new), laws)
        signals: dict[str, Array] = dict(zip(BODY, body, strict=True))
        signals |= dict(zip(COMMANDS, u, strict=True))
        signals |= {name: now[name] for name in self.states if name.startswith("last.")}
        drift = world_drift(ops, ground) or (0.0, 0.0)
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

    def _values(self, effect: str, wheel: str, p: Sequence[Array]) -> dict[str, Array]:
        slot = wheel if (effect, wheel, BY_NAME[effect].parameters[0].name) in self.index else ""
        return {q.name: p[self.index[effect, slot, q.name]] for q in BY_NAME[effect].parameters}

    def _driven(
        self, kinks: Kinks, u: Sequence[Array], p: Sequence[Array], now: Mapping[str, Array], new: dict[str, Array]
    ) -> list[Array]:
        """Mean speeds of the two wheels over the step, rad/s, from their commands; fills their new memory."""

        def values(effect: str, target: str) -> dict[str, Array]:
            return self._values(effect, target, p)

        clock = now["clock"] + 0.5 * self.dt if "clock" in now else 0.0
        wheel = list(u)
        for chain, pair in zip_longest(self.wheels, self.pairs):
            wheel = [chain(kinks, w, wheel[i], values, now, new, clock) for i, w in enumerate(WHEELS)]
            if pair is not None:
                wheel = pair(kinks, wheel, values(pair.effect.name, ""), now, new)
        return wheel

    def _ground(
        self, kinks: Kinks, w: Sequence[Array], effects: Mapping[str, Mapping[str, Array]], p: Sequence[Array],
        now: Mapping[str, Array], new: dict[str, Array],
    ) -> tuple[Array, Array, Array]:  # fmt: skip
        accel: list[Array] = [0.0, 0.0]
        for i, wheel in enumerate(WHEELS if self.span else ()):
            past = [now[f"speed.{wheel}.{j}"] for j in range(1, self.span + 1)]
            accel[i] = (w[i] - past[-1]) / (self.span * self.dt)
            new |= {f"speed.{wheel}.{j + 1}": v for j, v in enumerate((w[i], *past[:-1]))}
        radius, track = (p[self.index[TUNE, "", n]] for n in ("wheel_radius", "track_width"))
        # the slip's |r a| is in m/s^2: a command changed by 1 rad/s within a step of dt is r / dt of it
        return ground_twist(kinks.rough(0.033 / self.dt), effects, radius, track, (w[0], w[1]), (accel[0], accel[1]),
                            self._roundness(kinks, w, p, now, new))  # fmt: skip

    def _roundness(
        self, kinks: Kinks, w: Sequence[Array], p: Sequence[Array], now: Mapping[str, Array], new: dict[str, Array]
    ) -> tuple[Array | None, Array | None]:
        """Factors on the radii of the two wheels in the middle of the step; fills their next angles."""
        factors: list[Array | None] = [None, None]
        for i, wheel in enumerate(WHEELS if self.uneven else ()):
            effects = {e: self._values(e, wheel, p) for e in self.uneven}
            angle = now[f"angle.{wheel}"]
            factors[i] = radius_factor(kinks.exact, effects, angle + 0.5 * self.dt * w[i])
            new[f"angle.{wheel}"] = angle + self.dt * w[i]
        return factors[0], factors[1]


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
    live = sorted((e for e in settings.effects if BY_NAME[e].place in HOSTED), key=ORDER.__getitem__)
    for effect in live:
        for q in BY_NAME[effect].parameters:
            row = settings.effects[effect][q.name][0]
            slots = SLOTS[len(row)]
            numbers += [
                Number(effect, s, q.name, finite(float(v)), q.unit) for s, v in zip(slots, row, strict=True)
            ]
    effects = {e: settings.effects[e] for e in live}
    span = max(1, round(response / options.dt)) if any(present(effects, "rim")) else 0
    index = {(n.effect, n.slot, n.parameter): i for i, n in enumerate(numbers)}
    (*first, last), pairs = speed_chains(effects, WHEELS, options.dt)
    wheels = (*first, last.then(chain_of(effects, ("play",), WHEELS, options.dt)))
    ground = tuple(e.name for e, _ in present(effects, *GROUND))
    step = DriveStep(options.dt, ground, wheels, pairs, span, options, index)
    value = {(n.effect, n.slot, n.parameter): n.value for n in numbers}

    def values(effect: str, wheel: str) -> dict[str, float]:
        return {q.name: value.get((effect, wheel, q.name), value.get((effect, "", q.name), q.null))
                for q in BY_NAME[effect].parameters}  # fmt: skip

    still = dict.fromkeys(WHEELS, 0.0)
    resting = {"clock": options.clock}
    for chain in wheels:
        resting |= chain.resting(still, values)
    for pair in pairs:
        resting |= pair.resting((0.0, 0.0), values(pair.effect.name, ""))
    rest = np.array([resting.get(s, 0.0) for s in step.states])
    return Stepped(
        options.dt, step.states, POSE, tuple(_unit(s) for s in step.states), WHEELS, tuple(numbers),
        (*BODY, *WORLD, *COMMANDS, *(f"model.{w}" for w in WORLD)), rest, step,
    )  # fmt: skip


def _unit(state: str) -> str:
    kind, _, rest = state.partition(".")
    if kind in ("last", "disturbance"):
        return UNIT[rest]
    remembered = {e.label: e.memory_unit for e in BY_NAME.values() if e.label and e.memory_unit}
    return UNIT.get(state) or {**remembered, "clock": "s", "angle": "rad"}.get(kind, "rad/s")
