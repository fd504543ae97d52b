"""At its null value every effect leaves its signal unchanged, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.effects.actuator import lag_start, lag_step
from residual_mpc.effects.effect import STAGES, Effect, Parameter
from residual_mpc.effects.ground import ground_twist, radius_factor, world_drift
from residual_mpc.effects.library import BY_NAME, HOSTED, LIBRARY
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.sensor import mounted, unmounted

DT = 0.01  # s
SIGNALS = 0.3 + 4.0 * np.random.default_rng(1).standard_normal((60, 2, 3))  # steps, rows, actuators


def of_port(port: str) -> list[str]:
    return [e.name for e in LIBRARY if e.port == port]


def null_of(effect: Effect) -> dict[str, np.ndarray]:
    return {p.name: np.full((2, 3), p.null) for p in effect.parameters}


@pytest.mark.parametrize("name", of_port("command"))
def test_a_command_passes(name: str) -> None:
    effect, p = BY_NAME[name], null_of(BY_NAME[name])
    if name == "actuator_lag":
        memory, step = lag_start(NUMPY, p, SIGNALS[0], DT), lambda o, p, m, u, dt: lag_step(o, p, m, u, dt)
    else:
        assert effect.start is not None and effect.step is not None
        memory, step = effect.start(NUMPY, p, SIGNALS[0], DT), effect.step
    for u in SIGNALS:
        out, memory = step(NUMPY, p, memory, u, DT)
        np.testing.assert_array_equal(out, u)


@pytest.mark.parametrize("name", of_port("output"))
def test_an_output_passes(name: str) -> None:
    effect, p = BY_NAME[name], null_of(BY_NAME[name])
    assert effect.start is not None and effect.step is not None
    memory = effect.start(NUMPY, p, SIGNALS[0])
    for k, y in enumerate(SIGNALS):
        out, memory = effect.step(NUMPY, p, memory, y, np.array(17.0 + k * DT), DT)
        np.testing.assert_array_equal(out, y)


@pytest.mark.parametrize("name", of_port("pair"))
def test_a_pair_of_wheels_passes(name: str) -> None:
    effect, p = BY_NAME[name], null_of(BY_NAME[name])
    assert effect.start is not None and effect.step is not None
    memory = effect.start(NUMPY, p, SIGNALS[0], SIGNALS[1], DT)
    for left, right in zip(SIGNALS[:-1], SIGNALS[1:], strict=True):
        out, memory = effect.step(NUMPY, p, memory, left, right, DT)
        np.testing.assert_array_equal(out, (left, right))


@pytest.mark.parametrize("name", of_port("friction"))
def test_a_friction_brakes_nothing(name: str) -> None:
    effect = BY_NAME[name]
    assert effect.step is not None
    np.testing.assert_array_equal(effect.step(NUMPY, null_of(effect), SIGNALS[0], SIGNALS[1]) + SIGNALS[2], SIGNALS[2])


@pytest.mark.parametrize("name", of_port("torque"))
def test_a_torque_beside_the_joint_is_none(name: str) -> None:
    effect = BY_NAME[name]
    assert effect.step is not None
    turning = SIGNALS[1:2] if effect.site == "law" else []
    torque = effect.step(NUMPY, null_of(effect), SIGNALS[0], *turning)
    np.testing.assert_array_equal(torque, np.zeros_like(SIGNALS[0]))


@pytest.mark.parametrize("name", of_port("servo"))
def test_an_integral_part_sums_up_nothing(name: str) -> None:
    effect = BY_NAME[name]
    assert effect.step is not None
    x = effect.step(NUMPY, null_of(effect), SIGNALS[0], SIGNALS[1], DT)
    np.testing.assert_array_equal(x, SIGNALS[0])


@pytest.mark.parametrize("name", of_port("speed"))
def test_a_limit_by_speed_is_none(name: str) -> None:
    effect = BY_NAME[name]
    assert effect.step is not None
    low, high = effect.step(NUMPY, null_of(effect), 1000.0 * SIGNALS[0])
    np.testing.assert_array_equal(low, np.full_like(SIGNALS[0], -np.inf))
    np.testing.assert_array_equal(high, np.full_like(SIGNALS[0], np.inf))


@pytest.mark.parametrize("name", [e.name for e in LIBRARY if e.stage == "contact"])
def test_the_ground_is_the_papers(name: str) -> None:
    w, a = (SIGNALS[0], SIGNALS[1]), (SIGNALS[2], SIGNALS[3])
    bare = ground_twist(NUMPY, {}, 0.033, 0.16, w, a)
    effects = {name: null_of(BY_NAME[name])}
    there = ground_twist(NUMPY, effects, 0.033, 0.16, w, a)
    x, y = world_drift(NUMPY, effects) or (0.0, 0.0)
    there = (there[0] + x, there[1] + y, there[2])
    for x, y in zip(there, bare, strict=True):
        np.testing.assert_array_equal(x, y)


def test_a_wheel_that_is_round_keeps_its_radius() -> None:
    factor = radius_factor(NUMPY, {"wheel_eccentricity": null_of(BY_NAME["wheel_eccentricity"])}, SIGNALS[0])
    np.testing.assert_array_equal(factor, np.ones_like(SIGNALS[0]))


@pytest.mark.parametrize("through", [mounted, unmounted])
def test_a_sensor_in_the_middle_sees_the_robot(through: object) -> None:
    assert callable(through)
    x, y = through(NUMPY, null_of(BY_NAME["sensor_mounting"]), *SIGNALS[:3])
    np.testing.assert_array_equal(x, SIGNALS[0])
    np.testing.assert_array_equal(y, SIGNALS[1])


def test_the_sensor_position_is_undone() -> None:
    p = {"x": np.array(0.3), "y": np.array(-0.2)}
    there = mounted(NUMPY, p, *SIGNALS[:3])
    back = unmounted(NUMPY, p, *there, SIGNALS[2])
    np.testing.assert_allclose(back, SIGNALS[:2], rtol=0, atol=1e-14)


def test_every_effect_has_its_place() -> None:
    assert len(BY_NAME) == len(HOSTED) > len(LIBRARY)
    stages = [STAGES.index(e.stage) for e in LIBRARY]
    assert stages == sorted(stages)  # of a confounded group the earliest is named
    ports = {p for e in LIBRARY for p in (e.port,)}
    assert ports == {"command", "output", "pair", "speed", "servo", "friction", "torque", "ground", "sensor", "model"}
    for effect in LIBRARY:
        assert len({p.name for p in effect.parameters}) == len(effect.parameters)
        with pytest.raises(KeyError):
            effect.parameter("no such parameter")


def test_a_null_value_outside_its_limits_is_refused() -> None:
    with pytest.raises(ValueError, match="null"):
        Parameter("gain", "1", 1.0, 2.0, 3.0, ())
