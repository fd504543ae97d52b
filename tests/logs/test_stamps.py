"""Time stamps since whenever, in seconds or nanoseconds, count from each run's start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from run_tables import ROBOT, table

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.read import read_runs

EPOCH = 1_760_000_000_123_456_789  # ns
STEP = 20_000_001  # ns
COUNT = EPOCH + STEP * np.arange(50)  # (50,) ns


def logged(folder: Path, t: object, name: str = "run.csv") -> Path:
    frame = pd.DataFrame({**table(), "t": t})
    path = folder / name
    if name.endswith(".csv"):
        frame.to_csv(path, index=False)
    else:
        frame.to_parquet(path)
    return path


@pytest.mark.parametrize("name", ["run.csv", "run.parquet"])
def test_whole_nanoseconds_keep_every_digit(tmp_path: Path, name: str) -> None:
    result = read_runs([logged(tmp_path, COUNT, name)], ROBOT)
    (run,) = result.runs
    np.testing.assert_allclose(run.t, 1e-9 * STEP * np.arange(50), rtol=0.0, atol=1e-12)
    assert run.start == pytest.approx(1e-9 * EPOCH)
    assert [(f.severity, f.kind) for f in result.findings] == [("info", "stamps in ns")]


def test_unsigned_nanoseconds_with_a_missing_one(tmp_path: Path) -> None:
    stamps = pd.array(COUNT, dtype="UInt64")
    stamps[7] = pd.NA
    (run,) = read_runs([logged(tmp_path, stamps, "run.parquet")], ROBOT).runs
    np.testing.assert_allclose(run.t, 1e-9 * STEP * np.delete(np.arange(50), 7), rtol=0.0, atol=1e-12)


def test_nanoseconds_as_floats(tmp_path: Path) -> None:
    (run,) = read_runs([logged(tmp_path, COUNT.astype(np.float64), "run.parquet")], ROBOT).runs
    np.testing.assert_allclose(run.t, 1e-9 * STEP * np.arange(50), rtol=0.0, atol=3e-7)


def test_nanoseconds_since_the_computer_was_switched_on(tmp_path: Path) -> None:
    (run,) = read_runs([logged(tmp_path, 5_000_000_000 + 1_000_000 * np.arange(50))], ROBOT).runs
    np.testing.assert_allclose(run.t, 1e-3 * np.arange(50), rtol=0.0, atol=1e-12)


def test_seconds_since_1970_count_from_the_start(tmp_path: Path) -> None:
    (run,) = read_runs([logged(tmp_path, 1.76e9 + 0.02 * np.arange(50), "run.parquet")], ROBOT).runs
    np.testing.assert_allclose(run.t, 0.02 * np.arange(50), rtol=0.0, atol=3e-7)
    assert run.start == 1.76e9


def test_each_run_of_a_table_has_its_own_start(tmp_path: Path) -> None:
    parts = [pd.DataFrame({**table(), "t": COUNT + k * 10**12, "run": k}) for k in range(2)]
    pd.concat(parts).to_parquet(tmp_path / "both.parquet")
    runs = read_runs([tmp_path / "both.parquet"], ROBOT).runs
    assert [run.t[0] for run in runs] == [0.0, 0.0]
    assert runs[1].start - runs[0].start == pytest.approx(1000.0)


def test_rows_before_the_first_command_do_not_count(tmp_path: Path) -> None:
    columns = table()
    columns["command.left"][:5] = np.nan
    path = tmp_path / "run.parquet"
    pd.DataFrame({**columns, "t": COUNT}).to_parquet(path)
    (run,) = read_runs([path], ROBOT).runs
    assert run.t[0] == 0.0 and run.start == pytest.approx(1e-9 * (EPOCH + 5 * STEP))


@pytest.mark.parametrize(("size", "unit"), [(1e3, "ms"), (1e6, "us")])
def test_other_units_since_1970_are_named(tmp_path: Path, size: float, unit: str) -> None:
    with pytest.raises(BadInput, match=f"appears to be in {unit}"):
        read_runs([logged(tmp_path, size * (1.76e9 + 0.2 * np.arange(50)))], ROBOT)


def test_a_message_shows_the_stamp_as_it_was_logged(tmp_path: Path) -> None:
    stamps = 1.76e9 + 0.02 * np.arange(50)
    stamps[[10, 20, 30]] -= 0.5
    with pytest.raises(BadInput, match=r"has t = 1759999999\.7"):
        read_runs([logged(tmp_path, stamps)], ROBOT)


DATES = pd.Series(pd.to_datetime(COUNT))


@pytest.mark.parametrize(
    "t",
    [
        DATES.dt.strftime("%Y-%m-%d %H:%M:%S.%f"),
        DATES.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        DATES.dt.tz_localize("UTC").dt.tz_convert("Asia/Tokyo").map(lambda date: date.isoformat()),
        [None if i == 7 else date.isoformat() for i, date in enumerate(DATES)],
        [date.isoformat(sep=" ").removesuffix(".000000") for date in DATES.dt.round("10ms")],
    ],
)
def test_dates_are_read_as_seconds(tmp_path: Path, t: object) -> None:
    result = read_runs([logged(tmp_path, t)], ROBOT)
    (run,) = result.runs
    every = 0.02 * np.arange(50)
    np.testing.assert_allclose(run.t, every if len(run.t) == 50 else np.delete(every, 7), rtol=0.0, atol=2e-6)
    assert run.start == pytest.approx(1e-9 * EPOCH, abs=0.01)
    assert ("info", "stamps as dates") in [(f.severity, f.kind) for f in result.findings]


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_dates_of_a_parquet_table_keep_every_digit(tmp_path: Path, zone: str | None) -> None:
    stamps = DATES if zone is None else DATES.dt.tz_localize("UTC").dt.tz_convert(zone)
    (run,) = read_runs([logged(tmp_path, stamps, "run.parquet")], ROBOT).runs
    np.testing.assert_allclose(run.t, 1e-9 * STEP * np.arange(50), rtol=0.0, atol=1e-12)


def test_dates_of_a_computer_without_a_clock(tmp_path: Path) -> None:
    (run,) = read_runs([logged(tmp_path, pd.to_datetime(10**15 + STEP * np.arange(50)))], ROBOT).runs
    np.testing.assert_allclose(run.t, 1e-9 * STEP * np.arange(50), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("odd", "said"),
    [
        ("soon", "data row 4 of column 't' must be a date and time like the first, '2025-"),
        ("0.06", "got '0.06'"),
        ("2025-10-09T08:53:20.5Z", "with a UTC offset in every row or in none"),
    ],
)
def test_a_stamp_that_is_no_date_like_the_others_is_named(tmp_path: Path, odd: str, said: str) -> None:
    stamps = [odd if i == 3 else date.isoformat() for i, date in enumerate(DATES)]
    with pytest.raises(BadInput, match=r"run\.csv") as raised:
        read_runs([logged(tmp_path, stamps)], ROBOT)
    assert said in str(raised.value)
