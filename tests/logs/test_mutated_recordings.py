"""Hundreds of damaged bags and archives: read or refused, never another exception."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from ros_bags import START, T, joint_state, odometry, transform, twist, write_bag, write_mcap
from test_mutated_logs import sound

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.models.robot_file import RobotFile

ROBOT = RobotFile("rover", "diff_drive", parameters={"wheel_radius": 0.1, "track_width": 0.5})
ODD: tuple[float, ...] = (0.0, 1e300, -1e9, float("nan"), float("inf"))
MUTANTS = 60  # of each format


def messages(rng: np.random.Generator, rows: int = 40, odd: float = 0.0) -> list[Any]:
    """A drive; with probability `odd` a number or a stamp of a message is another."""

    def number(x: float) -> float:
        return float(rng.choice(ODD)) if rng.random() < odd else x

    out = []
    for k in range(rows):
        t = START + 50_000_000 * k
        stamp = int(rng.choice([0, 1, t - 10**9, 2**31 * 10**9 - 1])) if rng.random() < odd else t
        names = ["left", "right"][: int(rng.integers(0, 3)) if rng.random() < odd else 2]
        out += [
            ("/cmd_vel", t, twist(number(0.1 * k), number(0.1))),
            ("/odom", t, odometry(stamp, number(0.01 * k), number(0.0), number(0.1))),
            ("/joint_states", t, joint_state(stamp, names, [], [number(1.0)] * int(rng.integers(0, 3)))),
            ("/tf", t, transform(stamp, "odom", "base_link", number(0.0), 0.0, 0.0)),
        ]
    return out


def arrays(rng: np.random.Generator) -> dict[str, Any]:
    t = 0.05 * np.arange(40)
    columns: dict[str, Any] = {
        "t": t, "command.left": np.sin(t), "command.right": np.cos(t), "pose.x": t, "pose.theta": 0.1 * t,
    }  # fmt: skip
    odd: tuple[Callable[[], Any], ...] = (
        lambda: np.zeros((40, 3, 2)), lambda: np.array(3.0), lambda: np.array("text"), lambda: np.full(40, np.nan),
        lambda: np.zeros(0), lambda: np.array(["x"] * 40), lambda: np.arange(39), lambda: np.zeros((3, 40)),
        lambda: np.full(40, 1j), lambda: np.full((40, 1), 1e300), lambda: np.arange(40).astype(">i2"),
        lambda: np.zeros(40, dtype=[("a", "f8"), ("b", "f4", (3,))]), lambda: np.zeros((1, 0)),
    )  # fmt: skip
    for _ in range(int(rng.integers(0, 4))):
        name = str(rng.choice([*columns, "note", "a/b/c", "run", "pose.y"]))
        columns[name] = odd[int(rng.integers(len(odd)))]()
    return columns


def overwrite(rng: np.random.Generator, path: Path) -> None:
    """A few bytes, or a block of them, or the end of the file."""
    raw = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 20))):
        raw[int(rng.integers(len(raw)))] = int(rng.integers(256))
    if rng.random() < 0.3:
        at = int(rng.integers(len(raw)))
        raw[at : at + 64] = rng.bytes(64)
    path.write_bytes(bytes(raw[: int(rng.integers(len(raw)))] if rng.random() < 0.3 else raw))


def write_hdf5(path: Path, columns: dict[str, Any]) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            if np.asarray(values).dtype.kind != "U":
                file[name] = values


def write_mat(path: Path, columns: dict[str, Any]) -> None:
    scipy.io.savemat(path, {n.replace(".", "_").replace("/", "_"): v for n, v in columns.items()})


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_damaged_bags(tmp_path: Path, storage: str) -> None:
    rng = np.random.default_rng(1)
    whole = write_bag(tmp_path / "whole", messages(rng), storage)
    for k in range(MUTANTS):
        bag = shutil.copytree(whole, tmp_path / f"bag{k}")
        overwrite(rng, sorted(bag.iterdir())[k % 2])  # the storage or its metadata
        sound([bag], ROBOT)


@pytest.mark.parametrize("options", [{}, {"chunk_size": 600}])
def test_damaged_mcap_files(tmp_path: Path, options: dict[str, Any]) -> None:
    rng = np.random.default_rng(2)
    whole = write_mcap(tmp_path / "whole.mcap", messages(rng), **options)
    for k in range(MUTANTS):
        path = Path(shutil.copy(whole, tmp_path / f"{k}.mcap"))
        overwrite(rng, path)
        sound([path], ROBOT)


def test_odd_messages(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for k in range(MUTANTS):
        sound([write_mcap(tmp_path / f"{k}.mcap", messages(rng, odd=float(rng.choice([0.01, 0.1, 0.5]))))], ROBOT)


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.npz", lambda path, columns: np.savez(path, **columns)), ("a.h5", write_hdf5), ("a.mat", write_mat)],
)
def test_damaged_archives(tmp_path: Path, name: str, write: Callable[[Path, dict[str, Any]], None]) -> None:
    rng = np.random.default_rng(4)
    for k in range(MUTANTS):
        (tmp_path / str(k)).mkdir()
        path = tmp_path / str(k) / name
        write(path, arrays(rng))
        if k % 2:
            overwrite(rng, path)
        log = {n: n.replace(".", "_") for n in ("command.left", "command.right", "pose.x", "pose.theta")}
        sound([path], RobotFile("rover", "diff_drive", log=log) if name == "a.mat" else ROBOT)


def test_what_was_recorded_before_a_break_is_read(tmp_path: Path) -> None:
    whole = write_mcap(tmp_path / "whole.mcap", messages(np.random.default_rng(5)), chunk_size=2000)
    raw = whole.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(raw[: len(raw) // 2])
    result = read_runs([tmp_path / "cut.mcap"], ROBOT)
    (run,) = result.runs
    (full,) = read_runs([whole], ROBOT).runs
    assert 5 < len(run.t) < len(full.t)
    np.testing.assert_array_equal(run.columns["pose.x"], full.columns["pose.x"][: len(run.t)])
    assert [f.severity for f in result.findings if f.kind == "broken off"] == ["warning"]


def test_a_pickle_in_an_archive_is_never_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.array([{"a": 1}] * 9, dtype=object))
    with pytest.raises(BadInput):
        read_runs([tmp_path / "a.npz"], ROBOT)


def test_messages_of_an_unknown_type_are_left(tmp_path: Path) -> None:
    some = messages(np.random.default_rng(6))
    some += [("/chatter", t, T["std_msgs/msg/String"](data="x")) for _, t, _ in some[:5]]
    assert len(read_runs([write_mcap(tmp_path / "a.mcap", some)], ROBOT).runs) == 1
