"""A change of a servo's position gain alone is a gain and a friction; a gain alone is then doubtful."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm
from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.position_gain import judged, notes_on, servo_doubts
from residual_mpc.comparison.records import Change, ChangedNumber
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Term

KP, KV, PERIOD = 8.0, 0.8, 0.012
ARM = """<mujoco><option timestep="{step}" integrator="implicitfast"/>
  <worldbody><body><joint name="hinge" axis="0 1 0" armature="0.01" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6" contype="0"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""
VISCOUS = Term("viscous_friction", None, True)


def write_run(path: Path, kp: float, kv: float, seed: int) -> None:
    """9.6 s of steps plus a sine, simulated with an eighth of the model's time step."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.0005, kp=kp, kv=kv))
    data, times = mujoco.MjData(model), PERIOD * np.arange(800)
    command = np.repeat(rng.uniform(-0.8, 0.8, 20), 40) + 0.3 * np.sin(rng.uniform(4.0, 9.0) * times)
    q = np.empty(len(times))
    for k, u in enumerate(command):
        q[k], data.ctrl[0] = data.qpos[0], u
        mujoco.mj_step(model, data, 24)
    table = {"t": times, "command.servo": command, "position.hinge": q + 1e-3 * rng.standard_normal(len(q))}
    pd.DataFrame(table).to_csv(path, index=False)


def compared(folder: Path, kp: float, kv: float) -> rm.Comparison:
    (folder / "arm.xml").write_text(ARM.format(step=0.004, kp=KP, kv=KV))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    for name, *gains in (("before", KP, KV), ("after", kp, kv)):
        (folder / name).mkdir()
        for k in range(3):
            write_run(folder / name / f"run{k}.csv", *gains, 10 * k + (name == "after"))
    robot = rm.load_robot(folder / "robot.toml")
    sets = [rm.read_runs(robot, folder / name) for name in ("before", "after")]
    return rm.compare(robot, *sets, only=("actuator_gain", "viscous_friction"))


def test_a_change_of_the_whole_gain_is_named(tmp_path: Path) -> None:
    """With high probability, although model and simulation use different time steps."""
    found = compared(tmp_path, 0.7 * KP, 0.7 * KV).document
    named = {c["effect"]: c for c in found["changes"]}
    assert named["actuator_gain"]["probability"] > 0.9 and found["notes"] == [] and found["verdict"] == "changed"
    assert named["actuator_gain"]["parameters"]["gain"]["change"]["value"] == pytest.approx(0.7, abs=0.02)
    assert all(c["probability"] < 0.5 for name, c in named.items() if name != "actuator_gain")


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_a_change_of_the_position_gain_alone_is_a_gain_and_a_friction(tmp_path: Path, factor: float) -> None:
    """Negative where the gain has grown, since the damping has not."""
    found = compared(tmp_path, factor * KP, KV).document
    named = {c["effect"]: c for c in found["changes"]}
    assert set(named) == {"actuator_gain", "viscous_friction"} and found["verdict"] == "changed"
    gain, friction = (
        named[e]["parameters"][p]["change"] for e, p in (("actuator_gain", "gain"), ("viscous_friction", "coefficient"))
    )
    assert gain["value"] == pytest.approx(factor, rel=0.03)
    assert friction["ci95"][0] <= (1.0 - factor) * KV <= friction["ci95"][1]
    assert min(c["probability"] for c in named.values()) > 0.9
    assert "position gain alone" in found["notes"][0]


def contrast(value: float, error: float) -> Contrast:
    probe = {Knob("viscous_friction", None, "coefficient", True): 0.1}
    return Contrast(VISCOUS, probe, 0.0, value / 0.1, 1.0, value / error, 0.5, 0.1)


def change(effect: str, value: float, half: float) -> Change:
    number = ChangedNumber("number", None, None, value, (value - half, value + half), "")
    return Change(Term(effect, None), 0.9, 0.01, (number,), "")


class Servo:
    """A stub robot with one position servo."""

    step = 0.001

    def actuator_values(self, settings: object) -> tuple[object, ...]:
        class One:
            kind, joint, actuator, damping = "position", "hinge", "servo", 0.5

        return (One(),)

    def not_of_actuators(self, settings: object) -> tuple[str, ...]:
        return ()


ROBOTS: list[Robot] = [Servo()]  # type: ignore[list-item]


def test_what_is_left_of_the_viscous_friction_decides() -> None:
    """With a gain of 0.8 the position gain alone leaves 0.2 times the damping, 0.1 N m s/rad."""

    def doubt(value: float, error: float) -> float:
        (found,) = servo_doubts([change("actuator_gain", 0.8, 0.01)], ROBOTS, [contrast(value, error)])
        return found.share

    assert doubt(0.1, 0.02) == pytest.approx(np.exp(-12.5) / (1 + np.exp(-12.5)))
    assert doubt(0.001, 0.02) == pytest.approx(1.0, abs=1e-3)
    assert doubt(0.05, 0.02) == pytest.approx(0.5) and doubt(0.01, 10.0) == pytest.approx(0.5, abs=1e-3)
    assert servo_doubts([change("actuator_gain", 0.8, 0.01)], ROBOTS, []) == ()
    assert servo_doubts([change("viscous_friction", 0.1, 0.01)], ROBOTS, [contrast(0.1, 0.02)]) == ()


def test_a_gain_of_both_sets_scales_the_damping() -> None:
    """With 1.5 before, a gain of 0.8 leaves 0.15 N m s/rad of a damping of 0.5, and not 0.1."""
    (number,) = change("actuator_gain", 0.8, 0.01).parameters
    gain = replace(change("actuator_gain", 0.8, 0.01), parameters=(replace(number, before=1.5),))
    (found,) = servo_doubts([gain], ROBOTS, [contrast(0.075, 0.02)])
    assert found.share == pytest.approx(0.5)


def test_a_friction_that_completes_the_gain() -> None:
    gain = change("actuator_gain", 0.8, 0.02)

    def friction(value: float, half: float) -> tuple[Term, ...]:
        (found,) = servo_doubts([gain, change("viscous_friction", value, half)], ROBOTS, [contrast(0.001, 0.02)])
        return found.frictions

    assert friction(0.105, 0.02) and not friction(0.2, 0.02)
    assert not friction(0.1, 0.3)  # so wide that it says nothing
    assert not friction(-0.1, 0.02)
    assert servo_doubts([change("actuator_gain", 1.0, 0.02), change("viscous_friction", 0.1, 0.02)], ROBOTS, []) == ()


def test_what_is_doubted_is_less_probable_and_said() -> None:
    changes = [change("actuator_gain", 0.8, 0.02), change("viscous_friction", 0.1, 0.02), change("armature", 0.1, 0.02)]
    both = servo_doubts(changes, ROBOTS, [])
    faint = [changes[0], replace(changes[1], probability=0.45), changes[2]]
    assert [c.probability for c in judged(faint, both)] == [0.9, 0.9, 0.9]
    (note,) = notes_on(both)
    assert "actuator_gain and viscous_friction together" in note
    alone = servo_doubts(changes[:1], ROBOTS, [contrast(0.0499, 0.02)])
    assert judged(changes, alone)[0].probability == pytest.approx(0.45, abs=0.01)
    assert "not ruled out: its share of the likelihood is 0.49" in notes_on(alone)[0]
