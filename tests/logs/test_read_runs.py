"""Reading run tables: names, order, missing cells, and one clear message for each fault."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from run_tables import ROBOT, table, write_csv

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.logs.run import held
from residual_mpc.models.robot_file import RobotFile, Variant


def text(rows: int = 50) -> str:
    lines = [f"{0.02 * i:.2f},1,2,{0.1 * i:.3f}" for i in range(rows)]
    return "\n".join(["t,command.left,command.right,pose.x", *lines]) + "\n"


def test_csv_and_parquet_are_the_same_run(tmp_path: Path) -> None:
    columns = {name: np.round(values, 6) for name, values in table().items()}
    columns["pose.x"][[3, 7]] = np.nan
    (first,) = read_runs([write_csv(tmp_path / "a.csv", columns)], ROBOT).runs
    pd.DataFrame(columns).to_parquet(tmp_path / "b.parquet")
    (second,) = read_runs([tmp_path / "b.parquet"], ROBOT).runs
    assert (first.name, second.name) == ("a", "b")
    assert list(first.columns) == list(second.columns) == [name for name in columns if name != "t"]
    np.testing.assert_array_equal(first.t, second.t)
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values, second.columns[name])
        np.testing.assert_array_equal(values, columns[name])


@pytest.mark.parametrize(
    "dress",
    [
        lambda s: s.encode("utf-8-sig"),
        lambda s: s.replace("\n", "\r\n").encode(),
        lambda s: s.replace("\n", "\n\n").encode(),
        lambda s: s.replace(",", " , ").encode(),
        lambda s: ("# " + s).encode(),
        lambda s: ("# recorded by the cell, run 4\n\n" + s).encode(),
        lambda s: ("# left, right, x, y\n# t, l, r, x\n" + s).encode(),
        lambda s: ("# recorded at 20 \xb0C\n").encode("latin-1") + s.encode(),
        lambda s: ("# recorded by the cell\n# " + s).encode(),
        lambda s: s.replace(",", ";").encode(),
        lambda s: s.replace(",", "\t").encode(),
        lambda s: s.replace(",", ";").replace(".", ",").replace("d,", "d.").replace("e,", "e.").encode(),
        lambda s: gzip.compress(s.encode()),
    ],
)
def test_dress_does_not_matter(tmp_path: Path, dress: Callable[[str], bytes]) -> None:
    (tmp_path / "a.csv").write_text(text())
    (tmp_path / "b.csv").write_bytes(dress(text()))
    (plain,) = read_runs([tmp_path / "a.csv"], ROBOT).runs
    (other,) = read_runs([tmp_path / "b.csv"], ROBOT).runs
    np.testing.assert_array_equal(plain.t, other.t)
    np.testing.assert_array_equal(plain.columns["pose.x"], other.columns["pose.x"])


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (lambda s: "", "empty"),
        (lambda s: "\n" * 9, "blank lines"),
        (lambda s: s.splitlines()[0], "no rows"),
        (lambda s: "\n".join(s.splitlines()[:2]), "different time stamps, got one"),
        (lambda s: s.replace("t,", "time,", 1), "column 't' (time stamps in s) is missing"),
        (lambda s: s.replace("command", "cmd"), "no command column"),
        (lambda s: s.replace("pose.x", "x"), "no measured column"),
        (lambda s: s.replace("pose.x", "command.left"), "appears twice"),
        (lambda s: s.replace("0.04,1", "0.04,one"), "data row 3 of column 'command.left' must be a number, got 'one'"),
        (lambda s: s.replace("0.04,1", "0.04,inf"), "got inf"),
        (lambda s: s.replace("0.04,1", "0.04,3.4e38"), "got 3.4e+38"),
        (lambda s: s.replace("0.04,1", '0.04,"1,5"'), "got '1,5'. Write decimal points instead of decimal commas"),
        (lambda s: s.replace("0.04,1", "0.04,1,5"), "data row 3 must have 4 cells, got 5"),
        (lambda s: s.replace("0.04,1,", "0.04,"), "data row 3 must have 4 cells, got 3"),
        (lambda s: "# a note\n\n" + s.replace("0.04,1,", "0.04,"), "data row 3 must have 4 cells, got 3"),
        (
            lambda s: "# a note\n" + s.replace("0.04,1", "0.04,one"),
            "data row 3 of column 'command.left' must be a number",
        ),
        (lambda s: "# only a note\n", "no rows"),
        (lambda s: s.replace("0.04,1", '0.04,"1'), "unclosed quote"),
        (lambda s: s.replace(",1,", ",,"), "has no value"),
        (lambda s: s.replace("0.04,", "0.40,"), "data row 4 has t = 0.06 s"),
        (lambda s: s + "".join(s.splitlines(keepends=True)[1:]), "a column 'run'"),
        (lambda s: "\n".join([s.splitlines()[0], *(f"{20 * i},1,2,{i}" for i in range(9))]), "appears to be in ms"),
        (lambda s: "\n".join([s.splitlines()[0], *(f"{10**16 * i},1,2,{i}" for i in range(9))]), "appears to be in ns"),
        (lambda s: "\n".join([s.splitlines()[0], *(f"{i // 9},1,2,{i}" for i in range(50))]), "more digits"),
        (lambda s: s.encode("utf-16"), "UTF-16"),
        (lambda s: bytes(range(256)), "binary"),
        (lambda s: s.replace("pose.x", "pose.x,\xb0").encode("latin-1"), "in UTF-8 or a Parquet table"),
        (lambda s: s.replace("0.04,1", "0.04,\xb0").encode("latin-1"), "data row 3"),
        (lambda s: b"PAR1" + s.encode(), "damaged"),
        (lambda s: gzip.compress(s.encode())[:60], "damaged"),
    ],
)
def test_a_fault_is_named(tmp_path: Path, fault: Callable[[str], str | bytes], said: str) -> None:
    broken = fault(text())
    path = tmp_path / "log.csv"
    path.write_bytes(broken.encode() if isinstance(broken, str) else broken)
    with pytest.raises(BadInput) as raised:
        read_runs([path], ROBOT)
    assert said in str(raised.value) and "log.csv" in str(raised.value)


def test_paths_are_files_folders_and_patterns(tmp_path: Path) -> None:
    for name in ("b.csv", "a.csv"):
        (tmp_path / name).write_text(text())
    names = [run.name for run in read_runs([tmp_path], ROBOT).runs]
    assert names == ["a", "b"]
    assert [r.name for r in read_runs([str(tmp_path / "*.csv"), tmp_path / "a.csv"], ROBOT).runs] == names
    (tmp_path / "empty").mkdir()
    for missing in (tmp_path / "c.csv", tmp_path / "empty", str(tmp_path / "*.parquet"), "x" * 5000, "\0"):
        with pytest.raises(BadInput):
            read_runs([missing], ROBOT)
    with pytest.raises(BadInput):
        read_runs([], ROBOT)


def test_a_text_table_is_read_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text().replace(",", "\t"))
    for given in (path, str(tmp_path / "*.txt")):
        assert [run.name for run in read_runs([given], ROBOT).runs] == ["a"]
    with pytest.raises(BadInput, match=r"a\.txt may be a table. Give text tables by name"):
        read_runs([tmp_path], ROBOT)


def test_the_column_run_tells_runs_apart(tmp_path: Path) -> None:
    columns = table()
    both = pd.concat([pd.DataFrame({"run": 1.0, **columns}), pd.DataFrame({"run": 2.0, **columns})])
    both.sort_values("t").to_csv(tmp_path / "x.csv", index=False)  # interleaved
    both.to_csv(tmp_path / "y.csv", index=False)
    assert [run.name for run in read_runs([tmp_path / "x.csv"], ROBOT).runs] == ["1", "2"]
    runs = read_runs([tmp_path], ROBOT).runs
    assert [run.name for run in runs] == ["x/1", "x/2", "y/1", "y/2"]
    for run in runs:
        np.testing.assert_allclose(run.t, columns["t"])


def test_log_names_columns(tmp_path: Path) -> None:
    columns = {
        "stamp": table()["t"],
        "velocity.left": np.ones(50),
        "velocity.right": np.ones(50),
        "elbow": np.arange(50.0),
        "position.b": np.zeros(50),
        "note": np.ones(50),
    }
    log = {"t": "stamp", "command.left": "velocity.left", "position.a": "position.b", "position.b": "elbow"}
    path = write_csv(tmp_path / "a.csv", columns)
    (run,) = read_runs([path], RobotFile("r", "p", log=log)).runs
    assert run.served_as_command == {"velocity.left"}
    assert set(run.measured) == {"velocity.right", "position.a", "position.b"}
    np.testing.assert_array_equal(run.columns["position.b"], columns["elbow"])
    assert run.extra == ("note",) and list(run.extra_columns) == ["note"]
    with pytest.raises(BadInput, match="Did you mean 'elbow'"):
        read_runs([path], RobotFile("r", "p", log={**log, "position.b": "elbov"}))


def test_a_variant_names_the_columns_of_its_runs(tmp_path: Path) -> None:
    first = table()
    second = {"cmd" if name == "command.left" else name: values for name, values in first.items()}
    paths = [write_csv(tmp_path / "old.csv", first), write_csv(tmp_path / "new.csv", second)]
    robot = RobotFile("r", "p", variants=(Variant("new*", {"log": {"command.left": "cmd"}}),))
    old, new = read_runs(paths, robot).runs
    np.testing.assert_array_equal(old.columns["command.left"], new.columns["command.left"])


def test_small_faults_are_mended_and_said(tmp_path: Path) -> None:
    columns = table(500)
    columns["t"][7] = np.nan
    columns["t"][[100, 101]] = columns["t"][[101, 100]]
    columns["command.left"][:5] = np.nan
    result = read_runs([write_csv(tmp_path / "a.csv", columns)], ROBOT)
    (run,) = result.runs
    assert len(run.t) == 494 and np.all(np.diff(run.t) > 0.0) and np.isfinite(run.columns["command.left"][0])
    assert {f.kind for f in result.findings} == {"missing stamps", "stamps out of order", "no command yet"}


def test_rows_of_one_stamp_share_out_their_columns(tmp_path: Path) -> None:
    columns = {name: np.repeat(values, 2) for name, values in table().items()}
    columns["pose.x"][::2] = np.nan  # as an export of separate topics writes it
    columns["command.left"][1::2] = np.nan
    result = read_runs([write_csv(tmp_path / "a.csv", columns)], ROBOT)
    (run,) = result.runs
    np.testing.assert_allclose(run.columns["pose.x"], table()["pose.x"], atol=1e-6)
    np.testing.assert_allclose(run.columns["command.left"], table()["command.left"], atol=1e-6)
    assert [(f.kind, f.severity) for f in result.findings] == [("repeated stamps", "info")]
    assert result.findings[0].message == (
        f"{len(run.t)} rows with the previous time stamp were merged with the row before: they fill each other's empty "
        "cells"
    )


def test_rows_of_one_stamp_that_contradict_each_other_are_a_warning(tmp_path: Path) -> None:
    columns = table()
    columns["t"][21] = columns["t"][20]
    result = read_runs([write_csv(tmp_path / "a.csv", columns)], ROBOT)
    (finding,) = result.findings
    assert (finding.kind, finding.severity) == ("repeated stamps", "warning")
    assert finding.message == (
        "1 row with the previous time stamp was merged with the row before; 1 of them held other values, which are "
        "left out"
    )
    assert result.runs[0].columns["pose.x"][20] == pytest.approx(columns["pose.x"][20], abs=1e-6)


def test_a_value_is_held_until_the_next(tmp_path: Path) -> None:
    columns = table(6)
    columns["command.left"] = np.array([1.0, np.nan, np.nan, 2.0, np.nan, 3.0])
    (run,) = read_runs([write_csv(tmp_path / "a.csv", columns)], ROBOT).runs
    np.testing.assert_array_equal(held(run, "command.left"), [1.0, 1.0, 1.0, 2.0, 2.0, 3.0])
    assert np.isnan(run.columns["command.left"][1])


def test_memory_is_bounded(tmp_path: Path) -> None:
    columns = {**table(200), "junk": np.ones(200), "more": np.ones(200)}
    path = tmp_path / "a.parquet"
    pd.DataFrame(columns).to_parquet(path)
    result = read_runs([path], ROBOT, memory_limit=200 * 8 * 6)
    assert list(result.runs[0].columns) == [name for name in table() if name != "t"]
    assert {f.kind for f in result.findings} == {"unknown column"}
    with pytest.raises(BadInput, match="GiB"):
        read_runs([path], ROBOT, memory_limit=200 * 8 * 3)


def test_texts_in_unknown_columns_are_kept_by_name(tmp_path: Path) -> None:
    pd.DataFrame({**table(), "note": "fine", "comand.left": 1.0}).to_csv(tmp_path / "a.csv", index=False)
    result = read_runs([tmp_path / "a.csv"], ROBOT)
    assert result.runs[0].extra == ("note", "comand.left")
    assert list(result.runs[0].extra_columns) == ["comand.left"]
    assert any("command.left" in finding.remedy for finding in result.findings)


def test_a_command_sent_before_the_first_row_that_is_kept_is_still_held(tmp_path: Path) -> None:
    columns = table()
    rows = np.arange(len(columns["t"]))
    columns["command.left"] = np.where(rows % 2 == 0, 1.0 + rows, np.nan)
    columns["command.right"] = np.where(rows % 2 == 1, 2.0, np.nan)
    (run,) = read_runs([write_csv(tmp_path / "run.csv", columns)], ROBOT).runs
    assert len(run.t) == len(rows) - 1
    np.testing.assert_array_equal(run.columns["command.left"][:3], [1.0, 3.0, np.nan])


def test_row_numbers_of_pandas_are_no_column(tmp_path: Path) -> None:
    columns = {name: np.round(values, 6) for name, values in table().items()}
    frame = pd.DataFrame(columns).iloc[3:]
    frame.index = frame.index.to_numpy() * 2  # no longer a range, so that pandas writes it
    frame.to_parquet(tmp_path / "a.parquet")
    (run,) = read_runs([tmp_path / "a.parquet"], ROBOT).runs
    assert not [name for name in run.extra if "index" in name]
