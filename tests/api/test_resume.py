"""A command that was killed goes on where it was, and its answer is the one that it would have given."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml
from oracles.rover_log import ROBOT, rover_run, write_run
from short_films import PROGRAM

from residual_mpc.checkpoint import Checkpoint, Keeper
from residual_mpc.errors import BadInput

KILLED = """
import os, signal, sys
from residual_mpc.checkpoint import Checkpoint
from residual_mpc.cli.main import main
put, left = Checkpoint.put, [int(sys.argv[1])]
def kill(self, *step):
    put(self, *step)
    left[0] -= 1
    if not left[0]:
        os.kill(os.getpid(), signal.SIGKILL)
Checkpoint.put = kill
main(sys.argv[2:])
"""
LATE = {"command_delay": {"delay": 0.08}}


def call(folder: Path, *words: str, steps: int = 0) -> subprocess.CompletedProcess[str]:
    """The command, with short films; killed as soon as so many steps of it are finished."""
    program = ["-c", KILLED, str(steps)] if steps else ["-c", PROGRAM]
    return subprocess.run([sys.executable, *program, *words], cwd=folder, capture_output=True, text=True, check=False)


def killed(folder: Path, *words: str, steps: int) -> None:
    assert call(folder, *words, steps=steps).returncode == -signal.SIGKILL


def stages(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rover")
    (folder / "robot.toml").write_text(ROBOT)
    for k in range(2):
        write_run(rover_run(f"run{k}", LATE, seconds=16.0, seed=k), folder)
    return folder


def diagnose(out: str, only: str = "command_delay,actuator_lag", seed: int = 3) -> list[str]:
    words = ["diagnose", "--robot", "robot.toml", "run0.csv", "run1.csv", "--only", only]
    return [*words, "--seed", str(seed), "--out", out]


def answer(folder: Path, out: str) -> str:
    return (folder / out / "diagnosis.json").read_text().replace(f"--out {out}", "--out X").replace(f"{out}/", "X/")


@pytest.fixture(scope="module")
def uninterrupted(rover: Path) -> str:
    stages(call(rover, *diagnose("whole")))
    return answer(rover, "whole")


@pytest.mark.parametrize(
    ("steps", "again"),
    [
        (2, "fitting on all"),
        pytest.param(1, "comparing with", marks=pytest.mark.slow),
        pytest.param(4, "analysing", marks=pytest.mark.slow),
    ],
)
def test_a_killed_diagnosis_goes_on(rover: Path, uninterrupted: str, steps: int, again: str) -> None:
    out = f"after{steps}"
    killed(rover, *diagnose(out), steps=steps)
    assert {p.name for p in (rover / out).iterdir()} == {"resume.bin", "unfinished.json"}
    said = stages(call(rover, *diagnose(out)))
    assert "going on from where" in said and again in said and "searching (" not in said
    assert answer(rover, out) == uninterrupted
    assert sorted(p.name for p in (rover / out).iterdir()) == sorted(p.name for p in (rover / "whole").iterdir())


@pytest.mark.slow
def test_another_seed_other_options_or_another_run_begin_anew(rover: Path) -> None:
    for name, words in (("seed", {"seed": 4}), ("only", {"only": "command_delay"})):
        killed(rover, *diagnose(name), steps=2)
        said = stages(call(rover, *diagnose(name, **words)))  # type: ignore[arg-type]
        assert "going on from where" not in said and "searching (" in said
    killed(rover, *diagnose("log"), steps=2)
    log = (rover / "run1.csv").read_text()
    try:
        (rover / "run1.csv").write_text(log.replace("0.1", "0.2", 1))
        assert "going on from where" not in stages(call(rover, *diagnose("log")))
    finally:
        (rover / "run1.csv").write_text(log)


@pytest.mark.slow
def test_a_killed_diagnosis_of_an_arm_goes_on(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml())
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    rng, t = np.random.default_rng(0), np.arange(0.0, 12.0, 0.01)
    u = 0.4 * np.sin(t[:, None] * (2.1, 3.3))
    late = np.array([np.interp(t - 0.05, t, x) for x in u.T]).T
    q = late + 2e-3 * rng.standard_normal(u.shape)
    rows = np.column_stack([t, u, q])
    header = "t,command.j1,command.j2,position.j1,position.j2"
    for k in range(2):
        np.savetxt(tmp_path / f"run{k}.csv", rows, delimiter=",", header=header, comments="")
    stages(call(tmp_path, *diagnose("whole", only="command_delay,payload")))
    killed(tmp_path, *diagnose("part", only="command_delay,payload"), steps=2)
    assert "searching (" not in stages(call(tmp_path, *diagnose("part", only="command_delay,payload")))
    assert answer(tmp_path, "part") == answer(tmp_path, "whole")


def test_a_killed_plan_goes_on(rover: Path, uninterrupted: str) -> None:
    document = json.loads(uninterrupted)
    lag = {"effect": "actuator_lag", "target": None}
    values = [{**lag, "parameter": "time_constant", "value": 0.08}]
    document["alternatives"] = [{"effects": [lag], "values": values}]
    (rover / "open.json").write_text(json.dumps(document))
    plan = ["excite", "open.json", "--robot", "robot.toml", "--seconds", "6", "--json", "--out"]
    whole = call(rover, *plan, "whole.csv")
    stages(whole)
    assert json.loads(whole.stdout)["excite"]["purpose"] == "tell apart"
    killed(rover, *plan, "part.csv", steps=3)
    assert (rover / "part.csv.resume").exists() and not (rover / "part.csv").exists()
    part = call(rover, *plan, "part.csv")
    said = stages(part)
    assert len(said.splitlines()) <= len(whole.stderr.splitlines())
    assert part.stdout.replace("part.csv", "X") == whole.stdout.replace("whole.csv", "X")
    assert (rover / "part.csv").read_text() == (rover / "whole.csv").read_text()
    assert not (rover / "part.csv.resume").exists()


class Attack:
    """Calls what no checkpoint may call."""

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, ("attacked",)


def test_a_file_from_elsewhere_runs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "resume.bin"
    key, blob = pickle.dumps("k"), pickle.dumps(Attack())
    for content in (blob, key + blob, b"broken", b"", pickle.dumps([1]), key + pickle.dumps([1])):
        path.write_bytes(content)
        assert Checkpoint(path, "k").last is None
    rng = np.random.default_rng(0)
    path.write_bytes(key + pickle.dumps(("one", (rng.bit_generator.state, 0), len(blob))) + blob)
    with pytest.raises(pickle.UnpicklingError, match="may not hold"):
        Keeper(Checkpoint(path, "k"), rng)("one", lambda: 1)
    assert not (tmp_path / "attacked").exists()
    # a class of another package, reached as an attribute of one of this package's modules
    words = (b"\x8c" + bytes([len(w)]) + w for w in (b"residual_mpc.checkpoint", b"pickle.Unpickler"))
    dotted = b"\x80\x04" + b"".join(words) + b"\x93."
    path.write_bytes(key + pickle.dumps(("one", (rng.bit_generator.state, 0), len(dotted))) + dotted)
    with pytest.raises(pickle.UnpicklingError, match="may not hold"):
        Keeper(Checkpoint(path, "k"), rng)("one", lambda: 1)


def test_the_generator_goes_on_as_if_the_step_had_run(tmp_path: Path) -> None:
    def step(rng: np.random.Generator) -> float:
        return float(rng.standard_normal() + rng.spawn(1)[0].standard_normal())

    def after(rng: np.random.Generator) -> tuple[float, float]:
        return float(rng.standard_normal()), float(rng.spawn(1)[0].standard_normal())

    first, second = np.random.default_rng(5), np.random.default_rng(5)
    one = Keeper(Checkpoint(tmp_path / "f", "k"), first)("step", lambda: step(first))
    two = Keeper(Checkpoint(tmp_path / "f", "k"), second)("step", lambda: pytest.fail("it was kept"))
    assert (one, after(first)) == (two, after(second))


def test_a_record_that_was_cut_short_is_made_again(tmp_path: Path) -> None:
    """Wherever the kill came: what is complete stays, and what follows is written over the rest."""
    path, rng = tmp_path / "f", np.random.default_rng(0)
    keep = Keeper(Checkpoint(path, "k"), rng)
    assert [keep(f"step{k}", lambda: np.full(50, k)).sum() for k in range(3)] == [0, 50, 100]  # noqa: B023
    whole = path.read_bytes()
    kept = []
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        kept.append(Checkpoint(path, "k").last)
    assert kept == sorted(kept, key=lambda step: step or "")  # the longer the file, the more steps
    assert set(kept) == {None, "step0", "step1", "step2"} and kept.count("step2") == 1
    path.write_bytes(whole[: kept.index("step1") + 40])
    again = Keeper(Checkpoint(path, "k"), rng)
    assert again("step1", lambda: pytest.fail("it was kept")).sum() == 50
    assert again("step2", lambda: np.full(50, 2)).sum() == 100
    assert Keeper(Checkpoint(path, "k"), rng)("step2", lambda: pytest.fail("it was kept")).sum() == 100
    assert Checkpoint(path, "other").last is None


def test_a_checkpoint_that_is_removed_meanwhile_begins_again(tmp_path: Path) -> None:
    path, rng = tmp_path / "out" / "f", np.random.default_rng(0)
    keep = Keeper(Checkpoint(path, "k"), rng)
    assert keep("one", lambda: 1) == 1
    path.unlink()
    path.parent.rmdir()
    assert keep("two", lambda: 2) == 2
    assert "two" in Checkpoint(path, "k") and "one" not in Checkpoint(path, "k")


def test_a_checkpoint_that_cannot_be_written_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "f"
    checkpoint = Checkpoint(path, "k")
    checkpoint.put("one", b"1", None)

    def full(*words: object, **more: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(BadInput, match="No space left on device"):
        checkpoint.put("two", b"2", None)
