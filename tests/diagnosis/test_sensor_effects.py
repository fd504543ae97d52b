"""The sensors as the diagnosis simulates them: on the start state and on every sample, for many hypotheses at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run
from scipy.integrate import solve_ivp

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.outliers import with_outliers_removed
from residual_mpc.diagnosis.predict.replay import predict, predict_moved
from residual_mpc.effects.library import BY_NAME, LIBRARY
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Settings, assemble

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
SLOTS = {e.name: ROVER.slots(e.name) for e in LIBRARY}
SENSORS = ("sensor_delay", "sensor_lag", "sensor_scale", "clock_skew", "sensor_bias", "sensor_mounting")
DELAY, LAG, SCALE, BIAS, X, Y = 0.12, 0.15, 1.08, 0.2, 0.08, -0.05  # s, s, 1, rad, m, m
SKEW = 0.02  # 1


def dataset(run: Run) -> Dataset:
    return build_dataset([run], [ROVER], {"pose.x": 1e-4, "pose.y": 1e-4, "pose.theta": 1e-4})


@pytest.fixture(scope="module")
def clean() -> Run:
    return rover_run("one", {}, 8.0, rate=50.0, seed=3, noise=0.0)


def settings_of(*hypotheses: dict[tuple[str, str | None, str], float]) -> Settings:
    return assemble([{Knob(*k): v for k, v in h.items()} for h in hypotheses], SLOTS)


def error(data: Dataset, hypothesis: dict[tuple[str, str | None, str], float]) -> float:
    """Root mean square of measured minus predicted, over all channels."""
    return float(np.sqrt(np.nanmean((data.y - predict(data, settings_of(hypothesis))[0]) ** 2)))


@pytest.mark.parametrize("effect", SENSORS)
def test_at_null_nothing_changes(clean: Run, effect: str) -> None:
    data = dataset(clean)
    null = {p.name: np.full((2, len(SLOTS[effect])), p.null) for p in BY_NAME[effect].parameters}
    nominal = predict(data, Settings(2))
    np.testing.assert_array_equal(predict(data, Settings(2, {effect: null})), nominal)
    beside = {p: np.where(np.arange(2)[:, None] == 0, v, v + 0.03) for p, v in null.items()}
    np.testing.assert_array_equal(predict(data, Settings(2, {effect: beside}))[0], nominal[0])


def slowed(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A low-pass by the adaptive integrator of SciPy."""
    through = solve_ivp(
        lambda s, y: (np.interp(s, t, x) - y) / LAG, (t[0], t[-1]), x[:1], t_eval=t, max_step=0.01, rtol=1e-8
    )
    return np.asarray(through.y[0])


def logged(clean: Run, effect: str) -> Run:
    """The clean run through a faulty sensor, by its definition."""
    x, y, theta = (clean.columns[c] for c in ("pose.x", "pose.y", "pose.theta"))
    if effect == "sensor_delay":
        seen = {c: np.interp(clean.t - DELAY, clean.t, clean.columns[c]) for c in ("pose.x", "pose.y", "pose.theta")}
    elif effect == "sensor_lag":
        seen = {c: slowed(clean.t, clean.columns[c]) for c in ("pose.x", "pose.y", "pose.theta")}
    elif effect in ("clock_skew", "clock_skew of a slow clock"):
        rate = -SKEW if effect.endswith("slow clock") else SKEW
        pose = ("pose.x", "pose.y", "pose.theta")
        seen = {c: np.interp(clean.t / (1 + rate), clean.t, clean.columns[c]) for c in pose}
    elif effect == "sensor_scale":
        seen = {"pose.theta": theta[0] + SCALE * (theta - theta[0])}
    elif effect == "sensor_bias":
        seen = {"pose.theta": theta + BIAS}
    else:
        c, s = np.cos(theta), np.sin(theta)
        seen = {"pose.x": x + c * X - s * Y, "pose.y": y + s * X + c * Y}
    return Run("one", clean.t, {**clean.columns, **seen})


@pytest.mark.parametrize(
    ("effect", "truth"),
    [
        ("sensor_delay", {("sensor_delay", None, "delay"): DELAY}),
        ("sensor_lag", {("sensor_lag", None, "time_constant"): LAG}),
        ("sensor_scale", {("sensor_scale", "pose.theta", "scale"): SCALE}),
        ("clock_skew", {("clock_skew", None, "rate"): SKEW}),
        ("clock_skew of a slow clock", {("clock_skew", None, "rate"): -SKEW}),
        ("sensor_bias", {("sensor_bias", "pose.theta", "bias"): BIAS}),
        ("sensor_mounting", {("sensor_mounting", None, "x"): X, ("sensor_mounting", None, "y"): Y}),
    ],
)
def test_the_true_fault_explains_the_log(
    clean: Run, effect: str, truth: dict[tuple[str, str | None, str], float]
) -> None:
    data = dataset(logged(clean, effect))
    if effect == "sensor_delay":  # before it, the sensor had nothing to report
        data = data.take(data.start > 0.5)
    if effect.endswith("slow clock"):  # after the last stamp, what it would show is not in the clean run
        data = data.take(data.start < 7.0)
    left, nominal = error(data, truth), error(data, {})
    assert nominal > 3e-3 and left < 0.05 * nominal
    null = 1.0 if effect == "sensor_scale" else 0.0
    for off in (0.9, 1.1):
        assert error(data, {k: null + off * (v - null) for k, v in truth.items()}) > 2 * left


def test_hypotheses_and_windows_do_not_mix(clean: Run) -> None:
    data = dataset(clean)
    hypotheses = (
        {},
        {("sensor_delay", None, "delay"): 0.07, ("command_delay", "left", "delay"): 0.03},
        {("sensor_lag", None, "time_constant"): 0.1, ("sensor_delay", None, "delay"): 0.05},
        {("sensor_lag", None, "time_constant"): 0.1, ("sensor_mounting", None, "x"): 0.1},
        {("clock_skew", None, "rate"): 0.01, ("sensor_delay", None, "delay"): 0.05},
        {("clock_skew", None, "rate"): -0.02, ("sensor_lag", None, "time_constant"): 0.1},
        {("sensor_bias", "pose.theta", "bias"): 0.1, ("lateral_slip", None, "coefficient"): 0.2},
        {("sensor_mounting", None, "x"): 0.1, ("slope", None, "rate"): 0.05, ("slope", None, "heading"): 1.0},
    )
    whole = predict(data, settings_of(*hypotheses))
    assert whole.shape == (len(hypotheses), data.count, *data.y.shape[1:])
    for h, hypothesis in enumerate(hypotheses):
        np.testing.assert_allclose(whole[h], predict(data, settings_of(hypothesis))[0], rtol=0, atol=1e-12)
    few = data.take(np.arange(data.count) % 3 == 1)
    np.testing.assert_allclose(predict(few, settings_of(*hypotheses)), whole[:, 1::3], rtol=0, atol=1e-12)


def test_flagged_samples_are_taken_out_of_starts_and_of_the_comparison(clean: Run) -> None:
    data = dataset(clean)
    spoiled = {c: y.copy() for c, y in clean.columns.items()}
    at = np.array([50, 51, 130])  # the second window's start among them
    spoiled["pose.x"][at] += 3.0
    bad = dataset(Run("one", clean.t, spoiled))
    flagged = np.zeros(len(clean.t), dtype=bool)
    flagged[at] = True
    mended = with_outliers_removed(bad, {(0, "pose.x"): flagged})
    k = data.channels.index("pose.x")
    assert np.isnan(mended.y[1, :2, k]).all() and np.isfinite(mended.y[1, 2:, k]).all()
    right, wrong = predict(data, Settings(1)), predict(bad, Settings(1))
    assert np.nanmax(np.abs(wrong - right)) > 1.0
    np.testing.assert_allclose(predict(mended, Settings(1)), right, atol=1e-3)


def test_starts_are_moved_one_by_one(clean: Run) -> None:
    """In one batch, each by what was asked of it, and as it would be moved alone."""
    data = dataset(clean)
    size = np.linspace(0.1, 0.25, data.count)
    still, x, theta = predict_moved(data, Settings(1), [{}, {"pose.x": size}, {"pose.theta": 0.1 + 0.0 * size}])
    np.testing.assert_array_equal(still, predict(data, Settings(1))[0])
    k = data.channels.index("pose.x")
    moved = x - still
    expected = np.where(np.isfinite(moved[..., k]), size[:, None], np.nan)
    np.testing.assert_allclose(moved[..., k], expected, atol=1e-12)
    assert np.nanmax(np.abs(np.delete(moved, k, axis=-1))) == 0.0
    np.testing.assert_array_equal(theta, predict_moved(data, Settings(1), [{"pose.theta": 0.1 + 0.0 * size}])[0])
    assert np.nanmax(np.abs(theta - still)) > 0.09


def test_moved_starts_keep_the_values_of_the_later_runs(clean: Run) -> None:
    data = dataset(clean)
    data = replace(data, blocks=tuple(replace(b, group=1) for b in data.blocks))
    gain = {"gain": np.full((1, 2), 0.6)}
    changed = Settings(1, others=(Settings(1, {"actuator_gain": gain}),))
    still, moved = predict_moved(data, changed, [{}, {"pose.x": np.full(data.count, 0.25)}])
    np.testing.assert_array_equal(still, predict(data, changed)[0])
    assert np.nanmax(np.abs(still - predict(data, Settings(1))[0])) > 0.05
    assert np.nanmax(moved - still) == pytest.approx(0.25)


def test_a_memory_moves_with_its_channel_unless_told(clean: Run) -> None:
    data = dataset(clean)
    lagging = settings_of({("sensor_lag", None, "time_constant"): 0.2})
    size = np.full(data.count, 0.25)
    still, both, state = predict_moved(
        data, lagging, [{}, {"pose.x": size, "memory.pose.x": size}, {"pose.x": size, "memory.pose.x": 0.0 * size}]
    )
    k = data.channels.index("pose.x")
    for others in ([], [{"memory.pose.x": size}]):
        alone = predict_moved(data, lagging, [{"pose.x": size}, *others])[0]
        np.testing.assert_array_equal(alone, both)
    begun, ended = (np.nanmax(np.abs((moved - still)[:, 0, k])) for moved in (state, both))
    assert begun < 0.1 * ended and ended == pytest.approx(0.25)


def test_a_delay_of_the_pose_leaves_the_encoders_alone() -> None:
    """Whatever part of a step the delay is: the replay begins earlier, and what the encoders saw stays where it was."""
    run = rover_run("stairs", {}, 6.0, rate=30.0, seed=4, noise=0.0)
    before = {f"velocity.{w}": np.roll(run.columns[f"command.{w}"], 1) for w in ("left", "right")}  # held since then
    data = dataset(Run("stairs", run.t, {**run.columns, **before}))
    encoders = [i for i, c in enumerate(data.channels) if c.startswith("velocity.")]
    delays = [0.1, 0.1021, 0.1045, 0.1083]
    predicted = predict(data, settings_of({}, *({("sensor_delay", None, "delay"): d} for d in delays)))
    seen = predicted[:, data.start > 0.3][..., encoders]  # before the first stamp nothing is known
    assert len(encoders) == 2
    np.testing.assert_allclose(seen[1:], np.broadcast_to(seen[0], seen[1:].shape), atol=1e-9)
