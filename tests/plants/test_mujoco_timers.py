"""MuJoCo without its timers steps as with them."""

import mujoco
import numpy as np
import pytest

from plants.mujoco_timers import stop_mujoco_timers

PENDULUM = """
<mujoco><option integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 1 0" frictionloss="0.01" damping="0.02"/>
  <geom size="0.02" fromto="0 0 0 0.2 0 0" type="capsule"/>
</body></worldbody></mujoco>
"""


@pytest.fixture
def clock():
    """A function that puts back the bindings' own clock; the timers are off again after the test."""

    def put_back() -> None:
        mujoco.set_mjcb_time(None)
        stop_mujoco_timers.cache_clear()

    yield put_back
    put_back()
    stop_mujoco_timers()


def stepped() -> tuple[np.ndarray, float]:
    """(2,) the state after a second, and what MuJoCo's timer of a step shows."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    return np.concatenate([data.qpos, data.qvel]), data.timer[int(mujoco.mjtTimer.mjTIMER_STEP)].duration


def test_the_timers_are_off_and_the_states_the_same(clock):
    clock()
    timed, duration = stepped()
    assert duration > 0.0
    stop_mujoco_timers()
    untimed, duration = stepped()
    assert duration == 0.0
    assert np.array_equal(timed, untimed)


def test_a_clock_of_the_user_stays(clock):
    clock()
    mujoco.set_mjcb_time(lambda: 1.0)
    stop_mujoco_timers()
    assert mujoco.get_mjcb_time() is not None
