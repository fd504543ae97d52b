"""Each change of a model has the name, the target, the sign and the size that the library gives to what undoes it."""

import numpy as np
import pytest
from recorded_robots import ARM, GEOMETRY, arm, rover

from residual_mpc.api.robot import load_robot
from residual_mpc.blind.recorded.kinds.body import CARRIED, LENGTH, LINK
from residual_mpc.blind.recorded.kinds.drive import RADIUS, TRACK
from residual_mpc.blind.recorded.kinds.joint import DAMPING, DRY, FORCE, ROTOR
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Knob, assemble

RNG = np.random.default_rng(0)
CHANGES = (
    (CARRIED, None, {"mass": 0.1}), (CARRIED, None, {"mass": -0.2}), (LINK, "lower", {"mass": 0.2}),
    (LINK, "upper", {"mass": -0.3}), (LENGTH, "upper", {"offset": 0.05}), (ROTOR, "elbow", {"inertia": -0.02}),
    (DRY, "shoulder", {"torque": 0.06}), (DRY, "elbow", {"torque": -0.2}), (DAMPING, "elbow", {"coefficient": 0.15}),
    (FORCE, "m1", {"gain": 4.0}), (FORCE, "m2", {"gain": 0.7}), (FORCE, None, {"gain": 1.2}),
)  # fmt: skip


def replayed(robot, start, hypothesis, channels):
    """Positions over a second of the robot's commands."""
    t = 0.005 * np.arange(200)
    command = np.stack([np.sin(7 * t), 0.8 * np.cos(5 * t)], axis=-1)[None]
    drive = Drive(0.005, 0, command, None, np.zeros(1))
    slots = {knob.effect: robot.slots(knob.effect) for knob in hypothesis}
    out = robot.replay(start, drive, assemble([hypothesis], slots), channels)
    return np.stack([out[c][0] for c in channels])


def check(original, edited, start, kind, target, sizes, channels):
    nothing = replayed(original, start, {}, channels)
    lacking = replayed(edited, start, {}, channels)
    whole = replayed(edited, start, {Knob(kind.effect, target, p): v for p, v in sizes.items()}, channels)
    assert np.abs(lacking - nothing).max() > 1e-3
    assert np.abs(whole - nothing).max() < 0.03 * np.abs(lacking - nothing).max()


@pytest.mark.parametrize(("kind", "target", "sizes"), CHANGES)
def test_the_librarys_effect_undoes_a_change_of_an_arm(tmp_path, kind, target, sizes):
    robots = []
    for name, text in (("old", ARM), ("new", kind.apply(arm(), target, sizes, RNG).settings[0].model)):
        (tmp_path / f"{name}.xml").write_text(text)
        (tmp_path / f"{name}.toml").write_text(f'plant = "mujoco"\nmodel = "{name}.xml"\npayload_site = "tip"\n')
        robots.append(load_robot(tmp_path / f"{name}.toml").model)
    start = {f"{kind}.{j}": np.zeros(1) for kind in ("position", "velocity") for j in ("shoulder", "elbow")}
    check(*robots, start, kind, target, sizes, ("position.shoulder", "position.elbow"))


@pytest.mark.parametrize(("kind", "sizes"), [(RADIUS, {"scale": 1.2}), (TRACK, {"scale": 0.7})])
def test_the_librarys_effect_undoes_a_change_of_a_rover(tmp_path, kind, sizes):
    robots = []
    for name, given in (("old", GEOMETRY), ("new", kind.apply(rover(), None, sizes, RNG).settings[0].parameters)):
        numbers = "".join(f"{k} = {v}\n" for k, v in given.items())
        (tmp_path / f"{name}.toml").write_text(f'plant = "diff_drive"\n[parameters]\n{numbers}')
        robots.append(load_robot(tmp_path / f"{name}.toml").model)
    start = {c: np.zeros(1) for c in ("pose.x", "pose.y", "pose.theta")}
    check(*robots, start, kind, None, sizes, ("pose.x", "pose.y", "pose.theta"))
