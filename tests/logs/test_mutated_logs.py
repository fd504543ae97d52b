"""Hundreds of damaged logs: a clear refusal or sound runs that can be audited, never another exception."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from run_tables import ROBOT, WHEELS, table, write_csv

from residual_mpc.errors import BadInput
from residual_mpc.logs.audit import audit
from residual_mpc.logs.jumps import spikes
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.logs.run import held
from residual_mpc.logs.signals import fresh_samples, noise_sigma, resolution, unwrap_with_gaps
from residual_mpc.models.robot_file import RobotFile

CELLS = (
    "",
    "nan",
    "inf",
    "-1e308",
    "1e9",
    "x",
    '"',
    "1,5",
    "\xe9",
    "0x10",
    "1_000",
    "2024-01-01",
    "true",
    " ",
    "\0",
)
HEADERS = ("", "t", "run", "pose.theta", "pose.x", "command.left", "enabled.left", "velocity.left", "t.", "pose.")
CHANGES = ("cell", "header", "drop", "double", "swap", "cut", "add", "reverse")
ODD_COLUMNS: tuple[Callable[[int], object], ...] = (
    lambda n: np.full(n, np.nan),
    lambda n: np.full(n, 0.1),
    lambda n: np.full(n, 1e300),
    lambda n: np.arange(n),
    lambda n: np.arange(n) % 2 == 0,
    lambda n: 1e-300 * np.arange(n),
    lambda n: np.arange(n).astype(np.float32),
    lambda n: np.where(np.arange(n) % 5 == 0, 0.1 * np.arange(n), np.nan),
    lambda n: 0.5 * (np.arange(n) // 4),
    lambda n: 1e6 * (np.arange(n) % 17 == 0),
    lambda n: ["7"] * n,
    lambda n: [None] * n,
    lambda n: [[1.0]] * n,
    lambda n: [b"\xff"] * n,
    lambda n: pd.Categorical(["x"] * n),
    lambda n: pd.date_range("2024", periods=n),
    lambda n: pd.to_timedelta(range(n)),
)


def sound(paths: list[Path], robot: RobotFile) -> None:
    """Read and audit; whatever is accepted has to keep the promises of `Run` and serve every function."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = read_runs(paths, robot)
        except BadInput as fault:
            assert str(fault) and "Traceback" not in str(fault)
            return
        for run in result.runs:
            assert len(run.t) >= 2 and np.all(np.diff(run.t) > 0.0) and run.actuators and run.measured
            for name, y in run.columns.items():
                assert not np.isinf(y).any() and held(run, name).shape == run.t.shape
                sigma = noise_sigma(run.t, y)
                assert np.isfinite(sigma) and resolution(y) >= 0.0
                assert not (spikes(run.t, y, sigma) & ~fresh_samples(y)).any()
                unwrap_with_gaps(y)
            assert all(np.isfinite(held(run, f"command.{actuator}")).all() for actuator in run.actuators)
        assert len({run.name for run in result.runs}) == len(result.runs)
        for finding in (*result.findings, *audit(result.runs, WHEELS)):
            assert finding.message and finding.kind and finding.severity in ("info", "warning", "error")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_csv_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    rows = data.draw(st.sampled_from([2, 3, 7, 30, 120]))
    lines = write_csv(tmp_path / "a.csv", table(rows)).read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        k = data.draw(st.integers(0, len(lines) - 1))
        cells = lines[k].split(",")
        j = data.draw(st.integers(0, len(cells) - 1))
        match data.draw(st.sampled_from(CHANGES)):
            case "cell":
                cells[j] = data.draw(st.sampled_from(CELLS))
                lines[k] = ",".join(cells)
            case "header":
                names = lines[0].split(",")
                names[j % len(names)] = data.draw(st.sampled_from(HEADERS))
                lines[0] = ",".join(names)
            case "drop":
                lines[k] = ""
            case "double":
                lines.insert(k, lines[k])
            case "swap":
                other = data.draw(st.integers(0, len(lines) - 1))
                lines[k], lines[other] = lines[other], lines[k]
            case "cut":
                lines[k] = lines[k][: data.draw(st.integers(0, len(lines[k])))]
            case "add":
                lines[k] += data.draw(st.sampled_from([",", ",1", ";2", "\t", '"', "\r"]))
            case "reverse":
                lines[k:] = lines[:k:-1] + [lines[k]]
    ending = data.draw(st.sampled_from(["\n", "\r\n", "\n\n", ""]))
    (tmp_path / "a.csv").write_text("\n".join(lines) + ending, encoding="utf-8")
    sound([tmp_path / "a.csv"], ROBOT)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_columns_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    columns: dict[str, object] = dict(table(data.draw(st.sampled_from([2, 12, 60, 400]))))
    n = len(columns["t"])  # type: ignore[arg-type]
    for _ in range(data.draw(st.integers(1, 4))):
        name = data.draw(st.sampled_from([*columns, "velocity.left", "enabled.left", "run", "note"]))
        columns[name] = data.draw(st.sampled_from(ODD_COLUMNS))(n)
    pd.DataFrame(columns).to_parquet(tmp_path / "a.parquet")
    sound([tmp_path / "a.parquet"], ROBOT)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["a.csv", "a.parquet"]))
    frame = pd.DataFrame(table(30))
    path = tmp_path / name
    frame.to_parquet(path) if name == "a.parquet" else frame.to_csv(path, index=False)
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        k = data.draw(st.integers(0, len(raw) - 1))
        raw[k] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(raw[: data.draw(st.integers(0, len(raw)))] if data.draw(st.booleans()) else raw))
    sound([path], ROBOT)


@pytest.mark.parametrize("count", [2, 3, 5, 9])
def test_the_shortest_runs_are_sound(tmp_path: Path, count: int) -> None:
    sound([write_csv(tmp_path / "a.csv", table(count))], ROBOT)
