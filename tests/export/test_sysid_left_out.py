"""What a set of parameters for system identification cannot hold is said."""

from plants.mujoco_robot.exports.sysid import _sorted
from residual_mpc.models.settings import Knob

DELAY, SHARE = Knob("command_delay", None, "delay"), Knob("gravity_compensation", None, "share")


def test_what_is_the_logs_or_the_controllers_is_left_out() -> None:
    free, fixed, left_out = _sorted({DELAY: -0.03, SHARE: 0.9}, {DELAY: (-0.04, -0.02), SHARE: (0.8, 1.0)})
    assert free == [] and fixed == {}
    assert [text.split(":")[0] for text in left_out] == ["command_delay", "gravity_compensation"]


def test_a_delay_of_the_robot_is_a_parameter() -> None:
    assert _sorted({DELAY: 0.03}, {DELAY: (0.02, 0.04)}) == ([DELAY], {}, [])
