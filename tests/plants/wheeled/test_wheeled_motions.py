"""The motions against closed forms, and against the ranges that the paper states."""

import numpy as np
import pytest

from plants.wheeled.engines.geometry import Geometry
from plants.wheeled.motions import (
    MOTIONS,
    PAPER,
    back_and_forth,
    constant_yaw_rate,
    figure_eight,
    policy,
    route,
    spin_in_place,
    wheel_speeds,
)

T = np.linspace(0.0, 40.0, 2001)


def test_the_papers_ranges():
    v, w = spin_in_place().twist(T)
    assert (v == 0).all() and w.min() == pytest.approx(-2.0, abs=1e-3) and w.max() == pytest.approx(2.0, abs=1e-3)
    v, w = back_and_forth().twist(T)
    assert (w == 0).all() and v.min() == pytest.approx(-0.2, abs=1e-4) and v.max() == pytest.approx(0.2, abs=1e-4)
    v, w = constant_yaw_rate().twist(T)
    assert np.ptp(v) == np.ptp(w) == 0.0 and w[0] != 0.0
    assert [m.name for m in PAPER] == ["spin", "back_and_forth", "changing_yaw_rate", "constant_yaw_rate"]


def test_a_constant_yaw_rate_with_speed_is_a_circle():
    motion = constant_yaw_rate(rate=0.5, speed=0.1)
    path = motion.path(T, (1.0, 2.0, 0.3))
    theta = 0.3 + 0.5 * T
    np.testing.assert_allclose(path[:, 2], theta, atol=1e-12)
    np.testing.assert_allclose(path[:, 0], 1.0 + 0.2 * (np.sin(theta) - np.sin(0.3)), atol=1e-6)
    np.testing.assert_allclose(path[:, 1], 2.0 - 0.2 * (np.cos(theta) - np.cos(0.3)), atol=1e-6)


def test_the_figure_eight_is_the_lemniscate():
    """x = a sin s, y = a sin s cos s leaves the origin at 45 degrees: turned back by that, it starts along x."""
    motion, a = figure_eight(width=1.2, period=20.0), 0.6
    s = 2 * np.pi * T / 20.0
    x, y, half = a * np.sin(s), a * np.sin(s) * np.cos(s), np.sqrt(0.5)
    path = motion.path(T)
    np.testing.assert_allclose(path[:, 0], half * (x + y), atol=2e-6)
    np.testing.assert_allclose(path[:, 1], half * (y - x), atol=2e-6)


def test_the_route_comes_home():
    motion = route(side=0.8, speed=0.15, corner=0.2)
    path = motion.path(np.linspace(0.0, motion.period, 4000))
    np.testing.assert_allclose(path[-1], [0.0, 0.0, 2 * np.pi], atol=2e-3)
    assert np.ptp(path[:, 0]) == pytest.approx(0.8, abs=2e-3) == np.ptp(path[:, 1])


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda m: m.name)
def test_twist_repeats_and_is_the_rate_of_the_path(motion):
    t = T[T < 20.0]
    np.testing.assert_allclose(motion.twist(t + motion.period), motion.twist(t), atol=1e-9)
    path = motion.path(T)
    v, w = motion.twist(0.5 * (T[1:] + T[:-1]))
    h = np.diff(T)
    even = np.abs(np.diff(motion.twist(T), axis=1)).max(axis=0) < 0.05  # not where a motion jumps
    np.testing.assert_allclose((np.diff(path[:, 2]) / h)[even], w[even], atol=1e-3)
    np.testing.assert_allclose((np.hypot(*np.diff(path[:, :2], axis=0).T) / h)[even], np.abs(v)[even], atol=1e-3)


def test_wheel_speeds_invert_the_papers_equation():
    u = wheel_speeds(np.array([0.1, -0.2]), np.array([0.5, 2.0]), 0.033, 0.16)
    np.testing.assert_allclose(0.033 * (u[:, 0] + u[:, 1]) / 2, [0.1, -0.2])
    np.testing.assert_allclose(0.033 * (u[:, 1] - u[:, 0]) / 0.16, [0.5, 2.0])


def test_a_command_grows_from_rest():
    send = policy(constant_yaw_rate(), Geometry(), 0.02, ramp=1.0)
    np.testing.assert_allclose(send(0.0, {}), 0.01 * send(2.0, {}))
    np.testing.assert_allclose(send(0.49, {}), 0.5 * send(2.0, {}))


def test_starting_from_rest_leaves_the_path_as_it_is():
    """Wheel speeds integrated by the paper's equation end on the reference's path, half of the ramp late."""
    motion, period = figure_eight(period=10.0), 0.005
    send = policy(motion, Geometry(), period, ramp=1.0)
    x = y = theta = 0.0
    for k in range(round(6.0 / period)):
        left, right = send(k * period, {}) * 0.033
        turn = (right - left) / 0.16 * period
        x += 0.5 * (left + right) * np.cos(theta + 0.5 * turn) * period
        y += 0.5 * (left + right) * np.sin(theta + 0.5 * turn) * period
        theta += turn
    np.testing.assert_allclose([x, y, theta], motion.path(np.linspace(0.0, 5.5, 400))[-1], atol=1e-4)
