"""A robot file drafted from a model file and runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from residual_mpc.effects.phrase import called
from residual_mpc.errors import BadInput
from residual_mpc.init.calibration.mixed_units import refuse_mixed_units
from residual_mpc.init.calibration.servos import find_gains, find_kinds
from residual_mpc.init.calibration.signs import SignAndZero, find_signs, true_values
from residual_mpc.init.calibration.units import UnitGuess, find_units
from residual_mpc.init.columns.evidence import ColumnEvidence, Roles, where_on
from residual_mpc.init.columns.guess import Guess, LogCorrection
from residual_mpc.init.columns.recording import Recording, column_words, read_recordings
from residual_mpc.init.columns.signals import gather
from residual_mpc.init.columns.time_column import find_clock
from residual_mpc.init.columns.words import ColumnName, read_words
from residual_mpc.init.roles.planar_pose import find_pose, heading_in_degrees, pose_role
from residual_mpc.init.roles.roles import find_roles
from residual_mpc.init.run_settings import RunSetting, find_settings
from residual_mpc.init.uncommanded import Uncommanded, driven_by_measurement, find_uncommanded
from residual_mpc.logs.columns import group, is_measured
from residual_mpc.models.actuators import Actuator
from residual_mpc.models.model_structure import ModelStructure, read_model_structure

TOOLS = ("payload", "tool", "tcp", "load", "ee", "eef", "effector", "gripper", "gripperframe", "flange", "hand", "tip")


@dataclass(frozen=True)
class Unmatched:
    """A column that nothing was found for, or a name of the log format for which no column was; and why."""

    name: str
    why: str


@dataclass(frozen=True)
class Draft:
    """What a robot file should say, and what none can say.

    Attributes:
        name, plant, model: as in the robot file; model is None for a robot that is given by its name.
        log: log name -> column, where they differ.
        actuators: by joint, for a model without any.
        payload_site, pose_body, held, tunable: as in the robot file.
        settings: variants, each with a model of its own.
        guesses: everything guessed, in the order of the file.
        mends: columns that have to be written anew.
        unmatched: columns that are not used. missing: names without a column.
        notes: how the tables were read, where that needs a word.
        parameters: as in the robot file.
    """

    name: str
    plant: str
    model: Path | None
    log: Mapping[str, str]
    actuators: Mapping[str, Actuator]
    payload_site: str | None
    pose_body: str | None
    held: tuple[str, ...]
    tunable: tuple[str, ...]
    settings: tuple[RunSetting, ...]
    guesses: tuple[Guess, ...]
    mends: tuple[LogCorrection, ...]
    unmatched: tuple[Unmatched, ...]
    missing: tuple[Unmatched, ...]
    notes: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)


def draft(model: Path, paths: Sequence[str | Path]) -> Draft:
    """Guess what the robot file of a model and its runs should say.

    Raises BadInput for a model that does not compile, runs that cannot be read, runs without a time, and runs of which
    no column can be a command, or none a measurement, or whose units differ.
    """
    structure = read_model_structure(model)
    recordings = read_recordings(paths)
    clock = find_clock(recordings)
    signals = gather(recordings, clock)
    words = column_words(signals.names, recordings)
    pose, left = find_pose(words, signals) if structure.base is not None else (Roles({}), {})
    case = ColumnEvidence(structure, signals, {n: w for n, w in words.items() if n not in pose.columns.values()})
    roles = driven_by_measurement(case, _shared_switch(case, find_roles(case)))
    alone = find_uncommanded(case, roles)
    roles = roles.plus(pose)
    _refuse_empty(roles, structure, recordings)

    whole, case = case, where_on(case, roles)
    kinds, kind_guesses = find_kinds(case, roles)
    refuse_mixed_units(case, recordings, clock, roles, kinds)
    units = find_units(case, roles, kinds)
    turned, offsets = find_signs(case, roles, units, kinds)
    mends = (*clock.mends, *_mends(case, roles, units, turned), *heading_in_degrees(signals, roles))
    actuators: dict[str, Actuator] = {}
    gain_guesses: tuple[Guess, ...] = ()
    if not structure.actuators:
        places = {j: true_values(case, c, units, turned) for j, c in roles.of("position").items()}
        sent = {a: true_values(case, c, units, turned) for a, c in roles.of("command").items()}
        gains = find_gains(case, places, sent, kinds)
        actuators, gain_guesses = dict(gains.actuators), gains.guesses
    tunable = _tunable(model, actuators)
    settings, setting_guesses = find_settings(model, structure, recordings)
    site, site_guess = _payload_site(structure)
    return Draft(
        model.stem,
        structure.plant,
        model,
        log_entries(roles.columns, clock.column, recordings),
        actuators,
        site,
        structure.base,
        alone.held,
        tunable,
        settings,
        (
            *site_guess,
            *_base_guess(structure),
            *alone.guesses,
            *_tunable_guess(tunable),
            *setting_guesses,
            *clock.guesses,
            *run_guess(recordings),
            *roles.guesses,
            *_unit_guesses(units),
            *offsets,
            *kind_guesses,
            *gain_guesses,
        ),
        mends,
        _unmatched(whole, roles, recordings, {**_no_pose(structure, words), **left}),
        _missing(case, roles, alone),
        tuple(dict.fromkeys(note for r in recordings for note in r.notes)),
    )


def _shared_switch(case: ColumnEvidence, roles: Roles) -> Roles:
    """One switch in the table is the switch of all actuators."""
    switches = [
        n
        for n, w in case.words.items()
        if w.quantity == "enabled" and not w.core and np.isin(case.signals.raw[n], (0.0, 1.0)).any()
    ]
    if len(switches) != 1 or len(case.driven) < 2 or roles.of("enabled"):
        return roles
    driven = [d for d in case.driven if f"command.{d.name}" in roles.columns]
    guesses = tuple(Guess(f"enabled.{d.name}", switches[0], "one switch for all actuators", 0.7) for d in driven)
    return roles.plus(Roles({f"enabled.{d.name}": switches[0] for d in driven}, guesses))


def _refuse_empty(roles: Roles, structure: ModelStructure, recordings: Sequence[Recording]) -> None:
    columns = list(dict.fromkeys(n for r in recordings for n in r.columns))
    listed = ", ".join(columns[:30]) + (", ..." if len(columns) > 30 else "")
    wanted = {
        "command": [a.name for a in structure.actuators] or [j.name for j in structure.joints],
        "measurement": [j.name for j in structure.joints],
    }
    served = set(roles.of("command").values())
    there = {
        "command": bool(roles.of("command")),
        "measurement": any(is_measured(n) and c not in served for n, c in roles.columns.items()),
    }
    for what, names in wanted.items():
        if not there[what]:
            raise BadInput(
                f"no column matches a {what} of {', '.join(names[:10])}; the columns are {listed}",
                str(recordings[0].source),
                "log both commands and measurements, or write the robot file by hand with a [log] table",
            )


def log_entries(roles: Mapping[str, str], clock: str, recordings: Sequence[Recording]) -> dict[str, str]:
    """The [log] of a robot file: log name -> column, where they differ."""
    named = {"t": clock, **roles}
    run_column = next((r.run_column for r in recordings if r.run_column), None)
    if run_column is not None:
        named["run"] = run_column
    return {name: column for name, column in named.items() if name != column}


def _mends(
    case: ColumnEvidence, roles: Roles, units: Mapping[str, UnitGuess], turned: Mapping[str, SignAndZero]
) -> list[LogCorrection]:
    """Unit, sign and zero of each column, as one formula."""
    mends = []
    for column in dict.fromkeys(roles.columns.values()):
        unit, turn = units.get(column), turned.get(column, SignAndZero())
        size = 1.0 if unit is None else unit.unit.size
        factor = turn.sign * size
        if factor == 1.0 and turn.offset == 0.0:
            continue
        reasons = [turn.why] if turn.why else []
        if unit is not None and size != 1.0:
            reasons.insert(0, f"it is in {unit.unit.name} ({unit.why})")
        sure = min(turn.sure, unit.sure if unit is not None and size != 1.0 else 1.0)
        mends.append(LogCorrection(column, factor, turn.offset, "; ".join(reasons), sure))
    return mends


def _unit_guesses(units: Mapping[str, UnitGuess]) -> list[Guess]:
    return [Guess(f"unit of {column}", u.unit.name, u.why, u.sure, u.rivals) for column, u in units.items()]


def _payload_site(structure: ModelStructure) -> tuple[str | None, tuple[Guess, ...]]:
    for tool in TOOLS:
        for site in reversed(structure.sites):
            if tool in read_words(site).every:
                return site, (Guess("payload_site", site, "its name suggests a tool", 0.7),)
    return None, ()


def _base_guess(structure: ModelStructure) -> tuple[Guess, ...]:
    if structure.base is None:
        return ()
    return (Guess("pose_body", structure.base, "this body has the free joint", 0.95),)


def _tunable(model: Path, actuators: Mapping[str, Actuator]) -> tuple[str, ...]:
    """What is guessed or not known of servos that no model file describes: their gains and, of a URDF, which does not
    state them, their rotors."""
    gains = [name for name in ("kp", "kv") if any(getattr(a, name) > 0.0 for a in actuators.values())]
    rotors = ["joint.*.armature"] if gains and model.suffix.lower() == ".urdf" else []
    return (*(f"actuator.*.{name}" for name in gains), *rotors)


def _tunable_guess(tunable: Sequence[str]) -> tuple[Guess, ...]:
    if not tunable:
        return ()
    rotors = any(name.startswith("joint.") for name in tunable)
    what = "the gains below are guesses" + (" and a URDF states no rotor inertias" if rotors else "")
    why = f"{what}, so every fit may adjust these; once you know the true values, enter them and remove the patterns"
    return (Guess("tunable", ", ".join(tunable), why, 0.6),)


def run_guess(recordings: Sequence[Recording]) -> tuple[Guess, ...]:
    """The column that tells the runs of a table apart, where there is one."""
    column = next((r.run_column for r in recordings if r.run_column), None)
    if column is None:
        return ()
    count = sum(r.run_column is not None for r in recordings)
    return (Guess("run", column, f"its name, and it distinguishes {count} runs", 0.99 if column == "run" else 0.8),)


def _no_pose(structure: ModelStructure, words: Mapping[str, ColumnName]) -> dict[str, str]:
    """Why columns that may be a pose are left by a model that cannot drive."""
    if structure.base is not None:
        return {}
    why = "it may be {}, but the model is fixed to the world: give its chassis a <freejoint/> and the world a ground"
    return {name: why.format(role) for name, w in words.items() if (role := pose_role(w)) is not None}


def _unmatched(
    case: ColumnEvidence, roles: Roles, recordings: Sequence[Recording], left: Mapping[str, str]
) -> tuple[Unmatched, ...]:
    used = set(roles.columns.values())
    texts = dict.fromkeys(t for r in recordings for t in r.texts if t != r.run_column)
    return (
        *(Unmatched(n, left.get(n) or _why_left(case, w)) for n, w in case.words.items() if n not in used),
        *(Unmatched(n, "the column is not numeric") for n in texts),
    )


def _why_left(case: ColumnEvidence, words: ColumnName) -> str:
    if not case.signals.moves(words.name):
        return "it never changes, and its name matches nothing that is still missing"
    if words.quantity == "effort":
        return "a current or a torque, which is not compared"
    if words.quantity in ("other", "acceleration"):
        return "its name indicates a quantity outside the log format"
    if group(words.name) is not None:
        return "the model has no such joint or actuator"
    return "neither its name nor its data match a joint or actuator that is still missing"


def _missing(case: ColumnEvidence, roles: Roles, alone: Uncommanded) -> tuple[Unmatched, ...]:
    """Commands without which `gap` refuses the runs, and joints that nothing measures."""
    needed = "no column matches, but every actuator that moves needs a command: log it, or remove it from the model"
    missing = [Unmatched(f"command.{d.name}", needed) for d in alone.lacking]
    free = "no column matches; {} is assumed to be passive"
    missing += [Unmatched(f"command.{d.name}", free.format(called("joint", d.joint))) for d in alone.passive]
    joints = {j for g in ("position", "velocity") for j in roles.of(g)}
    for j in case.structure.joints:
        if j.name not in joints and j.follows is None:
            missing.append(Unmatched(f"position.{j.name}", "no column matches; it starts each window at 0"))
    return tuple(missing)
