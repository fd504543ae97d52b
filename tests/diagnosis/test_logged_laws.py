"""A gain that follows a logged voltage is a law of that column in every file; what follows the motion is none."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.battery_rover import FILE, SIGMA, battery_run, share_at
from oracles.rover_log import write_run

import residual_mpc as rm
from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.logged_columns import at_starts, foreknown_columns
from residual_mpc.diagnosis.laws.columns import of_columns
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.effects.laws import USUAL, curve_shape, logged_kind
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, assemble
from residual_mpc.models.targets import Targets

ROVER = DiffDrive("rover", 0.05, 0.3)
RUNS = [battery_run(seed, 12.4 - 0.4 * seed) for seed in range(4)]


def windows(runs: Sequence[Run]) -> Dataset:
    return build_dataset(runs, [ROVER] * len(runs), SIGMA)


def with_column(run: Run, name: str, values: np.ndarray) -> Run:
    return replace(run, extra_columns={**run.extra_columns, name: values})


def test_only_a_column_that_its_start_foretells_counts() -> None:
    """Neither a number of the row, nor a power that follows the commands."""
    assert foreknown_columns(windows(RUNS)) == ("battery_voltage",)


def test_a_column_that_a_run_lacks_does_not_count() -> None:
    bare = replace(RUNS[0], extra_columns={})
    assert foreknown_columns(windows([*RUNS[1:], bare])) == ()
    assert foreknown_columns(windows([bare, *RUNS[1:]])) == ()


def test_a_number_for_each_run_needs_five_runs() -> None:
    runs = [battery_run(seed, 12.0, seconds=5.0) for seed in range(5)]
    warm = [with_column(r, "temperature", np.full(len(r.t), 20.0 + 3.0 * k)) for k, r in enumerate(runs)]
    assert foreknown_columns(windows(warm)) == ("temperature",)
    assert foreknown_columns(windows(warm[:4])) == ()


def test_the_value_at_a_start_is_that_of_the_second_before_it() -> None:
    t = RUNS[0].t
    run = with_column(RUNS[0], "counter", np.where(np.arange(len(t)) % 2 == 0, t, np.nan))
    data = windows([run])
    found = at_starts(data, "counter")
    assert found[0] == 0.0
    np.testing.assert_allclose(found[1:], data.start[1:] - 0.5, atol=0.051)


def test_a_run_without_the_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(rm.BadInput, match="run0.*'humidity'"):
        at_starts(windows(RUNS), "humidity")


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("battery")
    (folder / "robot.toml").write_text(FILE)
    for run in RUNS:
        write_run(replace(run, columns={**run.columns, **run.extra_columns}), folder)
    robot = rm.load_robot(folder / "robot.toml")
    rm.diagnose(robot, rm.read_runs(robot, sorted(folder.glob("run*.csv")))).save(folder / "out")
    return folder


@pytest.mark.slow
def test_a_gain_that_follows_the_voltage_is_a_law_of_it(diagnosed: Path) -> None:
    found = json.loads((diagnosed / "out" / "diagnosis.json").read_text())
    (law,) = found["explanation"]
    assert (law["effect"], law["of"], law["on"]) == ("fitted_law", "strength", "the logged battery_voltage")
    assert found["verdict"] == "partial" and found["gap"]["after"] < 1.5 * found["gap"]["noise_floor"]
    for voltage, value in zip(law["knots"], law["values"], strict=True):
        assert 1.0 + value == pytest.approx(share_at(voltage), abs=0.015)
    assert "battery_voltage" in law["sentence"]


@pytest.mark.slow
def test_the_gap_command_reads_the_column(diagnosed: Path) -> None:
    robot, file = rm.load_robot(diagnosed / "robot.toml"), diagnosed / "out" / "diagnosis.json"
    runs = rm.read_runs(robot, sorted(diagnosed.glob("run*.csv")))
    found = json.loads(file.read_text())
    gap = rm.measure_gap(robot, runs, model=file, held_out_of=file)
    assert gap.model == pytest.approx(found["gap"]["after"], rel=1e-6)
    bare = write_run(replace(RUNS[0], name="bare"), diagnosed)
    with pytest.raises(rm.BadInput, match="battery_voltage"):
        rm.measure_gap(robot, rm.read_runs(robot, [bare]), model=file)


@pytest.mark.slow
def test_controllers_have_the_law_as_a_parameter(diagnosed: Path) -> None:
    robot, file = rm.load_robot(diagnosed / "robot.toml"), diagnosed / "out" / "diagnosis.json"
    model = rm.augment(robot, file, dt=0.05)
    (column,) = model.logged
    assert column == "battery_voltage" and 10.0 < model.logged[column] < 12.5
    gain = model.parameters.index("actuator_gain.left.gain")
    for voltage in (11.0, 12.0):
        assert model.p_at({column: voltage})[gain] == pytest.approx(share_at(voltage), abs=0.015)
        chosen = rm.augment(robot, file, dt=0.05, logged={column: voltage})
        np.testing.assert_array_equal(chosen.p, model.p_at({column: voltage}))
    with pytest.raises(rm.BadInput, match="battery_voltage"):
        model.p_at({"temperature": 20.0})
    with pytest.raises(rm.BadInput, match="finite"):
        model.p_at({column: float("nan")})


@pytest.mark.slow
def test_what_does_not_follow_the_voltage_is_no_law_of_it(tmp_path: Path) -> None:
    """Turns to the right that fall short, beside a voltage that falls all the same: a law, but of something else."""
    (tmp_path / "robot.toml").write_text(FILE)
    for seed in range(3):
        run = battery_run(seed, 12.4 - 0.4 * seed, 20.0, weakens=False, right=0.6)
        write_run(replace(run, columns={**run.columns, **run.extra_columns}), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    found = rm.diagnose(robot, rm.read_runs(robot, sorted(tmp_path.glob("run*.csv"))))
    laws = [e for e in found.explanation if e["effect"] == "fitted_law"]
    assert laws and not any("logged" in law["on"] for law in laws)


def arm_windows(folder: Path, *columns: str) -> Dataset:
    """An arm of two servos with slowly wandering columns, half a minute."""
    robot = robot_of(folder, arm_xml())
    rng, t = np.random.default_rng(0), 0.05 * np.arange(600)
    slow = {c: 20.0 + 0.1 * np.cumsum(rng.standard_normal(600)) for c in columns}
    moved = {
        f"{kind}.{j}": 0.5 * np.sin((1.0 + k) * t)
        for k, j in enumerate(("j1", "j2"))
        for kind in ("command", "position")
    }
    run = Run("run", t, moved, extra=columns, extra_columns=slow)
    return build_dataset([run], [robot], {"position.j1": 1e-3, "position.j2": 1e-3})


def test_every_column_has_its_turn(tmp_path: Path) -> None:
    """On the joint that it is named after, else on all and on the joint that misses most."""
    data = arm_windows(tmp_path, "temperature.j1", "temperature.j2", "supply")
    found = of_columns(data, "position.j2", LawSettings())
    terms = [(p.term.effect.partition("_logged:")[2], p.term.target) for p in found]
    assert len(terms) == LawSettings().columns
    assert {c for c, _ in terms} == {"temperature.j1", "temperature.j2", "supply"}
    assert {t for c, t in terms if c == "temperature.j1"} == {"j1"}
    assert {t for c, t in terms if c == "supply"} == {None, "j2"}
    assert all(p.fixed[Knob(p.term.effect, p.term.target, USUAL)] > 0.0 for p in found)


def test_a_friction_of_one_joint_follows_its_column_in_a_replay(tmp_path: Path) -> None:
    """As the plain effect does at the column's value before each window."""
    data = arm_windows(tmp_path, "temperature.j2")
    kind = logged_kind("damping", "temperature.j2")
    law = {
        Knob(kind.name, "j2", k): v
        for k, v in {**curve_shape([15.0, 25.0]), USUAL: 20.0, "start": 0.6, "rise2": -0.5}.items()
    }
    robot, z = data.blocks[0].robot, at_starts(data, "temperature.j2")
    found = predict(data, assemble([law], Targets(robot)))[0]
    plain = Knob("viscous_friction", "j2", "coefficient")
    for w in (0, 7, 19):
        one = {plain: float(np.interp(z[w], [15.0, 25.0], [0.6, 0.1]))}
        np.testing.assert_allclose(found[w], predict(data, assemble([one], Targets(robot)))[0, w], atol=1e-12)
    assert np.ptp(z) > 1.0


def test_a_column_that_begins_late_does_not_count() -> None:
    run = RUNS[0]
    late = np.where(run.t < 15.0, np.nan, run.extra_columns["battery_voltage"])
    data = windows([with_column(run, "late", late)])
    assert np.isnan(at_starts(data, "late")[:4]).all() and np.isfinite(at_starts(data, "late")[-4:]).all()
    assert "late" not in foreknown_columns(data)
