"""A run written by other libraries in each format is the run that the CSV file holds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
import scipy.sparse
from ros_bags import START, Message, joint_state, odometry, twist_stamped, write_bag, write_mcap

from residual_mpc.logs.readers.read import read_runs
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.models.robot_file import RobotFile

WHEELS = {"wheel_radius": 0.033, "track_width": 0.16}
ROVER = RobotFile("rover", "diff_drive", parameters=WHEELS)
Table = Mapping[str, FloatArray]


def table(rows: int = 200) -> dict[str, FloatArray]:
    """Commands at every fourth stamp, encoders at every stamp, a pose at every second; NaN where there is none."""
    t = np.arange(rows) * 10_000_000 + START
    s = (t - START) / 1e9
    columns = {
        "command.linear": np.sin(3.0 * s),
        "command.angular": np.cos(2.0 * s) / 3.0,
        "velocity.left": np.sin(s) / 7.0,
        "velocity.right": np.cos(s) / 7.0,
        "pose.x": s / 3.0,
        "pose.y": s / 9.0,
        "pose.theta": 0.3 * np.sin(s),
    }
    every = {"command": 4, "velocity": 1, "pose": 2}
    k = np.arange(rows)
    return {"t": t, **{n: np.where(k % every[n.split(".")[0]] == 0, v, np.nan) for n, v in columns.items()}}


def messages(columns: Table) -> list[Message]:
    out: list[Message] = []
    for k, stamp in enumerate(int(t) for t in columns["t"]):
        c = {name: float(values[k]) for name, values in columns.items()}
        out.append(("/joint_states", stamp + 2000, joint_state(
            stamp, ["left", "right"], (), [c["velocity.left"], c["velocity.right"]])))  # fmt: skip
        if np.isfinite(c["pose.x"]):
            out.append(("/odom", stamp + 3000, odometry(stamp, c["pose.x"], c["pose.y"], c["pose.theta"])))
        if np.isfinite(c["command.linear"]):
            command = twist_stamped(stamp, c["command.linear"], c["command.angular"])
            out.append(("/cmd_vel", stamp + 1000, command))
    return out


def write_csv(folder: Path, columns: Table) -> Path:
    pd.DataFrame(columns).to_csv(folder / "run.csv", index=False)
    return folder / "run.csv"


def write_npz(folder: Path, columns: Table) -> Path:
    np.savez_compressed(folder / "run.npz", **columns)  # type: ignore[arg-type]
    return folder / "run.npz"


def write_hdf5(folder: Path, columns: Table) -> Path:
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in columns.items():
            file.create_dataset(name.replace(".", "/"), data=values, chunks=True, compression="gzip")
    return folder / "run.h5"


def write_matrices(folder: Path, columns: Table) -> Path:
    """Each group one matrix whose attribute names its columns, each quantity along the second side."""
    with h5py.File(folder / "run.hdf5", "w") as file:
        file["t"] = columns["t"]
        for group in ("command", "velocity", "pose"):
            members = [n for n in columns if n.startswith(group)]
            file[group] = np.stack([columns[n] for n in members])
            file[group].attrs["names"] = [n.split(".")[1] for n in members]
    return folder / "run.hdf5"


def write_mat(folder: Path, columns: Table) -> Path:
    groups: dict[str, Any] = {"t": columns["t"]}
    for name, values in columns.items():
        head, dot, tail = name.partition(".")
        if dot:
            groups.setdefault(head, {})[tail] = values
    scipy.io.savemat(folder / "run.mat", groups, do_compression=True)
    return folder / "run.mat"


FORMATS: Mapping[str, Callable[[Path, Table], Path]] = {
    "rosbag2 in SQLite": lambda folder, c: write_bag(folder / "run", messages(c), "sqlite3"),
    "rosbag2 in MCAP": lambda folder, c: write_bag(folder / "run", messages(c), "mcap"),
    "MCAP": lambda folder, c: write_mcap(folder / "run.mcap", messages(c)),
    "MCAP in many chunks": lambda folder, c: write_mcap(folder / "run.mcap", messages(c), chunk_size=4096),
    "NumPy": write_npz,
    "HDF5": write_hdf5,
    "HDF5 matrices": write_matrices,
    "MATLAB": write_mat,
}


def one_run(path: Path) -> Run:
    (run,) = read_runs([path], ROVER).runs
    return run


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_run_of_the_csv(tmp_path: Path, name: str) -> None:
    columns = table()
    wanted, run = one_run(write_csv(tmp_path, columns)), one_run(FORMATS[name](tmp_path, columns))
    assert run.name == wanted.name == "run" and set(run.columns) >= set(wanted.columns)
    np.testing.assert_array_equal(run.t, wanted.t)
    assert run.start == wanted.start and run.period == wanted.period == pytest.approx(0.01)
    for column, values in wanted.columns.items():
        if column == "pose.theta":  # there and back through a quaternion
            np.testing.assert_allclose(run.columns[column], values, rtol=0, atol=1e-15)
        else:
            np.testing.assert_array_equal(run.columns[column], values, err_msg=column)


def test_a_body_velocity_is_wheel_speeds(tmp_path: Path) -> None:
    columns = table()
    result = read_runs([write_csv(tmp_path, columns)], ROVER)
    (run,), (said,) = result.runs, [f for f in result.findings if f.kind == "body velocity"]
    v, w = columns["command.linear"], columns["command.angular"]
    assert "a wheel radius of 0.033 m and a track width of 0.16 m" in said.message
    np.testing.assert_allclose(run.columns["command.left"], (v - 0.08 * w) / 0.033, rtol=1e-14)
    np.testing.assert_allclose(run.columns["command.right"], (v + 0.08 * w) / 0.033, rtol=1e-14)
    assert "command.linear" not in run.columns


def test_stamps_keep_every_nanosecond(tmp_path: Path) -> None:
    columns = table(50)
    columns["t"] = columns["t"] + np.arange(50) % 7  # a float of this size resolves 256 ns
    run = one_run(write_bag(tmp_path / "run", messages(columns)))
    np.testing.assert_array_equal(np.rint(run.t * 1e9).astype(int), columns["t"] - columns["t"][0])


def test_groups_of_a_file_are_runs(tmp_path: Path) -> None:
    tables = {"first": table(), "second": table(100)}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for label, columns in tables.items():
            for name, values in columns.items():
                file[f"runs/{label}/{name}"] = values
            file[f"runs/{label}/gain"] = 3.0
            file[f"runs/{label}/camera"] = np.zeros((len(columns["t"]), 4, 4))
    np.savez(tmp_path / "b.npz", **{f"{k}/{n}": v for k, c in tables.items() for n, v in c.items()})  # type: ignore[arg-type]
    for path in (tmp_path / "a.h5", tmp_path / "b.npz"):
        runs = read_runs([path], ROVER).runs
        assert [run.name.split("/")[-1] for run in runs] == ["first", "second"]
        assert [len(run.t) for run in runs] == [200, 100]


def test_an_array_of_structures_is_an_array_of_runs(tmp_path: Path) -> None:
    shape = [(n.replace(".", "_"), "O") for n in table()]
    runs = np.empty(2, dtype=shape)
    for i, rows in enumerate((200, 100)):
        for name, values in table(rows).items():
            runs[i][name.replace(".", "_")] = values
    scipy.io.savemat(tmp_path / "a.mat", {"log": runs})
    log = {n: n.replace(".", "_") for n in table() if n != "t"}
    robot = RobotFile("rover", "diff_drive", parameters=WHEELS, log=log)
    result = read_runs([tmp_path / "a.mat"], robot).runs
    assert [(run.name, len(run.t)) for run in result] == [("log/1", 200), ("log/2", 100)]


# ---- LeRobot, as its versions 2.1 and 3.0 lay their data sets out


def lerobot_set(folder: Path, version: str, episodes: int = 3) -> Path:
    names = ["shoulder.pos", "elbow.pos"]
    features = {name: {"dtype": "float32", "shape": [2], "names": names} for name in ("action", "observation.state")}
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(
        json.dumps({"codebase_version": version, "fps": 30, "features": features})
    )
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    tables = [episode(k) for k in range(episodes)]
    if version == "v2.1":
        for k, each in enumerate(tables):
            pq.write_table(each, data / f"episode_{k:06d}.parquet")
    else:
        pq.write_table(pa.concat_tables(tables), data / "file-000.parquet")
    return folder


def actions(k: int) -> FloatArray:
    s = np.arange(60) / 30.0
    return np.stack([np.sin(2.0 * s + k), np.cos(3.0 * s)], axis=1).astype(np.float32)


def episode(k: int) -> pa.Table:
    lists = pa.list_(pa.float32(), 2)
    return pa.table(
        {
            "action": pa.array(list(actions(k)), type=lists),
            "observation.state": pa.array(list(actions(k) + np.float32(0.1)), type=lists),
            "timestamp": pa.array((np.arange(60) / 30.0).astype(np.float32)),
            "frame_index": pa.array(np.arange(60)),
            "episode_index": pa.array(np.full(60, k)),
            "observation.image": pa.array([{"bytes": b"x" * 100, "path": ""}] * 60),
        }
    )


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_data_set_of_lerobot_is_its_episodes(tmp_path: Path, version: str) -> None:
    result = read_runs([lerobot_set(tmp_path / "set", version)], RobotFile("arm", "mujoco"))
    assert [run.name for run in result.runs] == ["0", "1", "2"]
    for k, run in enumerate(result.runs):
        for i, joint in enumerate(("shoulder", "elbow")):
            np.testing.assert_array_equal(run.columns[f"command.{joint}"], actions(k)[:, i])
            np.testing.assert_array_equal(run.columns[f"position.{joint}"], actions(k)[:, i] + np.float32(0.1))
        np.testing.assert_array_equal(run.t, (np.arange(60) / 30.0).astype(np.float32))


def test_the_robot_file_has_the_last_word_on_a_data_set(tmp_path: Path) -> None:
    log = {"position.elbow": "action.elbow.pos", "position.wrist": "observation.state.elbow.pos"}
    (run, *_) = read_runs([lerobot_set(tmp_path / "set", "v3.0")], RobotFile("arm", "mujoco", log=log)).runs
    np.testing.assert_array_equal(run.columns["position.elbow"], actions(0)[:, 1])
    np.testing.assert_array_equal(run.columns["position.wrist"], actions(0)[:, 1] + np.float32(0.1))


# ---- folders


def test_folders_are_searched(tmp_path: Path) -> None:
    some = messages(table(40))
    (tmp_path / "day").mkdir()
    write_bag(tmp_path / "day" / "one", some)
    (tmp_path / "day" / "deeper").mkdir()
    write_bag(tmp_path / "day" / "deeper" / "two", some, "mcap")
    write_mcap(tmp_path / "day" / "three.mcap", some)
    names = {run.name for run in read_runs([tmp_path / "day"], ROVER).runs}
    assert names == {"one", "two", "three"}
    assert {run.name for run in read_runs([str(tmp_path / "day" / "*")], ROVER).runs} == {"one", "three"}
    write_csv(tmp_path / "day", table(40))
    assert {run.name for run in read_runs([tmp_path / "day"], ROVER).runs} == {"run"}  # the tables made of them


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_an_interrupted_bag_below_a_folder_is_read(tmp_path: Path, storage: str) -> None:
    """It has no metadata.yaml, which is written at the end of a recording."""
    some = messages(table(40))
    for name in ("one", "two"):
        write_bag(tmp_path / "day" / name, some, storage)
    (tmp_path / "day" / "two" / "metadata.yaml").unlink()
    runs = read_runs([tmp_path / "day"], ROVER).runs
    assert len(runs) == 2
    np.testing.assert_array_equal(runs[0].columns["pose.x"], runs[1].columns["pose.x"])


def test_a_matrix_is_loaded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []

    def load(path: Path, name: str) -> Any:
        loaded.append(name)
        with h5py.File(path, "r") as file:
            return file[name][()]

    monkeypatch.setattr("residual_mpc.logs.readers.arrays.files._load_hdf5", load)
    one_run(write_matrices(tmp_path, table()))
    assert sorted(loaded) == ["command", "pose", "t", "velocity"]


def test_two_arrays_of_one_name_are_reported(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path, table())
    with h5py.File(path, "a") as file:
        file["pose.x"] = np.zeros(200)
    result = read_runs([path], ROVER)
    assert any("repeats a column's" in f.message and f.message.endswith("pose.x") for f in result.findings)


def test_variables_of_matlab_that_are_not_read_do_not_matter(tmp_path: Path) -> None:
    columns = {name.replace(".", "_"): values for name, values in table().items()}
    scipy.io.savemat(tmp_path / "a.mat", {**columns, "sparse": scipy.sparse.eye_array(3), "who": "me", "dt": 0.01})
    log = {name: name.replace(".", "_") for name in table() if name != "t"}
    (run,) = read_runs([tmp_path / "a.mat"], RobotFile("rover", "diff_drive", parameters=WHEELS, log=log)).runs
    np.testing.assert_array_equal(run.columns["pose.x"], table()["pose.x"])
