"""The contract of `Robot` and its optional members, as checks that any implementation can run on itself.

from residual_mpc.models.contract import check_robot
check_robot(my_robot, np.random.default_rng(0))
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.effects.body import ARMATURE, LINK_MASS, PAYLOAD
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import HOSTED
from residual_mpc.effects.surroundings import BASE_TILT, END_STOP, GRAVITY_COMPENSATION
from residual_mpc.logs.columns import is_measured
from residual_mpc.models.contract.demand import ContractBroken, demand
from residual_mpc.models.contract.optional_members import check_optional
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings

KINDS = ("position", "velocity", "torque", "speed")
ROWS = 3
LENGTH = 0.25  # s replayed
LEAD = 0.35  # s before it: longer than the longest delay
ALONE = 1e-9  # relative: a row alone may be summed in another order than within a batch
# mass on a joint's axis, gravity along it, and a stop beyond the motion change nothing
MAY_BE_IDLE = tuple(e.name for e in (PAYLOAD, LINK_MASS, BASE_TILT, END_STOP, GRAVITY_COMPENSATION))

Predicted = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class _Case:
    """One batch to replay: start (ROWS,) by channel, rad and rad/s or m and m/s; wanted channels."""

    robot: Robot
    start: dict[str, np.ndarray]
    drive: Drive
    wanted: tuple[str, ...]

    def replay(self, settings: Settings) -> Predicted:
        try:
            return self.robot.replay(self.start, self.drive, settings, self.wanted)
        except KeyError as missing:
            demand(missing.args[0] not in self.wanted, "replay knows every requested channel", missing, self.wanted)
            raise


def check_robot(robot: Robot, rng: np.random.Generator, size: float = 0.3) -> None:
    """Check names, slots, optional members and replays of a robot; returns where it keeps its contract.

    size: commands are drawn from [-size, size], actuator units, start states are a tenth of that; choose
    what your robot can bear. Raises ContractBroken at the first law that is broken.
    """
    check_names(robot)
    check_slots(robot)
    check_optional(robot)
    outputs = tuple(f"output.{a}" for a in robot.actuators)
    for wanted in (robot.channels, (*robot.channels, *outputs)):
        case = _draw(robot, rng, size, wanted)
        check_replay(case.replay(Settings(ROWS)), case)
        _check_repeats(case)
        _check_rows_alone(case)
        _check_enabled(case)
        _check_tuned(case)
        for effect in _hosted(robot):
            _check_null(case, effect)
    for effect in _hosted(robot):
        if effect.port != "sensor" and effect.name not in MAY_BE_IDLE:
            _check_acts(case, effect)  # but for the sensors, which the diagnosis simulates, whatever the robot


def check_names(robot: Robot) -> None:
    """Names are distinct texts of the run log's format, and belong together."""
    demand(isinstance(robot.name, str) and robot.name != "", "a robot has a name", repr(robot.name), "a string")
    for label, names in (("actuators", robot.actuators), ("channels", robot.channels)):
        texts = isinstance(names, tuple) and bool(names) and all(isinstance(n, str) and n for n in names)
        demand(texts, f"{label} is a tuple of names", repr(names), "at least one string")
        demand(len(set(names)) == len(names), f"{label} are distinct", names, "each name once")
    kinds, count = robot.command_kinds, len(robot.actuators)
    right = len(kinds) == count and set(kinds) <= set(KINDS)
    demand(right, "command_kinds has one kind per actuator", kinds, f"{count} of {KINDS}")
    for channel in robot.channels:
        here = is_measured(channel)
        demand(here, "channels are names of the run log", repr(channel), "position.<joint> or similar")
    for state in robot.states:
        for source in (state.position, state.velocity):
            here = source is None or source in robot.channels
            demand(here, "a state is read from channels", repr(source), f"one of {robot.channels}")
    positive = robot.step is None or robot.step > 0
    demand(positive, "step is a time or None", robot.step, "a positive number of seconds")


def check_slots(robot: Robot) -> None:
    """Slots are distinct names; bounds hold the null value; references and nominal values are finite."""
    for effect in HOSTED:
        slots = robot.slots(effect.name)
        names = isinstance(slots, tuple) and all(isinstance(s, str) for s in slots)
        distinct = names and len(set(slots)) == len(slots)
        demand(distinct, f"slots of {effect.name} are distinct names", repr(slots), "a tuple of strings")
        targets = (None, *slots) if slots else ()
        for p, slot in itertools.product(effect.parameters, targets):
            low, high = robot.bounds(effect.name, p.name, slot)
            law = f"bounds of {effect.name}.{p.name} on {slot} leave room around its null value"
            demand(low <= p.null <= high and low < high, law, (low, high), f"low <= {p.null} <= high")
    sized = {"inertia": robot.slots(ARMATURE.name), "mass": robot.slots(LINK_MASS.name), "length": ()}
    for kind, slots in sized.items():
        for slot in (None, *slots):
            value = robot.reference(kind, slot)
            positive = bool(np.isfinite(value) and value > 0)
            demand(positive, f"reference {kind!r} of {slot} is a typical magnitude", value, "a positive number")
    for name, value in robot.nominal().items():
        demand(bool(np.isfinite(value)), f"nominal parameter {name} is a number", value, "a finite number")


def check_replay(predicted: Predicted, case: _Case) -> None:
    """Every wanted channel is there, (rows, steps + 1) float64 and finite, and begins at the start state."""
    shape = (len(case.drive.clock), case.drive.steps + 1)
    for channel in case.wanted:
        demand(channel in predicted, "replay predicts every requested channel", f"no {channel}", channel)
        y = predicted[channel]
        came = f"{y.shape} {y.dtype}"
        right = y.shape == shape and y.dtype == np.float64
        demand(right, f"{channel} is (rows, steps + 1)", came, f"{shape} float64")
        finite = bool(np.isfinite(y).all())
        demand(finite, f"{channel} is finite", "NaN or infinity", "a finite number at every node (or a smaller `size`)")
        start = case.start.get(channel, y[:, 0])
        demand(np.array_equal(y[:, 0], start), f"{channel} begins at the start state", y[:, 0], start)


def _draw(robot: Robot, rng: np.random.Generator, size: float, wanted: tuple[str, ...]) -> _Case:
    dt = robot.step or 0.01
    lead, steps, nu = int(np.ceil(LEAD / dt)), int(np.ceil(LENGTH / dt)), len(robot.actuators)
    hold = max(1, int(0.05 / dt))  # commands change every 50 ms
    count = -(-(lead + steps) // hold)
    command = np.repeat(rng.uniform(-size, size, (ROWS, count, nu)), hold, axis=1)[:, : lead + steps]
    start = {}
    for state in robot.states:
        start[state.position] = 0.1 * size * rng.standard_normal(ROWS)
        if state.velocity is not None:
            start[state.velocity] = 0.1 * size * rng.standard_normal(ROWS)
    return _Case(robot, start, Drive(dt, lead, command, None, rng.uniform(0.0, 5.0, ROWS)), wanted)


def _hosted(robot: Robot) -> tuple[Effect, ...]:
    return tuple(e for e in HOSTED if robot.slots(e.name))


def _same(law: str, came: Predicted, wanted: Predicted, rows: slice = slice(None)) -> None:
    """Bit for bit."""
    for channel, y in wanted.items():
        off = float(np.max(np.abs(came[channel][rows] - y[rows])))
        same = np.array_equal(came[channel][rows], y[rows])
        demand(same, law, f"{channel} off by up to {off:.3g}", "identical values")


def _check_repeats(case: _Case) -> None:
    """The same call gives the same bits and leaves its arguments alone."""
    given = [*case.start.values(), case.drive.command, case.drive.clock]
    before = [x.copy() for x in given]
    first = {c: y.copy() for c, y in case.replay(Settings(ROWS)).items()}
    kept = all(np.array_equal(a, b) for a, b in zip(before, given, strict=True))
    demand(kept, "replay leaves its arguments alone", "modified arguments", "unchanged arguments")
    _same("the same replay gives the same values", case.replay(Settings(ROWS)), first)


def _check_rows_alone(case: _Case) -> None:
    """A row alone is the row in a batch."""
    whole = case.replay(Settings(ROWS))
    for row in range(ROWS):
        at = slice(row, row + 1)
        drive = replace(case.drive, command=case.drive.command[at], clock=case.drive.clock[at])
        start = {k: v[at] for k, v in case.start.items()}
        alone = case.robot.replay(start, drive, Settings(1), case.wanted)
        for channel, y in whole.items():
            off = np.abs(alone[channel][0] - y[row])
            same = bool((off <= ALONE * (1.0 + np.abs(y[row]))).all())
            came = f"{channel} off by up to {off.max():.3g}"
            demand(same, "a row alone is the same as in a batch", came, "the same values")


def _check_enabled(case: _Case) -> None:
    """An actuator that is on all the time is the same as one that cannot be switched."""
    on = np.ones((ROWS, case.drive.steps, len(case.robot.actuators)))
    switched = replace(case, drive=replace(case.drive, enabled=on)).replay(Settings(ROWS))
    _same("`enabled` of 1 changes nothing", switched, case.replay(Settings(ROWS)))


def _check_tuned(case: _Case) -> None:
    """Every nominal parameter, set to its nominal value, changes nothing."""
    nominal = case.replay(Settings(ROWS))
    for name, value in case.robot.nominal().items():
        tuned = case.replay(Settings(ROWS, {}, {name: np.full(ROWS, value)}))
        _same(f"{name} at its nominal value {value:g} changes nothing", tuned, nominal)


def _values(robot: Robot, effect: Effect, probe: int, outputs: Predicted | None = None) -> dict[str, np.ndarray]:
    """Parameters (ROWS, slots) of one of the effect's probes, inside the robot's bounds."""
    slots, out = robot.slots(effect.name), {}
    for p in effect.parameters:
        unit = robot.reference(p.reference, None) if p.reference in ("inertia", "mass", "length") else 1.0
        if p.reference == "output" and outputs:
            unit = float(np.median([np.abs(y).max() for c, y in outputs.items() if c.startswith("output.")]))
        if p.reference == "turn" and outputs:
            left, right = (y for c, y in outputs.items() if c.startswith("output."))
            unit = float(0.5 * np.abs(right - left).max())
        value = p.probes[min(probe, len(p.probes) - 1)] * unit if p.probes else p.null
        limits = [robot.bounds(effect.name, p.name, s) for s in slots]
        out[p.name] = np.array([[np.clip(value, *limit) for limit in limits]] * ROWS)
    return out


def _check_null(case: _Case, effect: Effect) -> None:
    """At its null value the effect changes nothing bit for bit, alone and beside a row where it acts."""
    nominal = case.replay(Settings(ROWS))
    shape = (ROWS, len(case.robot.slots(effect.name)))
    null = {p.name: np.full(shape, p.null) for p in effect.parameters}
    law = f"{effect.name} at null changes nothing"
    _same(law, case.replay(Settings(ROWS, {effect.name: null})), nominal)
    beside = _values(case.robot, effect, 0)
    for p, values in beside.items():
        values[:-1] = null[p][:-1]
    mixed = case.replay(Settings(ROWS, {effect.name: beside}))
    _same(f"{law}, next to a row where it acts", mixed, nominal, slice(0, ROWS - 1))


def _check_acts(case: _Case, effect: Effect) -> None:
    """An effect that the robot claims to host makes a difference at one of its probes."""
    nominal = case.replay(Settings(ROWS))
    for probe in reversed(range(max(len(p.probes) for p in effect.parameters))):
        moved = case.replay(Settings(ROWS, {effect.name: _values(case.robot, effect, probe, nominal)}))
        if any(not np.array_equal(moved[c], y) for c, y in nominal.items()):
            return
    came = "the nominal prediction at every probe"
    raise ContractBroken(f"{effect.name} changes the prediction of a robot that has slots for it", came, "a difference")
