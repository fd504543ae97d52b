"""A change that is put into a log is what a robot with that change logs, for the commands that stand in the log."""

import numpy as np
import pytest
from recorded_robots import GEOMETRY, NOISE, Column, arm, arm_log, commands, drive, rover, rover_log

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.clock import DELAYED_COMMANDS, DELAYED_SENSORS, SKEW
from residual_mpc.blind.recorded.kinds.drive import MISMATCH, WHEEL_GAIN, ZONE
from residual_mpc.blind.recorded.kinds.kind import Kind
from residual_mpc.blind.recorded.kinds.library import KINDS, carried_by, why_not
from residual_mpc.blind.recorded.kinds.sensor import BIAS, MOUNTING, OUTLIERS, SCALE
from residual_mpc.blind.recorded.log import Log, table_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput

# kind, target, sizes, the same change in the simulation
CHANGES = (
    (DELAYED_COMMANDS, None, {"delay": 0.06}, {"delay": {"left": 0.06, "right": 0.06}}),
    (DELAYED_COMMANDS, "left", {"delay": 0.113}, {"delay": {"left": 0.113}}),
    (WHEEL_GAIN, "right", {"gain": 1.3}, {"gain": {"right": 1.3}}),
    (WHEEL_GAIN, None, {"gain": 0.8}, {"gain": {"left": 0.8, "right": 0.8}}),
    (ZONE, "left", {"width": 1.2}, {"zone": 1.2}),
    (DELAYED_SENSORS, "pose", {"delay": 0.08}, {"late": 0.08}),
    (DELAYED_SENSORS, "pose", {"delay": 0.033}, {"late": 0.033}),
    (SKEW, None, {"rate": -0.013}, {"clock": -0.013}),
    (BIAS, "pose.theta", {"bias": -0.2}, {"bias": -0.2}),
    (MOUNTING, None, {"x": 0.2, "y": -0.1}, {"point": (0.2, -0.1)}),
)  # fmt: skip


@pytest.mark.parametrize(("kind", "target", "sizes", "truth"), CHANGES)
def test_a_simulated_robot_with_the_change_logs_the_same(kind, target, sizes, truth):
    log = rover_log(3)
    (changed,) = kind.apply(rover(log), target, sizes, np.random.default_rng(0)).logs
    sent = {c: changed.columns[c] for c in changed.commands}
    simulated = drive(sent, log.columns["pose.x"].t, np.random.default_rng(4), **truth)
    for name, column in simulated.items():
        injected = changed.columns[name]
        np.testing.assert_allclose(injected.t, column.t, atol=1e-9)
        # the point's position takes the heading's noise with it
        near = 5 * NOISE["pose.theta"] * 0.3 if kind is MOUNTING and name != "pose.theta" else 1e-9
        np.testing.assert_allclose(injected.values, column.values, atol=near)
    untouched = drive(sent, log.columns["pose.x"].t, np.random.default_rng(4))
    assert any(
        np.abs(changed.columns[c].values - untouched[c].values).max() > 10 * NOISE[c]
        or np.abs(changed.columns[c].t - untouched[c].t).max() > 1e-3
        for c in untouched
    )


def test_a_larger_right_wheel_behind_its_encoder_gives_the_same_yaw_rate():
    w = drive(commands(np.random.default_rng(1)), commands(np.random.default_rng(1))["command.left"].t,
              np.random.default_rng(2))  # fmt: skip
    t = w["velocity.left"].t

    def yaw(left, right, ratio):
        r, b = GEOMETRY["wheel_radius"], GEOMETRY["track_width"]
        return r * (ratio * right - left) / b

    left, right = w["velocity.left"].values, w["velocity.right"].values
    columns = {"velocity.left": Column(t, left), "velocity.right": Column(t, right),
               "twist.theta": Column(t, yaw(left, right, 1.0))}  # fmt: skip
    half = rover(Log("after_run", columns, frozenset({"velocity.left", "velocity.right"})))
    (changed,) = MISMATCH.apply(half, None, {"ratio": 1.07}, np.random.default_rng(0)).logs
    again = yaw(changed.columns["velocity.left"].values, changed.columns["velocity.right"].values, 1.07)
    np.testing.assert_allclose(changed.columns["twist.theta"].values, again, atol=1e-12)


def test_one_joint_reports_late():
    (changed,) = DELAYED_SENSORS.apply(arm(), "shoulder", {"delay": 0.05}, np.random.default_rng(0)).logs
    simulated = arm_log(late=0.05)
    for name, column in simulated.columns.items():
        np.testing.assert_array_equal(changed.columns[name].t, column.t)
        np.testing.assert_array_equal(changed.columns[name].values, column.values)


def test_whole_samples_fall_into_rows_that_are_there_and_others_get_their_own():
    half = arm()
    rng = np.random.default_rng(0)
    (late,) = DELAYED_SENSORS.apply(half, None, {"delay": 0.05}, rng).logs
    table = table_of(late)
    assert len(table["t"]) == 605
    np.testing.assert_array_equal(table["position.elbow"][5:], half.logs[0].columns["position.elbow"].values)
    assert np.isnan(table["position.elbow"][:5]).all() and np.isnan(table["command.m1"][-5:]).all()
    (between,) = DELAYED_SENSORS.apply(half, None, {"delay": 0.0537}, rng).logs
    assert len(table_of(between)["t"]) == 1200
    assert len(table_of(half.logs[0])["t"]) == 600


def test_a_reading_is_scaled():
    half = arm()
    (changed,) = SCALE.apply(half, "position.elbow", {"scale": 1.1}, np.random.default_rng(0)).logs
    old = half.logs[0].columns
    np.testing.assert_allclose(changed.columns["position.elbow"].values, 1.1 * old["position.elbow"].values)
    assert changed.columns["position.shoulder"] is old["position.shoulder"]


def test_the_stated_share_of_samples_jumps_and_the_others_stay():
    half = rover(rover_log(1), rover_log(2, seconds=2.0))
    changed = OUTLIERS.apply(half, None, {"rate": 0.04}, np.random.default_rng(0))
    moved = np.concatenate([
        np.abs(new.columns["pose.x"].values - old.columns["pose.x"].values)
        for new, old in zip(changed.logs, half.logs, strict=True)
    ])  # fmt: skip
    assert np.mean(moved > 0) == pytest.approx(0.04, abs=1 / len(moved))
    assert moved[moved > 0].min() > 0.5 * half.spread("pose.x")


def carrier(kind: Kind, log: Log) -> Half:
    """A half that can carry this kind of change, on a log of the rover if it is one of the rover's."""
    driven = {c: column for c, column in log.columns.items() if not c.startswith("command")}
    encoders = Log(log.name, driven, frozenset({"velocity.left", "velocity.right"}))
    return next(h for h in (rover(log), arm(), rover(encoders)) if kind in [k for k, _ in carried_by(h)])


@pytest.mark.parametrize("kind", [k for k in KINDS if k.place == "log"], ids=lambda k: k.effect)
def test_sizes_grow_with_the_dose(kind):
    half = carrier(kind, rover_log(1))
    (target, *_) = kind.targets(half)

    def size(strength):
        drawn = kind.size(half, target, strength, np.random.default_rng(5))
        return np.hypot.reduce([v - (p in ("gain", "scale", "ratio")) for p, v in drawn.items()])

    assert abs(size(0.05)) < abs(size(0.5)) < abs(size(0.95))


@pytest.mark.parametrize("kind", (DELAYED_COMMANDS, DELAYED_SENSORS, SKEW), ids=lambda k: k.effect)
def test_a_clock_is_never_off_by_more_than_the_effect_can_be(kind):
    half = carrier(kind, rover_log(1, seconds=2.0))
    slow = half.with_logs(lambda log: log.with_stamps(log.columns, lambda t: 3.0 * t))
    for target in kind.targets(slow):
        ((name, size),) = kind.size(slow, target, 1.0, np.random.default_rng(5)).items()
        bounds = BY_NAME[kind.effect].parameter(name)
        assert bounds.lower <= size <= bounds.upper


def test_what_a_log_cannot_carry_is_refused_with_its_reason():
    log = rover_log(1)
    t = log.columns["command.left"].t
    varied = log.with_values(["command.left", "command.right"], lambda u: u + 0.5 * np.sin(t))
    for name, half, why in (
        ("dead_zone", rover(varied), "commands lie within"),
        ("wheel_radius_mismatch", rover(log), "limit of its own"),
        ("payload", rover(log), "no MJCF file"),
        ("sensor_mounting", arm(), "lacks pose.x"),
        ("dead_zone", arm(), "servo"),
    ):
        with pytest.raises(BadInput, match=why):
            carried_by(half, (name,))
        assert why in why_not(half)[name]
    with pytest.raises(BadInput, match="unknown kind"):
        carried_by(arm(), ("rust",))
