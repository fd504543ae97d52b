"""The servos of a robot, a row each: what the model says of each, and what a diagnosis found."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import hypot
from typing import Any, NamedTuple

from residual_mpc.effects.body import VISCOUS
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.effects.position_servo import POSITION_GAIN
from residual_mpc.effects.servo.motor import Motor
from residual_mpc.effects.servo.numbers import (
    JOINT_DAMPING,
    NUMBERS,
    SERVO_DAMPING,
    SERVO_STIFFNESS,
    ServoNumber,
    Source,
)
from residual_mpc.effects.servo.readings import Driven
from residual_mpc.models import optional
from residual_mpc.models.actuator_values import ActuatorValues, ListsActuators
from residual_mpc.models.model_file import values_of
from residual_mpc.models.motors.tables import motor_of
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import TUNE, Settings, assemble
from residual_mpc.models.sliding_units import sliding_unit

CORRECTED, RETUNED, NOT_NAMED, NOT_TESTABLE = "corrected", "retuned", "not named", "not testable"
Interval = tuple[float, float]


@dataclass(frozen=True)
class ServoValue:
    """One number of one servo.

    Attributes:
        nominal: of the model; None: no limit, rigid. value: with the effects that are named.
        ci95: of the value, None where nothing was named.
        probability: that an effect on this number is among the causes; None where that was not considered.
        status: `corrected` by an effect that is named, `retuned`, `not named` (the runs show no difference), or
            `not testable`, with `why`.
        effects: the named ones. alike: they were found for all joints alike.
        notes: what the diagnosis says of the value besides.
        by_constants: what the motor's constants give; None where they do not, or are not stated.
    """

    name: str
    unit: str
    nominal: float | None
    value: float | None
    ci95: Interval | None
    probability: float | None
    status: str
    why: str = ""
    effects: tuple[str, ...] = ()
    alike: bool = False
    notes: tuple[str, ...] = ()
    by_constants: float | None = None


class _Doubts(NamedTuple):
    """Of a diagnosis.json: what could not be tested, what was considered, what cannot be told apart."""

    untested: Sequence[Mapping[str, Any]]
    candidates: Sequence[Mapping[str, Any]]
    confounded: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class ServoRow:
    """One servo with its numbers, in the order of NUMBERS; those that its kind of robot cannot have are absent."""

    actuator: str
    joint: str
    kind: str
    motor: Motor | None
    values: tuple[ServoValue, ...]

    def document(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        return asdict(self)


def servo_rows(found: Mapping[str, Any], robot: Robot, file: RobotFile) -> tuple[ServoRow, ...]:
    """The table; empty for a robot that lists no actuators, such as a differential drive.

    found: the content of a diagnosis.json, or of a model.json, which has neither intervals nor probabilities. What
    holds for all joints alike stands in every row.
    """
    if not isinstance(robot, ListsActuators):
        return ()
    entries = found.get("explanation")
    entries = _without_intervals(found["values"]) if entries is None else entries
    entries = [e for e in entries if not _of_the_log(e)]
    doubts = _Doubts(
        found.get("not_testable") or [], found.get("candidates") or [], found.get("confounded") or []
    )  # fmt: skip
    tuned = {k: v for k, v in values_of((found.get("model") or found)["values"]).items() if k.effect == TUNE}
    nominal = robot.actuator_values(Settings(1))
    retuned = robot.actuator_values(assemble([tuned], {}))
    return tuple(
        ServoRow(
            at.actuator, at.joint, at.kind, (motor := _motor(at, robot, file)),
            _friction_above_zero(
                replace(_value(number, sources, at, now, entries, doubts, robot), by_constants=_given(number, motor))
                for number in NUMBERS
                if not number.kinds or at.kind in number.kinds
                if not _no_factor_of(number, at)
                if (sources := [(s, slot) for s in number.sources if (slot := _slot(s, at, robot)) is not None])
            ),
        )
        for at, now in zip(nominal, retuned, strict=True)
    )  # fmt: skip


def _friction_above_zero(values: Iterable[ServoValue]) -> tuple[ServoValue, ...]:
    """The numbers of a servo, in which what a viscous friction is below zero comes off the servo's damping."""
    found = {v.name: v for v in values}
    friction, servo = found.get(JOINT_DAMPING), found.get(SERVO_DAMPING)
    if friction is not None and servo is not None and friction.value is not None and friction.value < 0.0:
        assert servo.value is not None
        total = servo.value + friction.value
        sure = [p for p in (friction.probability, servo.probability if servo.effects else None) if p is not None]
        found[SERVO_DAMPING] = replace(
            servo, value=total, ci95=_of_sum(total, servo, friction), probability=min(sure, default=None),
            status=friction.status, effects=(*servo.effects, *friction.effects),
            alike=friction.alike and (servo.alike or not servo.effects),
            notes=tuple(dict.fromkeys((*servo.notes, *friction.notes))),
        )  # fmt: skip
        found[JOINT_DAMPING] = replace(friction, value=0.0, ci95=_above_zero(friction.ci95))
    return tuple(found.values())


def _of_sum(total: float, *parts: ServoValue) -> Interval | None:
    """Of independent parts; None where none of them has an interval."""
    apart = [(p.value - p.ci95[0], p.ci95[1] - p.value) for p in parts if p.ci95 and p.value is not None]
    low, high = (hypot(*ends) for ends in zip(*apart, strict=True)) if apart else (0.0, 0.0)
    return (total - low, total + high) if apart else None


def _above_zero(interval: Interval | None) -> Interval | None:
    return None if interval is None else (max(interval[0], 0.0), max(interval[1], 0.0))


def _of_the_log(entry: Mapping[str, Any]) -> bool:
    """Whether an entry says that commands act before their stamps, which no servo does."""
    return entry["effect"] == COMMAND_DELAY.name and (entry["parameters"]["delay"]["value"] or 0.0) < 0.0


def driven_by(
    effect: str, target: str | None, robot: Robot, rows: Sequence[ServoRow], but: Collection[str] = ()
) -> tuple[Driven, ...]:
    """The actuators with known motors that an effect on a target acts on.

    rows: of the robot, as `servo_rows` has them. but: slots that have values of their own.
    """
    if not isinstance(robot, ListsActuators):
        return ()
    out = []
    for row, v in zip(rows, robot.actuator_values(Settings(1)), strict=True):
        motor = row.motor
        mine = {name for name in (v.actuator, v.joint) if name in robot.slots(effect)}
        acted = target in mine if target is not None else mine and not mine & set(but)
        if motor is not None and acted:
            joint = v.viscous_friction
            damped = v.damping + joint, _as_scaled(v, row) + joint
            out.append(Driven(v.actuator, motor, v.stiffness, v.gear, *damped))
    return tuple(out)


def _as_scaled(at: ActuatorValues, row: ServoRow) -> float:
    """The servo's damping as a gain of the whole servo leaves it, without what a friction takes from it."""
    found = {v.name: v for v in row.values}
    stiffness, servo = found.get(SERVO_STIFFNESS), found.get(SERVO_DAMPING)
    if stiffness is not None and POSITION_GAIN.name in stiffness.effects:  # whose stiffness says nothing of the damping
        return at.damping if servo is None or servo.value is None or VISCOUS.name in servo.effects else servo.value
    if stiffness is not None and stiffness.value is not None and at.stiffness > 0.0:
        return at.damping * stiffness.value / at.stiffness
    return at.damping if servo is None or servo.value is None else servo.value


def _value(
    number: ServoNumber, sources: Sequence[tuple[Source, str]], at: ActuatorValues, now: ActuatorValues,
    entries: Sequence[Mapping[str, Any]], doubts: _Doubts, robot: Robot,
) -> ServoValue:  # fmt: skip
    nominal, base = (getattr(v, number.field) if number.field else number.absent for v in (at, now))
    unit = sliding_unit(number.unit) if at.joint in optional.sliding(robot) else number.unit
    named = [
        (s, entry)
        for s, slot in sources
        if (entry := _entry(entries, s.effect.name, slot)) is not None
        if entry["parameters"].get(s.parameter, {}).get("value") is not None  # null: without a bound
    ]
    if named:
        value, interval = _combined(base, named, abs(at.gear))
        sure = [e["probability"] for _, e in named if e.get("probability") is not None]
        alike = all(e.get("target") is None and len(robot.slots(s.effect.name)) > 1 for s, e in named)
        effects = tuple(s.effect.name for s, _ in named)
        return ServoValue(number.name, unit, nominal, value, interval, min(sure, default=None), CORRECTED, "", effects,
                          alike, _notes(named, doubts.confounded))  # fmt: skip
    reasons = [_entry(doubts.untested, s.effect.name, slot) for s, slot in sources]
    considered = [_entry(doubts.candidates, s.effect.name, slot) for s, slot in sources]
    chances = [float(e["probability"]) for e in considered if e is not None and e.get("probability") is not None]
    if all(reason is not None for reason in reasons):
        why = next(str(reason["why"]) for reason in reasons if reason is not None)
        return ServoValue(number.name, unit, nominal, base, None, None, NOT_TESTABLE, why)
    if base != nominal:  # its value says what the runs show; no effect on top of it is named
        return ServoValue(number.name, unit, nominal, base, None, None, RETUNED)
    return ServoValue(number.name, unit, nominal, base, None, max(chances, default=None), NOT_NAMED)


def _combined(
    base: float | None, named: Sequence[tuple[Source, Mapping[str, Any]]], gear: float
) -> tuple[float | None, Interval | None]:
    """The value and its interval; several effects count as independent."""
    at = [float(e["parameters"][s.parameter]["value"]) for s, e in named]
    best = _applied(base, named, at, gear)
    low = high = 0.0
    known = False
    for i, (s, e) in enumerate(named):
        ci95 = e["parameters"][s.parameter].get("ci95")
        if best is None or not ci95 or None in ci95:
            continue
        known = True
        ends = [_applied(base, named, [*at[:i], end, *at[i + 1 :]], gear) for end in ci95]
        apart = [0.0 if end is None else end - best for end in ends]
        low, high = hypot(low, min(apart)), hypot(high, max(apart))
    return best, (best - low, best + high) if known and best is not None else None


def _applied(
    base: float | None, named: Sequence[tuple[Source, Mapping[str, Any]]], values: Sequence[float], gear: float
) -> float | None:
    out = base
    for (s, _), value in zip(named, values, strict=True):
        x = value * gear**s.power
        if s.how == "times":
            out = None if out is None else out * x
        elif s.how == "plus":
            out = x if out is None else out + x
        elif s.how == "at most":
            out = x if out is None else min(out, x)
        else:
            out = x
    return out


def _entry(entries: Sequence[Mapping[str, Any]], effect: str, slot: str) -> Mapping[str, Any] | None:
    """Of the slot itself, else of all slots alike."""
    mine = [e for e in entries if e["effect"] == effect and e.get("target") in (slot, None)]
    return max(mine, key=lambda e: e.get("target") is not None, default=None)


def _motor(at: ActuatorValues, robot: Robot, file: RobotFile) -> Motor | None:
    """Of a joint that turns: the constants are in N m/A."""
    return None if at.joint in optional.sliding(robot) else motor_of(file.motors, at.actuator)


def _given(number: ServoNumber, motor: Motor | None) -> float | None:
    """By the motor's constants."""
    return None if motor is None or not number.constant else getattr(motor, number.constant)


def _no_factor_of(number: ServoNumber, at: ActuatorValues) -> bool:
    """Whether there is nothing that a factor could change."""
    return all(s.how == "times" for s in number.sources) and number.field != "" and getattr(at, number.field) == 0.0


def _slot(source: Source, at: ActuatorValues, robot: Robot) -> str | None:
    """What the effect calls this servo; None where it has no such target."""
    slots = robot.slots(source.effect.name)
    names = {"actuator": (at.actuator, at.joint), "channel": (f"position.{at.joint}",)}
    return next((name for name in names.get(source.effect.target, (at.joint,)) if name in slots), None)


def _notes(named: Sequence[tuple[Source, Mapping[str, Any]]], confounded: Sequence[Sequence[Any]]) -> tuple[str, ...]:
    notes = [e["parameters"][s.parameter].get("note") or e.get("note") for s, e in named]
    differing = ["differs from run to run" for _, e in named if e.get("by_run")]
    rivals = dict.fromkeys(rival for s, e in named for rival in _rivals(e, confounded))
    doubts = [f"or {rival.replace('_', ' ')}" for rival in rivals]
    return (*(str(note) for note in notes if note), *differing, *doubts)


def _rivals(entry: Mapping[str, Any], confounded: Sequence[Sequence[Any]]) -> Iterator[str]:
    """Single effects that these runs cannot tell from this one."""
    for group in confounded:
        members = [m for m in group if isinstance(m, Mapping)]
        if any(m["effect"] == entry["effect"] and m.get("target") == entry.get("target") for m in members):
            yield from (str(m["effect"]) for m in members if m["effect"] != entry["effect"])


def _without_intervals(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The values of a model.json as the entries of an explanation."""
    out: dict[tuple[str, str | None], dict[str, Any]] = {}
    for row in rows:
        key = (row["effect"], row["target"])
        out.setdefault(key, {"effect": key[0], "target": key[1], "parameters": {}})
        out[key]["parameters"][row["parameter"]] = {"value": row["value"]}
    return list(out.values())
