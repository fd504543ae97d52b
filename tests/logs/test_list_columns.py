"""List columns, as LeRobot writes them, become columns of numbers that [log] and `init` can name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.recording import read_recordings
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.models.robot_file import RobotFile

JOINTS = ("shoulder_pan.pos", "elbow_flex.pos")
T = np.arange(50) / 30.0  # (50,) s
ACTION = np.stack([np.sin(T), np.cos(T)], axis=1)  # (50, 2) rad
STATE = ACTION + 0.1


def log(*names: str) -> dict[str, str]:
    """The [log] of a robot with two joints, whose lists' elements bear these names."""
    out = {"t": "timestamp"}
    for joint, name in zip("ab", names, strict=True):
        out |= {f"command.{joint}": f"action.{name}", f"position.{joint}": f"observation.state.{name}"}
    return out


def data_set(folder: Path, names: Any, fixed: bool = True, episodes: int = 1, **columns: Any) -> Path:
    """A LeRobot data set's one table."""
    there = folder / "data" / "chunk-000"
    there.mkdir(parents=True)
    kind = pa.list_(pa.float32(), 2) if fixed else pa.list_(pa.float32())
    lists = {"action": ACTION, "observation.state": STATE, **columns}
    table = {name: pa.array([*values] * episodes, type=kind) for name, values in lists.items()}
    table |= {
        "timestamp": pa.array(np.tile(T, episodes).astype(np.float32)),
        "episode_index": pa.array(np.repeat(np.arange(episodes), len(T))),
        "frame_index": pa.array(np.tile(np.arange(len(T)), episodes)),
    }
    pq.write_table(pa.table(table), there / "file-000.parquet")
    if names is not None:
        (folder / "meta").mkdir()
        features = {name: {"dtype": "float32", "shape": [2], "names": names} for name in lists}
        (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "features": features}))
    return there / "file-000.parquet"


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize(
    ("names", "heard"),
    [
        (list(JOINTS), JOINTS),
        ({"motors": list(JOINTS)}, JOINTS),
        ({JOINTS[1]: 1, JOINTS[0]: 0}, JOINTS),
        (None, ("0", "1")),
        (["one"], ("0", "1")),
        ([1, 2], ("0", "1")),
        (["same", "same"], ("0", "1")),
    ],
)
def test_every_element_is_a_column(tmp_path: Path, names: Any, heard: tuple[str, ...], fixed: bool) -> None:
    path = data_set(tmp_path, names, fixed)
    result = read_runs([path], RobotFile("arm", "p", log=log(*heard)))
    (run,) = result.runs
    np.testing.assert_allclose(run.t, T, atol=1e-6)
    for k, joint in enumerate("ab"):
        np.testing.assert_allclose(run.columns[f"command.{joint}"], ACTION[:, k], atol=1e-6)
        np.testing.assert_allclose(run.columns[f"position.{joint}"], STATE[:, k], atol=1e-6)
    (note,) = [f for f in result.findings if f.kind == "list columns"]
    assert note.severity == "info" and f"action.{heard[0]}" in note.message


def test_broken_names_are_no_names(tmp_path: Path) -> None:
    path = data_set(tmp_path, list(JOINTS))
    (tmp_path / "meta" / "info.json").write_text("{ not json")
    assert len(read_runs([path], RobotFile("arm", "p", log=log("0", "1"))).runs) == 1


def test_episodes_outside_a_data_set_are_runs_where_the_robot_file_says_so(tmp_path: Path) -> None:
    path = data_set(tmp_path, None, episodes=3)
    whole = RobotFile("arm", "p", log=log("0", "1"))
    with pytest.raises(BadInput, match='"run" = "episode_index"'):
        read_runs([path], whole)
    apart = RobotFile("arm", "p", log={**log("0", "1"), "run": "episode_index"})
    assert [run.name for run in read_runs([path], apart).runs] == ["0", "1", "2"]


def test_the_likely_time_is_named_where_t_is_missing(tmp_path: Path) -> None:
    path = data_set(tmp_path, None)
    named = {name: column for name, column in log("0", "1").items() if name != "t"}
    with pytest.raises(BadInput, match='"t" = "timestamp"'):
        read_runs([path], RobotFile("arm", "p", log=named))


def test_ragged_lists_have_one_message(tmp_path: Path) -> None:
    ragged = [row[: 1 + (k != 7)] for k, row in enumerate(ACTION)]
    path = data_set(tmp_path, list(JOINTS), fixed=False, action=ragged)
    with pytest.raises(BadInput, match="data row 8 of list column 'action' must have 2 elements .*, got 1"):
        read_runs([path], RobotFile("arm", "p", log=log(*JOINTS)))


def test_a_ragged_list_that_nothing_uses_is_no_fault(tmp_path: Path) -> None:
    ragged = [row[: 1 + (k != 7)] for k, row in enumerate(ACTION)]
    path = data_set(tmp_path, list(JOINTS), fixed=False, touched=ragged)
    (run,) = read_runs([path], RobotFile("arm", "p", log=log(*JOINTS))).runs
    assert set(run.columns) == {"command.a", "command.b", "position.a", "position.b"}


def test_missing_lists_are_missing_samples(tmp_path: Path) -> None:
    gappy = [None if k == 7 else row for k, row in enumerate(STATE)]
    path = data_set(tmp_path, list(JOINTS), fixed=False, **{"observation.state": gappy})
    (run,) = read_runs([path], RobotFile("arm", "p", log=log(*JOINTS))).runs
    assert np.flatnonzero(np.isnan(run.columns["position.a"])).tolist() == [7]


def test_other_lists_stay_what_they_are(tmp_path: Path) -> None:
    table = pa.table({"t": T, "image": [[[1, 2], [3, 4]]] * 50, "words": [["a"]] * 50, "scan": [[0.0] * 500] * 50})
    pq.write_table(table, tmp_path / "a.parquet")
    (recording,) = read_recordings([tmp_path / "a.parquet"])
    assert list(recording.columns) == ["t"] and set(recording.texts) == {"image", "words", "scan"}


def test_an_element_never_takes_the_name_of_another_column(tmp_path: Path) -> None:
    pd.DataFrame({"t": T, "action": list(ACTION), "action.0": T}).to_parquet(tmp_path / "a.parquet")
    with pytest.raises(BadInput, match="'action.0' appears twice"):
        read_recordings([tmp_path / "a.parquet"])


def test_init_refuses_what_does_not_fit_into_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text("t,command.a,position.a\n" + "".join(f"{k},0.0,0.0\n" for k in range(9)))
    monkeypatch.setattr("residual_mpc.init.columns.recording.MEMORY_LIMIT", 50)
    with pytest.raises(BadInput, match="more than the limit"):
        read_recordings([tmp_path / "a.csv"])
