"""What is guessed of a log: the truth is known, since the log was simulated and then written as others write theirs."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from init.arm_logs import JOINTS, KP, URDF, mjcf, simulate, simulate_six_joints, six_joint_mjcf, write

from residual_mpc.init.columns.signals import Signals
from residual_mpc.init.draft import Draft, draft
from residual_mpc.logs.columns import group, member

Names = Callable[[str, str, int], str]  # group, joint, its number -> the column's name
NAMES: dict[str, Names] = {
    "the log format's": lambda g, j, i: f"{g}.{j}",
    "lerobot": lambda g, j, i: {"command": f"action.{j}.pos"}.get(g, f"observation.state.{j}.{g[:3]}"),
    "numbers from 0": lambda g, j, i: (
        {"command": "target_q_", "position": "actual_q_", "velocity": "actual_qd_"}[g] + str(i)
    ),
    "numbers from 1": lambda g, j, i: (
        {"command": "goal_position", "position": "present_position"}.get(g, "present_velocity") + str(i + 1)
    ),
    "franka": lambda g, j, i: {"command": "q_d", "position": "q", "velocity": "dq"}[g] + f"[{i}]",
    "short": lambda g, j, i: j[:3] + {"command": "Cmd", "position": "Pos", "velocity": "Vel"}[g],
    "bare": lambda g, j, i: j + {"command": "_ref", "position": "", "velocity": "_speed"}[g],
}


@pytest.fixture(scope="module")
def recorded() -> pd.DataFrame:
    return simulate()


@pytest.fixture()
def model(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(mjcf())
    return path


def named(table: pd.DataFrame, names: Names) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table under other names, and log name -> column."""
    truth = {c: c if c == "t" else names(group(c) or "", member(c), JOINTS.index(member(c))) for c in table.columns}
    return table.rename(columns=truth), truth


def drafted(model: Path, table: pd.DataFrame) -> Draft:
    return draft(model, [write(model.parent, table)])


def columns_of(found: Draft) -> dict[str, str]:
    return {g.what: g.value for g in found.guesses if g.what == "t" or group(g.what) is not None}


def mends_of(found: Draft) -> dict[str, tuple[float, float]]:
    return {m.column: (m.factor, m.offset) for m in found.mends}


@pytest.mark.parametrize("names", NAMES)
def test_columns_are_found_by_any_names(model: Path, recorded: pd.DataFrame, names: str) -> None:
    table, truth = named(recorded, NAMES[names])
    found = drafted(model, table)
    assert columns_of(found) == truth
    assert found.log == {name: column for name, column in truth.items() if name != column}
    assert found.mends == () and found.unmatched == () and found.missing == ()
    assert min(g.sure for g in found.guesses) > 0.5


def test_one_joint_needs_no_names_at_all(tmp_path: Path, recorded: pd.DataFrame) -> None:
    xml = mjcf(joints=("shoulder", "fixed")).replace('<joint name="fixed" axis="0 1 0"', '<site name="x"/><!--')
    xml = xml.replace('frictionloss="0.02"/><site name="tool"', 'frictionloss="0.02"/--><site name="tool"')
    xml = xml.replace('<position name="fixed" joint="fixed" kp="12.0" kv="0.6"/>', "")
    (tmp_path / "one.xml").write_text(xml)
    secret = {"t": "a", "command.shoulder": "b", "position.shoulder": "c", "velocity.shoulder": "d"}
    table = recorded[["velocity.shoulder", "position.shoulder", "t", "command.shoulder"]].rename(columns=secret)
    assert columns_of(drafted(tmp_path / "one.xml", table)) == secret


@pytest.mark.parametrize(("unit", "size", "word"), [("deg", 180 / pi, "_deg"), ("deg", 180 / pi, "")])
def test_degrees_are_said_with_the_column(
    model: Path, recorded: pd.DataFrame, unit: str, size: float, word: str
) -> None:
    table, truth = named(recorded, lambda g, j, i: f"{j}_{g}{word}")
    table[list(truth.values())[1:]] *= size
    found = drafted(model, table)
    assert columns_of(found) == truth
    for column in list(truth.values())[1:]:
        assert mends_of(found)[column] == pytest.approx((1 / size, 0.0))


def test_degrees_of_the_sensors_alone(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.copy()
    table[[c for c in table if c.startswith("position")]] *= 180 / pi
    assert mends_of(drafted(model, table)) == {f"position.{j}": (pytest.approx(pi / 180), 0.0) for j in JOINTS}


def test_encoder_counts_and_their_zero(model: Path, recorded: pd.DataFrame) -> None:
    table, truth = named(recorded, NAMES["numbers from 1"])
    counted = [c for n, c in truth.items() if group(n) in ("command", "position")]
    table[counted] = (table[counted] * 4096 / (2 * pi) + 2048).round()
    found = drafted(model, table)
    assert {c: mends_of(found)[c] for c in counted} == dict.fromkeys(
        counted, (pytest.approx(2 * pi / 4096), pytest.approx(-pi))
    )


@pytest.mark.parametrize(("column", "size"), [("t_ms", 1e3), ("timestamp", 1e3), ("stamp_us", 1e6)])
def test_units_of_time(model: Path, recorded: pd.DataFrame, column: str, size: float) -> None:
    table = recorded.rename(columns={"t": column})
    table[column] *= size
    assert mends_of(drafted(model, table)) == {column: (pytest.approx(1 / size), 0.0)}


@pytest.mark.parametrize("start", [0, 5 * 10**12, 1_700_000_000 * 10**9])
def test_nanoseconds_need_no_mending(model: Path, recorded: pd.DataFrame, start: int) -> None:
    table = recorded.rename(columns={"t": "stamp"})
    table["stamp"] = start + (1e9 * table["stamp"]).astype("int64")
    found = drafted(model, table)
    assert found.mends == () and found.log == {"t": "stamp"}
    assert ("unit of stamp", "ns") in {(g.what, g.value) for g in found.guesses}


def test_dates_are_times_that_need_no_mending(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.rename(columns={"t": "date_time"})
    table["date_time"] = pd.to_datetime((table["date_time"] * 1e9 + 1.7e18).astype("int64")).astype(str)
    found = drafted(model, table)
    assert found.mends == () and found.log == {"t": "date_time"}


def test_a_turned_sensor_is_turned_back_with_its_rate(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.copy()
    table[["position.elbow", "velocity.elbow"]] *= -1.0
    found = drafted(model, table)
    turned = {m.column for m in found.mends}
    assert turned == {"position.elbow", "velocity.elbow"} or turned == {"command.elbow"}
    assert all(m.factor == -1.0 for m in found.mends) and "moves opposite to" in " ".join(m.why for m in found.mends)


def test_a_turned_sensor_of_a_smooth_motion_is_no_late_speed() -> None:
    """A smooth motion is nearly its own negative half a swing later: an answer of 40 ms turned is exact."""
    t = 0.01 * np.arange(2400)
    sent = np.sin(6.3 * t) + 0.25 * np.sin(7.9 * t + 1.0)
    raw = {"sent": sent, "seen": -np.concatenate([np.full(4, sent[0]), sent[:-4]])}
    signals = Signals(0.01, raw, np.zeros(len(t), dtype=int))
    match = signals.follows("sent", "seen")
    assert match.opposite and match.correlation < -0.99
    assert match.against > -match.correlation - 0.15  # the other sign is as near as this, half a swing later
    assert match.lag == pytest.approx(0.04, abs=0.005)
    forward = signals.follows("seen", "sent").per(-1.0)
    assert forward.correlation > 0.99


def test_a_zero_a_quarter_turn_away(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.copy()
    table["position.elbow"] += pi / 2
    assert mends_of(drafted(model, table)) == {"position.elbow": (1.0, pytest.approx(-pi / 2))}


def test_a_small_offset_is_said_and_left_to_the_diagnosis(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.copy()
    table["position.elbow"] += 0.15
    found = drafted(model, table)
    (guess,) = [g for g in found.guesses if g.what == "offset of position.elbow"]
    assert float(guess.value.split()[0]) == pytest.approx(0.15, abs=0.05) and found.mends == ()


def test_two_columns_that_fit_alike_are_both_said(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.rename(columns={"position.elbow": "elbow_angle"})
    rng = np.random.default_rng(0)
    table["elbow_angle_raw"] = table["elbow_angle"] + 1e-3 * rng.standard_normal(len(table))
    (guess,) = [g for g in drafted(model, table).guesses if g.what == "position.elbow"]
    assert {guess.value, *guess.rivals} == {"elbow_angle", "elbow_angle_raw"} and guess.sure < 0.8


def test_what_only_the_order_tells_apart_is_hardly_sure(model: Path, recorded: pd.DataFrame) -> None:
    table, _ = named(recorded, lambda g, j, i: {"command": "sent_", "position": "angle_"}.get(g, "speed_") + "xyz"[i])
    found = drafted(model, table)
    assert all(g.sure <= 0.3 for g in found.guesses if g.what.startswith("position."))


def test_what_is_not_used_has_a_reason(model: Path, recorded: pd.DataFrame) -> None:
    table = recorded.assign(motor_temperature=20.0, note="fine", elbow_current=np.sin(recorded["t"]))
    found = drafted(model, table)
    assert {u.name for u in found.unmatched} == {"motor_temperature", "note", "elbow_current"}
    assert all(u.why for u in found.unmatched)


def test_runs_of_one_table(model: Path, recorded: pd.DataFrame) -> None:
    table = pd.concat([recorded.assign(episode_index=k) for k in range(2)])
    assert drafted(model, table).log == {"run": "episode_index"}


@pytest.mark.parametrize("kind", ["position", "velocity", "motor"])
def test_actuators_of_a_urdf(tmp_path: Path, kind: str) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    table, _ = named(simulate(kind), lambda g, j, i: f"{j}_{'cmd' if g == 'command' else g}")
    found = drafted(tmp_path / "arm.urdf", table)
    assert [a.kind for a in found.actuators.values()] == [kind, kind] and tuple(found.actuators) == JOINTS
    if kind == "position":
        for gain, true in zip(found.actuators.values(), KP, strict=True):
            assert true / 1.5 < gain.kp < true * 1.5
        assert found.tunable == ("actuator.*.kp", "actuator.*.kv", "joint.*.armature")
    if kind == "motor":
        assert not found.tunable
        assert all(a.gear == 1.0 for a in found.actuators.values())


def test_a_torque_with_the_other_sign(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(mjcf("motor"))
    table = simulate("motor")
    table["command.shoulder"] *= -1.0
    found = drafted(tmp_path / "arm.xml", table)
    assert mends_of(found) == {"command.shoulder": (-1.0, pytest.approx(0.0))}


def test_models_named_like_runs_are_variants(tmp_path: Path, recorded: pd.DataFrame) -> None:
    for name in ("soft", "stiff"):
        (tmp_path / f"{name}.xml").write_text(mjcf())
        write(tmp_path, recorded, f"{name}_1.csv")
    found = draft(tmp_path / "soft.xml", [tmp_path])
    assert {s.runs: s.model.name for s in found.settings} == {"soft*": "soft.xml", "stiff*": "stiff.xml"}


@pytest.mark.parametrize("column", ["command.elbow", "position.elbow", "velocity.elbow", "enabled.elbow"])
def test_a_column_without_a_value_hinders_nothing(model: Path, recorded: pd.DataFrame, column: str) -> None:
    found = drafted(model, recorded.assign(**{column: np.nan}))
    rest = set(recorded.columns) - {column}
    assert {n for n in rest if columns_of(found).get(n) == n} == rest
    assert ("command.elbow" in {m.name for m in found.missing}) == (column == "command.elbow")


def test_a_handful_of_samples_is_enough_for_the_names(model: Path, recorded: pd.DataFrame) -> None:
    assert columns_of(drafted(model, recorded.head(3))) == {c: c for c in recorded}


@pytest.fixture(scope="module")
def greased() -> pd.DataFrame:
    """Six joints whose torques go like their speeds, three of them about 57 times, as degrees go like radians."""
    return simulate_six_joints()


def of_six(folder: Path, table: pd.DataFrame, names: dict[str, str]) -> Draft:
    """The draft of such a log under other names: group -> name, with {} for the joint's number."""
    columns = {f"{g}_{k}": name.format(k) for g, name in names.items() for k in range(6)}
    kept = [c for c in table if c == "t" or c.rpartition("_")[0] in {*names, "goal_position", "position"}]
    (folder / "six.xml").write_text(six_joint_mjcf())
    return drafted(folder / "six.xml", table[kept].rename(columns=columns))


NEUTRAL = ("x_{}", "sensor[{}]", "s{}", "t_{}", "actual_m{}", "observation.state.{}")


@pytest.mark.parametrize("name", [*NEUTRAL, "tau_{}", "tq_{}", "torq{}", "current_{}", "iq_{}", "curr{}", "joint{}_nm"])
def test_torques_are_no_velocities(tmp_path: Path, greased: pd.DataFrame, name: str) -> None:
    found = of_six(tmp_path, greased, {"torque": name})
    torques = {name.format(k) for k in range(6)}
    claimed = {g.what for g in found.guesses if g.value in torques}
    assert all(what.startswith("effort.") for what in claimed) and found.mends == ()
    assert {f"position.j{k}": f"position_{k}" for k in range(6)}.items() <= found.log.items()


@pytest.mark.parametrize("name", ["effort_{}", "tau_{}", "torq{}", "tq_{}", "joint{}_nm"])
def test_torques_are_efforts_by_their_names(tmp_path: Path, greased: pd.DataFrame, name: str) -> None:
    found = of_six(tmp_path, greased, {"torque": name})
    assert {f"effort.j{k}": name.format(k) for k in range(6)}.items() <= found.log.items()


@pytest.mark.parametrize("name", NEUTRAL)
@pytest.mark.parametrize("size", [1.0, 180.0 / pi, 30.0 / pi])
def test_velocities_need_no_name(tmp_path: Path, greased: pd.DataFrame, name: str, size: float) -> None:
    table = greased.copy()
    table[[f"velocity_{k}" for k in range(6)]] *= size
    found = of_six(tmp_path, table, {"velocity": name, "torque": "tau_{}"})
    assert {f"velocity.j{k}": name.format(k) for k in range(6)}.items() <= found.log.items()
    factors = {m.column: m.factor for m in found.mends}
    assert factors == ({} if size == 1.0 else {name.format(k): pytest.approx(1.0 / size) for k in range(6)})


def test_velocities_and_torques_under_the_same_name(tmp_path: Path, greased: pd.DataFrame) -> None:
    table = greased.rename(columns={f"torque_{k}": f"x_{6 + k}" for k in range(6)})
    table = table.rename(columns={f"velocity_{k}": f"x_{k}" for k in range(6)})
    (tmp_path / "six.xml").write_text(six_joint_mjcf())
    found = drafted(tmp_path / "six.xml", table)
    claimed = {g.value for g in found.guesses if g.what.startswith("velocity.")}
    assert claimed <= {f"x_{k}" for k in range(6)}


@pytest.mark.parametrize("beside", [False, True])
def test_torques_are_the_commands_of_motors_unless_others_say_so(tmp_path: Path, beside: bool) -> None:
    """tau may be sent or measured. Where nothing else commands the motors it was sent."""
    path, table = tmp_path / "arm.xml", simulate("motor")
    path.write_text(mjcf("motor"))
    short = {"command": "tau", "position": "q", "velocity": "dq"}
    table, truth = named(table, lambda g, j, i: f"{short[g]}_{i + 1}")
    if beside:
        truth |= {f"effort.{j}": f"tau_{i + 1}" for i, j in enumerate(JOINTS)}
        truth |= {f"command.{j}": f"tau_des_{i + 1}" for i, j in enumerate(JOINTS)}
        table = table.assign(**{f"tau_des_{i}": 1.02 * table[f"tau_{i}"] for i in (1, 2)})
    found = drafted(path, table)
    assert columns_of(found) == truth
    sure = {g.what: g.sure for g in found.guesses}
    assert all((sure[f"command.{j}"] > 0.9) is beside for j in JOINTS)
