"""What is rewritten between an arm's steps, compiled: actuators that weaken, frictions and torques that change, what
servos make of their errors. It is what OneStep does in numpy (simulation.one_step, simulation.between)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from plants.mujoco_robot.native.chain import ACTUATOR, BESIDE, DAMPING, FRICTION, Chain, actuator_at, joint_at, sizes
from plants.mujoco_robot.native.dynamics import LinkNumbers, gravity_torques
from plants.mujoco_robot.native.elementary import operations
from plants.mujoco_robot.native.lanes import Lanes, Number, compared, lanes, larger, load, smaller, store, where
from plants.mujoco_robot.native.program import Program, Value
from residual_mpc.effects.laws import NEAR, equation, kind_of
from residual_mpc.effects.library import BUILT_IN, BY_NAME, LAWS
from residual_mpc.effects.ops import Ops, clip
from residual_mpc.effects.position_servo import held_integral

INTEGRAL = 4  # numbers of an integral part
NOMINAL = 7  # numbers of a link of the nominal model: place 3, mass, centre 3
COMPILED = frozenset(e.name for e in (*BUILT_IN, *LAWS))  # a user's own equation may not be compiled


@dataclass(frozen=True)
class Acting:
    """An effect at some joints or actuators, and where its numbers begin: place by place, its parameters in order.
    on: the quantities that a law is a function of; stretches: between a curve's knots, the first so many of which
    rise."""

    effect: str
    places: tuple[int, ...]
    first: int
    on: tuple[str, ...] = ()
    stretches: int = 0


@dataclass(frozen=True)
class Weight:
    """The weight of the nominal model, of which the motors bear a share: where share, gravity 3 and of each link place
    3, mass and centre 3 begin. behind: degrees of freedom behind gears that the controller does not see."""

    first: int
    behind: tuple[int, ...] = ()


@dataclass(frozen=True)
class Changing:
    """What is rewritten, the same for all rows of a program. A number says where numbers of the rows begin, counted
    from the arm's own, -1 where there are none.

    clock: s since the run began, at the middle of the next step; and the step's length. base: of the actuators, as they
    are without strengths and limits: gain, bias 3, range 2 each. reach: lowest and highest force of each actuator.
    integral: the effect; what it adds now, the limits of the force over the servo's stiffness, and its damping over
    that, s, INTEGRAL an actuator, begin at `added`. errors: at position servos.
    level: the joints' constant dry friction. damping: that of the joints. weight: that of the nominal model, which
    motors bear. links: actuators whose servos see the link, with the degree of freedom behind the gear; their ratios of
    damping to stiffness begin at `ratios`. switched: whether the controls are followed by what is switched on. records:
    whether forces are written down.
    """

    count: int
    clock: int
    strengths: tuple[tuple[Acting, bool], ...] = ()  # whether it is the supply's
    lines: tuple[Acting, ...] = ()
    base: int = -1
    reach: int = -1
    switched: bool = False
    frictions: tuple[Acting, ...] = ()
    friction_laws: tuple[Acting, ...] = ()
    level: int = -1
    laws: tuple[Acting, ...] = ()
    damping: int = -1
    weight: Weight | None = None
    errors: tuple[Acting, ...] = ()
    integral: Acting | None = None
    added: int = -1
    links: tuple[tuple[int, int], ...] = ()
    ratios: int = -1
    records: bool = False


@dataclass(frozen=True, eq=False)
class Rewriting:
    """The rows' memory as a program rewrites it. held: commands, then what is switched on; outputs: last forces."""

    p: Program
    chain: Chain
    changing: Changing
    numbers: Value
    state: Value
    held: Value
    outputs: Value

    def __call__(self) -> None:
        """Before a step of the robot."""
        ops, c = operations(self.p), self.changing
        n, nu = len(self.chain.joints), len(self.chain.actuators)
        q, v = ([load(self.p, self.state, k * n + i) for i in range(n)] for k in (0, 1))
        force = [load(self.p, self.outputs, i) for i in range(nu)]
        on = [load(self.p, self.held, nu + i) if c.switched else None for i in range(nu)]
        clock, dt = self._load(c.clock), self._load(c.clock + 1)
        u = self._through_servos(ops, q, v, on, dt)
        if c.base >= 0:
            for i in range(nu):
                self._actuator(ops, i, v, on[i], clock, dt)
        signals: dict[str, Sequence[Number]] = {"position": q, "speed": v, "time": [clock] * n}
        signals |= {"command": self._at_joints(u, n), "load": self._loads(force, n)}
        if c.level >= 0:
            self._frictions(ops, signals)
        beside = self._laws(ops, signals) if c.laws else {}
        if c.weight is not None:
            for i, x in self._borne(c.weight, q, on).items():
                beside[i] = beside.get(i, 0.0) + x
        for i, x in beside.items():
            store(self.p, x, self.numbers, joint_at(self.chain, i) + BESIDE)
        for slot, (i, behind) in enumerate(c.links):
            gear = self.chain.actuators[i].gear
            u[i] = u[i] - gear * (q[behind] + self._load(c.ratios + slot) * v[behind])
        for i, x in enumerate(u):
            store(self.p, x, self.held, i)
        self._store(clock + dt, c.clock)

    def _through_servos(
        self, ops: Ops, q: Sequence[Lanes], v: Sequence[Lanes], on: Sequence[Lanes | None], dt: Lanes
    ) -> list[Number]:
        """Commands after what position servos make of their errors."""
        p, c = self.p, self.changing
        behind = dict(c.links)
        out: list[Number] = []
        for i, actuator in enumerate(self.chain.actuators):
            u: Number = load(p, self.held, i)
            if not c.errors and c.integral is None:
                out.append(u)
                continue
            length = actuator.gear * (q[actuator.joint] + (q[behind[i]] if i in behind else 0.0))
            if c.integral is not None:
                value, low, high, derivative_time = (self._load(c.added + INTEGRAL * i + k) for k in range(INTEGRAL))
                after = _step(c.integral)(ops, self._of(c.integral, i), value, u - length, dt)
                damped = derivative_time * (actuator.gear * v[actuator.joint])
                after = held_integral(ops, value, after, u - length, damped, low, high)
                switched = on[i]
                if switched is not None:
                    after = where(p, switched > 0.0, after, 0.0)
                self._store(after, c.added + INTEGRAL * i)
                u = u + value
            error = before = u - length
            for one in c.errors:
                error, _ = _step(one)(ops, self._of(one, i), (), error, dt)
            same = compared(p, "oeq", error, before)
            out.append(where(p, same, u, length + error) if c.errors else u)
        return out

    def _actuator(self, ops: Ops, i: int, v: Sequence[Lanes], on: Lanes | None, clock: Lanes, dt: Lanes) -> None:
        """Gain, bias and range of an actuator."""
        c, actuator = self.changing, self.chain.actuators[i]
        supply: Number = 1.0
        for one, shared in c.strengths:
            if shared:
                supply, _ = _step(one)(ops, self._of(one, i), (), supply, clock, dt)
        supply = supply if on is None else on * supply
        law = supply
        for one, shared in c.strengths:
            if not shared:
                law, _ = _step(one)(ops, self._of(one, i), (), law, clock, dt)
        at = actuator_at(self.chain, i)
        for k in range(4):
            store(self.p, self._load(c.base + ACTUATOR * i + k) * law, self.numbers, at + k)
        ends: list[Number] = [self._load(c.base + ACTUATOR * i + k) * supply for k in (4, 5)]
        if c.reach >= 0:
            low, high = (self._load(c.reach + 2 * i + k) for k in (0, 1))
            ends = [clip(ops, x, low, high) for x in ends]
        for line in c.lines:
            low, high = _step(line)(ops, self._of(line, i), actuator.gear * v[actuator.joint])
            ends = [clip(ops, x, low, high) for x in ends]
        for k, x in enumerate(ends):
            store(self.p, x, self.numbers, at + 4 + k)

    def _frictions(self, ops: Ops, signals: Mapping[str, Sequence[Number]]) -> None:
        c = self.changing
        level: dict[int, Number] = {i: self._load(c.level + i) for i in range(len(self.chain.joints))}
        touched = set()
        for one in c.frictions:
            for slot, i in enumerate(one.places):
                w, tau = lanes(self.p, signals["speed"][i]), lanes(self.p, signals["load"][i])
                level[i] = level[i] + _step(one)(ops, self._of(one, slot), w, tau)
                touched.add(i)
        for one in c.friction_laws:
            for i, x in self._law(ops, one, *(signals[name] for name in one.on)).items():
                level[i] = level[i] + x
                touched.add(i)
        for i in sorted(touched):
            store(self.p, larger(self.p, level[i], 0.0), self.numbers, joint_at(self.chain, i) + FRICTION)

    def _laws(self, ops: Ops, signals: Mapping[str, Sequence[Number]]) -> dict[int, Number]:
        """Torques; what brakes ever more with the speed is damping, which the step takes implicitly."""
        c, torque, braking = self.changing, dict[int, Number](), dict[int, Number]()
        for one in c.laws:
            for i, x in self._law(ops, one, *(signals[name] for name in one.on)).items():
                torque[i] = torque.get(i, 0.0) + x
            if one.on != ("speed",):
                continue
            before, after = ([w + d for w in signals["speed"]] for d in (-NEAR, NEAR))
            rises = self._law(ops, one, after)
            for i, x in self._law(ops, one, before).items():
                braking[i] = braking.get(i, 0.0) + (x - rises[i]) / (2.0 * NEAR)
        for i, x in braking.items():
            x = larger(self.p, x, 0.0)
            torque[i] = torque[i] + x * signals["speed"][i]
            store(self.p, self._load(c.damping + i) + x, self.numbers, joint_at(self.chain, i) + DAMPING)
        return torque

    def _borne(self, weight: Weight, q: Sequence[Lanes], on: Sequence[Lanes | None]) -> dict[int, Number]:
        """By driven joint, the share of the nominal model's weight that its motors bear where they are on."""
        chain, first = self.chain, weight.first + 4
        numbers = [[self._load(first + NOMINAL * i + k) for k in range(NOMINAL)] for i in range(len(chain.joints))]
        links = [LinkNumbers((x, y, z), m, (a, b, c), (0.0,) * 6) for x, y, z, m, a, b, c in numbers]
        gravity = self._load(weight.first + 1), self._load(weight.first + 2), self._load(weight.first + 3)
        off = [x - x0 for x, x0 in zip(q, chain.drawn, strict=True)]
        off = [lanes(self.p, 0.0) if i in weight.behind else x for i, x in enumerate(off)]
        torque = gravity_torques(self.p, chain.joints, links, gravity, off)
        works: dict[int, Number] = {}
        for actuator, switched in zip(chain.actuators, on, strict=True):
            now: Number = 1.0 if switched is None else switched
            before = works.get(actuator.joint)
            works[actuator.joint] = now if before is None else larger(self.p, before, now)
        return {i: self._load(weight.first) * torque[i] * now for i, now in works.items()}

    def _law(self, ops: Ops, one: Acting, *z: Sequence[Number]) -> dict[int, Number]:
        """By joint, what a law adds at its quantities."""
        kind, law = kind_of(one.effect), _step(one)
        if kind is not None:
            law = equation(kind) if kind.shape == "wave" else partial(equation(kind), stretches=one.stretches)
        at = {i: [lanes(self.p, x[i]) for x in z] for i in one.places}
        return {i: law(ops, self._of(one, slot), *at[i]) for slot, i in enumerate(one.places)}

    def _loads(self, force: Sequence[Lanes], n: int) -> list[Number]:
        """Torques of the actuators at their joints, within the joints' own limits."""
        out: list[Number] = [0.0] * n
        for actuator, x in zip(self.chain.actuators, force, strict=True):
            out[actuator.joint] = out[actuator.joint] + actuator.gear * x
        for j, reach in enumerate(self.chain.reach):
            if reach is not None:
                out[j] = smaller(self.p, larger(self.p, out[j], reach[0]), reach[1])
        return out

    def _at_joints(self, u: Sequence[Number], n: int) -> list[Number]:
        out: list[Number] = [0.0] * n
        for actuator, x in zip(self.chain.actuators, u, strict=True):
            out[actuator.joint] = x
        return out

    def _of(self, one: Acting, slot: int) -> dict[str, Lanes]:
        """The effect's parameters at a place."""
        names = [q.name for q in BY_NAME[one.effect].parameters]
        return {name: self._load(one.first + slot * len(names) + k) for k, name in enumerate(names)}

    def _load(self, at: int) -> Lanes:
        return load(self.p, self.numbers, sizes(self.chain) + at)

    def _store(self, x: Number, at: int) -> None:
        store(self.p, x, self.numbers, sizes(self.chain) + at)


def _step(one: Acting) -> Callable[..., Any]:
    step = BY_NAME[one.effect].step
    assert step is not None
    return step
