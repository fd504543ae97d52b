"""Recordings are read back by their formats' own libraries and held against the gap's definition and MuJoCo."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from models import learned
from oracles.arms import arm_xml
from oracles.gap_literal import gap_literal
from oracles.rover_log import ROBOT, SIGMA, rover_run, write_run

import residual_mpc as rm
from residual_mpc.cli.main import main
from residual_mpc.export.recording.write import file_names
from residual_mpc.learning.network.residual import KEY, to_json
from residual_mpc.logs.run import Run

pytest.importorskip("mcap")
EPOCH = 1.7e9  # s
POSE = ("pose.x", "pose.y", "pose.theta")
STATES = (("pose.x", None), ("pose.y", None), ("pose.theta", None))


def model_of(robot: str, robot_file: str, effect: str, parameter: str, value: float) -> dict[str, Any]:
    values = [{"effect": effect, "target": None, "parameter": parameter, "value": value}]
    return {"schema": "residual-mpc/model/1", "robot": robot, "robot_file": robot_file, "values": values}


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml, runs/ of a rover whose track is wider than the model's, stamped by the time of day, and out/ with a
    diagnosis that says so."""
    folder = tmp_path_factory.mktemp("recorded")
    noise = "".join(f'"{c}" = {s}\n' for c, s in SIGMA.items())
    (folder / "rover.toml").write_text(f"{ROBOT}[noise]\n{noise}")
    (folder / "runs").mkdir()
    (folder / "out").mkdir()
    for k in range(2):
        run = rover_run(f"r{k}", {"track_width": {"scale": 1.3}}, 6.0, seed=k)
        run.columns["pose.x"][[30, 31, 77]] = np.nan  # type: ignore[index]
        write_run(Run(run.name, run.t + EPOCH, run.columns), folder / "runs")
    model = model_of("rover", "../rover.toml", "track_width", "scale", 1.3)
    (folder / "out" / "model.json").write_text(json.dumps(model))
    diagnosis = {"schema": "residual-mpc/diagnosis/1", "model": model, "gap": {"horizon": 0.5}}
    (folder / "out" / "diagnosis.json").write_text(json.dumps({**diagnosis, "run_files": ["../runs"]}))
    return folder


def said(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    with pytest.raises(SystemExit) as end:
        main([*map(str, words), "--json"])
    printed = capsys.readouterr()
    assert end.value.code == 0, printed.err
    document: dict[str, Any] = json.loads(printed.out)
    return document


def messages(file: Path) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """Topic -> (log time in ns, content) of every message."""
    from mcap.reader import make_reader

    out: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    with open(file, "rb") as content:
        for schema, channel, message in make_reader(content, validate_crcs=True).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            told = json.loads(message.data)
            allowed = json.loads(schema.data)["properties"]
            assert set(told) <= set(allowed)
            out.setdefault(channel.topic, []).append((message.log_time, told))
    return out


def column(rows: list[tuple[int, dict[str, Any]]], name: str) -> np.ndarray:
    """(n,) of a column, NaN where a message does not hold it."""
    head, _, tail = name.partition(".")
    return np.array([(m.get(head, {}).get(tail) if tail else m.get(head)) for _, m in rows], dtype=float)


def entities(file: Path) -> dict[str, dict[str, Any]]:
    """Entity -> component columns and timelines of the rows that have a time."""
    from rerun.chunk import RrdReader

    out = {}
    for chunk in RrdReader(file).stream():
        if not chunk.is_static:
            assert chunk.entity_path not in out
            out[chunk.entity_path] = chunk.to_record_batch().to_pydict()
    return out


def test_a_diagnosis_names_runs_and_horizon_and_the_gap_is_that_of_the_gap_command(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = rover / "out" / "diagnosis.json"
    made = said(capsys, "export", file, "--to", "mcap", "--out", tmp_path)
    gap = said(capsys, "gap", "--robot", rover / "rover.toml", rover / "runs", "--model", file, "--horizon", "0.5")
    for ours, theirs in (("nominal", "nominal"), ("corrected", "model"), ("noise_floor", "noise_floor")):
        assert made[ours] == gap[theirs]
    assert made["corrected"] < 0.3 * made["nominal"]
    assert [r["windows"] for r in made["runs"]] == [12, 12] and made["horizon"] == 0.5
    assert {p.name for p in tmp_path.iterdir()} == {"r0.mcap", "r1.mcap", "export.json"}
    assert json.loads((tmp_path / "export.json").read_text())["runs"] == made["runs"]
    for run in made["runs"]:
        rows = messages(tmp_path / run["file"])["/gap"]
        assert (column(rows, "noise_floor") == made["noise_floor"]).all()
        for name in ("nominal", "corrected"):  # every channel of these windows has about as many samples
            assert np.sqrt(np.mean(column(rows, name) ** 2)) == pytest.approx(run[name], rel=0.02)


@pytest.mark.parametrize(("topic", "key"), [("/nominal", "nominal"), ("/corrected", "model")])
def test_the_gap_of_what_is_recorded_is_the_gap_as_its_definition_reads(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], topic: str, key: str
) -> None:
    """The literal gap is told nothing but the recording's predictions and its measurements."""
    said(capsys, "export", rover / "out" / "model.json", "--to", "mcap", "--out", tmp_path, "--runs", rover / "runs")
    gap = said(capsys, "gap", "--robot", rover / "rover.toml", rover / "runs", "--model", rover / "out" / "model.json")
    runs, predicted = [], {}
    for name in ("r0", "r1"):
        rows = messages(tmp_path / f"{name}.mcap")
        measured = rows["/measured"]
        runs.append(Run(name, column(measured, "t"), {c: column(measured, c) for c in POSE}))
        for _, m in rows[topic]:
            predicted[name, m["window"], round(m["t"], 6)] = m["pose"]

    def replay(run: Run, start: Mapping[str, float], t0: float) -> Any:
        return lambda channel, t: predicted[run.name, round(t0), round(t, 6)][channel.partition(".")[2]]

    found = gap_literal(runs, POSE, STATES, replay, 1.0, SIGMA, dict.fromkeys(POSE, 0.0))
    assert found["gap"] == pytest.approx(gap[key], rel=1e-6)


def test_stamps_samples_and_commands_are_those_of_the_log(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said(capsys, "export", rover / "out" / "model.json", "--to", "mcap", "--out", tmp_path / "one.mcap", "--runs",
         rover / "runs" / "r0.csv")  # fmt: skip
    assert {p.name for p in tmp_path.iterdir()} == {"one.mcap"}
    logged = np.genfromtxt(rover / "runs" / "r0.csv", delimiter=",", names=True, deletechars="")
    rows = messages(tmp_path / "one.mcap")
    stamps = np.array([at for at, _ in rows["/measured"]], dtype=np.int64)
    np.testing.assert_allclose((stamps - round(EPOCH * 1e9)) / 1e9, logged["t"] - EPOCH, atol=1e-6)
    np.testing.assert_array_equal(column(rows["/measured"], "pose.x"), logged["pose.x"])
    assert np.isnan(column(rows["/measured"], "pose.x")).sum() == 3
    np.testing.assert_array_equal(column(rows["/command"], "command.left"), logged["command.left"])
    for topic in ("/nominal", "/corrected"):
        assert set(column(rows[topic], "window")) == set(range(6))
        assert np.isfinite(column(rows[topic], "pose.x")).all()


def test_a_rerun_recording_holds_what_the_mcap_file_holds(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    call = ("export", rover / "out" / "model.json", "--runs", rover / "runs", "--out", tmp_path, "--to")
    assert said(capsys, *call, "rerun")["left_out"] == []
    said(capsys, *call, "mcap")
    rows, read = messages(tmp_path / "r1.mcap"), entities(tmp_path / "r1.rrd")
    for topic in ("/measured", "/nominal", "/corrected"):
        for channel in POSE:
            y = column(rows[topic], channel)
            kept = np.isfinite(y)
            entity = read[f"/channels/{channel}{topic}"]
            np.testing.assert_array_equal(np.concatenate(entity["Scalars:scalars"]), y[kept])
            seconds = [t.total_seconds() for t in entity["time"]]
            np.testing.assert_allclose(seconds, column(rows[topic], "t")[kept], atol=1e-6)
            assert entity["stamp"][0].timestamp() == pytest.approx(EPOCH + seconds[0], abs=1e-5)
    for name in ("nominal", "corrected", "noise_floor"):
        held = np.concatenate(read[f"/gap/{name}"]["Scalars:scalars"])
        np.testing.assert_array_equal(held, column(rows["/gap"], name))
    np.testing.assert_array_equal(
        np.concatenate(read["/command/command.left"]["Scalars:scalars"]), column(rows["/command"], "command.left")
    )


def test_a_rover_is_drawn_at_its_pose_and_points_ahead(
    rover: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun")
    call = ("export", rover / "out" / "model.json", "--runs", rover / "runs" / "r0.csv", "--out", tmp_path, "--to")
    said(capsys, *call, "rerun")
    said(capsys, *call, "mcap")
    rows, read = messages(tmp_path / "r0.mcap")["/corrected"], entities(tmp_path / "r0.rrd")
    body = read["/robot/corrected/body"]
    t = column(rows, "t")
    for at, lines in list(zip(body["time"], body["LineStrips3D:strips"], strict=True))[1:24]:  # the first window
        pose = [np.interp(at.total_seconds(), t[:21], column(rows, c)[:21]) for c in POSE]
        middle, front = np.array(lines[1][0]), np.array(lines[1][1])
        np.testing.assert_allclose(middle, [pose[0], pose[1], 0.0], atol=1e-6)
        ahead = front - middle
        assert math.remainder(math.atan2(ahead[1], ahead[0]) - pose[2], math.tau) == pytest.approx(0.0, abs=1e-4)
        assert lines[0][0] == lines[0][-1]  # the outline is closed


def test_an_arm_is_drawn_as_mujoco_places_its_links(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    (tmp_path / "arm.xml").write_text(arm_xml())
    (tmp_path / "arm.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, t = mujoco.MjData(model), np.arange(0.0, 4.0, 0.02)
    u = np.stack([0.4 * np.sin(2.0 * t), 0.5 * np.sin(3.1 * t + 1.0)], axis=1)
    q = np.empty_like(u)
    for k, now in enumerate(u):
        q[k], data.ctrl[:] = data.qpos, now
        mujoco.mj_step(model, data, 10)
    columns = {f"command.{j}": u[:, i] for i, j in enumerate(("j1", "j2"))}
    columns |= {f"position.{j}": q[:, i] for i, j in enumerate(("j1", "j2"))}
    write_run(Run("drive", t, columns), tmp_path)
    (tmp_path / "model.json").write_text(json.dumps(model_of("arm", "arm.toml", "payload", "mass", 0.3)))
    made = said(capsys, "export", tmp_path / "model.json", "--to", "rerun", "--runs", tmp_path / "drive.csv")
    assert made["left_out"] == [] and made["folder"] == str(tmp_path / "export_rerun")
    read = entities(tmp_path / "export_rerun" / "drive.rrd")
    body = read["/robot/measured/body"]
    for at, lines in list(zip(body["time"], body["LineStrips3D:strips"], strict=True))[::20]:
        data.qpos[:] = [np.interp(at.total_seconds(), t, q[:, i]) for i in range(2)]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(lines[-1][1], data.site("tool").xpos, atol=1e-5)
        assert any(np.allclose(line[1], data.body("lower").xpos, atol=1e-5) for line in lines)
    sagged = np.array(read["/robot/corrected/body"]["LineStrips3D:strips"][-1])[-1, 1]
    assert sagged[2] < np.array(read["/robot/nominal/body"]["LineStrips3D:strips"][-1])[-1, 1, 2] - 1e-3


@pytest.mark.parametrize("to", ["rerun", "mcap"])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("model.json",), "it names no runs. Name runs with --runs"),
        (("gone.json",), "the runs of gone.json do not all exist any more. Name runs with --runs"),
        (("learned.json",), "a learned model lists no runs, and its folder has no diagnosis. Name runs with --runs"),
        (("model.json", "--runs", "none.csv"), "none.csv"),
        (("model.json", "--runs", "arm.csv"), "command."),
        (("arm.json", "--runs", "r0.csv"), "arm"),
        (("model.json", "--runs", "r0.csv", "r1.csv", "--out", "both.SUFFIX"), "one file cannot hold 2 runs"),
        (("model.json", "--runs"), "needs at least one run"),
        (("model.json", "--runs", "r0.csv", "--horizon", "nan"), "must be a number"),
    ],
)
def test_what_cannot_be_recorded_is_refused_and_leaves_nothing(
    rover: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], to: str,
    words: tuple[str, ...], message: str,
) -> None:  # fmt: skip
    if to == "rerun":
        pytest.importorskip("rerun")
    for name in ("r0.csv", "r1.csv"):
        (tmp_path / name).write_text((rover / "runs" / name).read_text())
    (tmp_path / "model.json").write_text((rover / "out" / "model.json").read_text())
    (tmp_path / "arm.json").write_text(json.dumps(model_of("arm", "x", "payload", "mass", 0.3)))
    rover_model = json.loads((tmp_path / "model.json").read_text())
    (tmp_path / "gone.json").write_text(json.dumps({**rover_model, "run_files": ["gone"]}))
    (tmp_path / "learned.json").write_text(json.dumps({**rover_model, KEY: to_json(learned())}))
    t = np.arange(0.0, 4.0, 0.05)
    write_run(Run("arm", t, {"command.j1": np.sin(t), "position.j1": np.sin(t)}), tmp_path)
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.rglob("*"))
    words = tuple(w.replace("SUFFIX", {"rerun": "rrd", "mcap": "mcap"}[to]) for w in words)
    with pytest.raises(SystemExit) as end:
        main(["export", "--robot", str(rover / "rover.toml"), "--to", to, *words])
    told = capsys.readouterr()
    assert end.value.code == 2 and message in told.err and told.out == "" and "Traceback" not in told.err
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("option", [("--runs", "r0.csv"), ("--horizon", "2")])
def test_a_model_takes_no_runs(rover: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["export", str(rover / "out" / "model.json"), "--to", "mjcf", *option])
    assert end.value.code == 2 and "only --to rerun and --to mcap take" in capsys.readouterr().err
    assert not (rover / "out" / "export_mjcf").exists()


def test_every_run_has_a_file_name_of_its_own() -> None:
    assert file_names(["a/b", "a b", "A_b", "", "ok-1.2"], "mcap") == [
        "a_b.mcap", "a_b_2.mcap", "A_b_3.mcap", "run.mcap", "ok-1.2.mcap"
    ]  # fmt: skip


def test_python_takes_runs_in_memory_and_says_what_could_not_be_drawn(rover: Path, tmp_path: Path) -> None:
    """Encoders alone place no rover."""
    pytest.importorskip("rerun")
    run = rover_run("wheels", {}, 4.0)
    speed = {f"velocity.{w}": run.columns[f"command.{w}"] for w in ("left", "right")}
    commands = {c: y for c, y in run.columns.items() if c.startswith("command.")}
    write_run(Run("wheels", run.t, {**commands, **speed}), tmp_path)
    robot = rm.load_robot(rover / "rover.toml")
    runs = rm.read_runs(robot, tmp_path / "wheels.csv")
    made = rm.export_runs(robot, runs, "rerun", tmp_path / "out", model=rover / "out" / "model.json")
    assert len(made["left_out"]) == 1 and made["left_out"][0].startswith("the robot in wheels: no position")
    read = entities(tmp_path / "out" / "wheels.rrd")
    assert "/channels/velocity.left/nominal" in read and not any(e.startswith("/robot") for e in read)
    with pytest.raises(rm.BadInput, match="unknown format 'onnx'"):
        rm.export_runs(robot, runs, "onnx", tmp_path / "out", model=rover / "out" / "model.json")
