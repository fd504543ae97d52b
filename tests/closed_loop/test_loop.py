"""The loop on plants that are known exactly: bit for bit again, as a run, replayed, compared, learned from."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from model_plant import Eight, ModelSimulator

from controllers.mpc import Mpc, build_mpc
from controllers.settings import MpcSettings
from plants.diff_drive import DiffDrive
from residual_mpc.closed_loop import (
    ControlStack,
    EstimatorSettings,
    LoopSettings,
    build_filter,
    compare,
    run_closed_loop,
)
from residual_mpc.closed_loop.compare import document, recovered
from residual_mpc.closed_loop.metrics import converged_after, figures, h2_norm, path_error
from residual_mpc.closed_loop.online import OnlineLearner, OnlineSettings
from residual_mpc.export import Build, augment
from residual_mpc.learning.forms.body import BODY
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob

DT = 0.05
ROBOT = DiffDrive("rover", 0.033, 0.16)
TRUE = {Knob("actuator_lag", None, "time_constant"): 0.2, Knob("track_width", None, "scale"): 1.25}
NOISE = (0.002, 0.002, 0.006)
LOOP = LoopSettings(8.0, DT)


def control_stack(effects, residual=None, learner=None, **build):
    model = augment(ROBOT, effects, residual, Build(DT, **build))
    settings = MpcSettings(compile=False)
    return ControlStack(build_filter(model, EstimatorSettings(), compile=False), build_mpc(model, settings), learner)


def drive(simulator, c, seed=0, loop=LOOP):
    learner = None if c.learner is None else c.learner()
    rng = np.random.default_rng(seed)
    return run_closed_loop(simulator, c.estimator, c.controller, Eight(), loop, rng, "run", learner)


@pytest.fixture(scope="module")
def plant():
    return ModelSimulator(augment(ROBOT, TRUE, None, Build(DT)), NOISE)


@pytest.fixture(scope="module")
def knows():
    return control_stack(TRUE)


def test_the_same_seed_gives_the_same_episode_bit_for_bit(plant, knows):
    first, second, other = drive(plant, knows), drive(plant, knows), drive(plant, knows, seed=1)
    np.testing.assert_array_equal(first.command, second.command)
    np.testing.assert_array_equal(first.truth, second.truth)
    assert np.abs(first.truth - other.truth).max() > 1e-4


class Busy:
    """A solver on a machine that is busy for 70 ms of its 50 ms in every fifth sample from `first` on."""

    def __init__(self, inner, first):
        self.inner, self.count = inner, first

    def solve(self, qp):
        self.count += 1
        if self.count % 5 == 0:
            time.sleep(0.07)
        return self.inner.solve(qp)


@dataclass(frozen=True)
class Hindered:
    """A controller whose solver is Busy."""

    inner: Mpc
    first: int = 0

    @property
    def horizon(self):
        return self.inner.horizon

    def init(self):
        state = self.inner.init()
        return replace(state, engine=Busy(state.engine, self.first))

    def step(self, state, x, reference):
        return self.inner.step(state, x, reference)

    def with_parameters(self, p):
        return Hindered(self.inner.with_parameters(p), self.first)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_a_busy_machine_changes_no_episode_and_is_counted(plant, knows, solver):
    loop = LoopSettings(2.0, DT)
    mpc = build_mpc(knows.controller.model, replace(knows.controller.settings, solver=solver))
    assert mpc.settings.budget == math.inf, "unless somebody asks, no clock decides"
    idle, *busy = (
        drive(plant, ControlStack(knows.estimator, c), loop=loop) for c in (mpc, Hindered(mpc), Hindered(mpc, 2))
    )
    for e in busy:
        np.testing.assert_array_equal(e.command, idle.command)
        np.testing.assert_array_equal(e.truth, idle.truth)
        assert e.outcomes == idle.outcomes
        assert figures(e).late >= 8 and figures(e).failures == figures(idle).failures


def test_a_budget_that_was_asked_for_acts(plant, knows):
    loop = LoopSettings(2.0, DT)
    mpc = build_mpc(knows.controller.model, replace(knows.controller.settings, budget=0.065))
    free, held = (drive(plant, ControlStack(knows.estimator, Hindered(m)), loop=loop) for m in (knows.controller, mpc))
    assert figures(held).failures >= 8 > figures(free).failures
    assert np.abs(held.command - free.command).max() > 0.0


def test_a_perfect_model_without_noise_predicts_what_happens(knows):
    exact = ModelSimulator(augment(ROBOT, TRUE, None, Build(DT)))
    e = drive(exact, knows)
    np.testing.assert_allclose(e.believed, e.truth, atol=1e-12)
    assert h2_norm(e).max() < 1e-9
    assert path_error(e)[40:].max() < 0.01
    assert set(e.outcomes) == {"solved"}


def test_an_episode_is_a_run_that_is_saved_read_and_replayed(plant, knows, tmp_path):
    e = drive(plant, knows)
    e.table().to_csv(tmp_path / "episode.csv", index=False)
    (run,) = read_runs([tmp_path / "episode.csv"], RobotFile("rover", "diff_drive")).runs
    np.testing.assert_array_equal(run.t, e.t)
    np.testing.assert_array_equal(run.columns["command.left"], e.command[:, 0])
    np.testing.assert_array_equal(run.columns["pose.theta"], e.measured["pose.theta"])
    assert not any(c.startswith("truth") for c in run.columns), "no robot logs the truth"
    x = plant.model.start(dict(zip(e.poses, e.truth[0], strict=True)))
    for k in range(len(e.t) - 1):  # the logged commands, sent again, give the same motion
        x = plant.model.numpy_step(x, np.array([run.columns["command.left"][k], run.columns["command.right"][k]]))
        np.testing.assert_array_equal(x[:3], e.truth[k + 1])


def test_what_the_model_lacks_costs_tracking_and_the_diagnosis_gets_it_back(plant, knows):
    close = {k: 1.02 * v for k, v in TRUE.items()}
    rivals = {"nominal": control_stack({}), "effects": control_stack(close), "oracle": knows}
    result = document(compare(plant, rivals, Eight(), LOOP, [0, 1, 2]), "eight", "rover", np.random.default_rng(0))
    c = result["controllers"]
    assert c["nominal"]["tracking_rmse"] > 2 * c["oracle"]["tracking_rmse"]
    assert c["nominal"]["h2_norm"] > 3 * c["effects"]["h2_norm"]
    share = result["recovered"]["effects"]
    assert 0.8 < share["ci95"][0] <= share["value"] <= share["ci95"][1] < 1.2
    assert result["seeds"] == 3 and set(c["oracle"]) >= {"tracking_rmse", "h2_norm", "solve_ms", "failures"}


class Rock:
    """Forth and back on a line, which begins gently: every wheel turns round, through its play and dead zone."""

    def path(self, t):
        t = np.where(t < 2.0, t * t / 4.0, t - 1.0)
        return np.stack([0.2 * np.sin(1.2 * t), 0.0 * t, 0.0 * t], axis=-1)


@pytest.mark.parametrize("path", [Rock(), Eight()], ids=["rock", "eight"])
@pytest.mark.parametrize(
    ("effect", "parameter", "value", "share"),
    [("dead_zone", "width", 2.5, 0.5), ("backlash", "gap", 1.0, 0.6), ("saturation", "limit", 5.0, 0.95)],
)
def test_a_model_that_knows_what_swallows_commands_drives_better_by_it(path, effect, parameter, value, share):
    """By the exact derivatives inside a dead zone or play a controller would wait there for ever."""
    true = {Knob(effect, None, parameter): value}
    rivals = {"nominal": control_stack({}), "effects": control_stack({k: 1.05 * v for k, v in true.items()})}
    simulator = ModelSimulator(augment(ROBOT, true, None, Build(DT)), NOISE)
    result = compare(simulator, {**rivals, "oracle": control_stack(true)}, path, LOOP, [0, 1])
    c = document(result, "path", "rover", np.random.default_rng(0))["controllers"]
    assert c["effects"]["tracking_rmse"] < share * c["nominal"]["tracking_rmse"]
    assert c["effects"]["h2_norm"] < 0.7 * c["nominal"]["h2_norm"]


def test_recovered_is_the_contracts_figure():
    nominal, mine, oracle = np.array([1.0, 1.2]), np.array([0.4, 0.6]), np.array([0.2, 0.4])
    share = recovered(nominal, mine, oracle, np.random.default_rng(0))
    assert share is not None and share["value"] == pytest.approx(0.6 / 0.8)
    assert recovered(nominal, mine, 0.97 * nominal, np.random.default_rng(0)) is None


def test_the_estimator_shrugs_off_spikes_and_losses(knows):
    rough = ModelSimulator(augment(ROBOT, TRUE, None, Build(DT)), NOISE, spikes=0.05, lost=0.1)
    e = drive(rough, knows)
    assert path_error(e)[40:].max() < 0.02
    assert np.abs(e.believed - e.truth)[:, :2].max() < 0.02, "a spike is 1 m"


def test_a_late_sensor_is_allowed_for():
    late = 0.13  # s, between two and three samples
    true = augment(ROBOT, TRUE, None, Build(DT))

    class Late(ModelSimulator):
        def start(self, rng, at):
            plant = super().start(rng, at)
            history = [np.array(list(at.values()))]

            def measure():
                history.append(plant.x[:3].copy())
                place = len(history) - 2 - late / DT
                low = int(np.floor(max(place, 0.0)))
                part = max(place, 0.0) - low
                y = (1 - part) * history[low + 1] + part * history[min(low + 2, len(history) - 1)]
                return dict(zip(self.channels, y.tolist(), strict=True))

            plant.measure = measure
            return plant

    told = drive(Late(true), control_stack({**TRUE, Knob("sensor_delay", None, "delay"): late}))
    untold = drive(Late(true), control_stack(TRUE))
    assert np.abs(told.believed - told.truth).max() < 0.01
    assert np.abs(untold.believed - untold.truth).max() > 2 * np.abs(told.believed - told.truth).max()
    assert path_error(told).max() < path_error(untold).max()


def test_offset_free_tracking_forgives_a_constant_error():
    weak = {Knob("actuator_gain", None, "gain"): 0.7}
    plant = ModelSimulator(augment(ROBOT, weak, None, Build(DT)))
    plain, free = drive(plant, control_stack({})), drive(plant, control_stack({}, disturbances=True))
    off = [np.sqrt(np.mean(path_error(e)[60:] ** 2)) for e in (plain, free)]
    assert off[1] < 0.6 * off[0]


def untaught():
    net = Mlp(5)
    theta = initial_weights(net, np.random.default_rng(0))
    inputs = (*(f"previous.{n}" for n in BODY), "command.left", "command.right")
    scale, out = np.array([0.2, 0.05, 1.0, 8.0, 8.0]), np.array([0.05, 0.02, 0.3])
    return Residual(net, theta, inputs, BODY, np.zeros(5), scale, out, "body", DT, "rover", 3.0)


def test_learning_while_driving_lowers_the_h2_norm_and_the_tracking_error():
    geometry = {Knob("track_width", None, "scale"): 1.3, Knob("wheel_radius_mismatch", None, "ratio"): 0.93}
    plant = ModelSimulator(augment(ROBOT, geometry, None, Build(DT)), NOISE)
    blank = control_stack({}, untaught())
    online = control_stack({}, untaught(), lambda: OnlineLearner(blank.estimator, OnlineSettings()))
    loop = LoopSettings(30.0, DT)
    still, learned = drive(plant, control_stack({}), loop=loop), drive(plant, online, loop=loop)
    figure = figures(learned)
    assert figure.h2_last < 0.4 * figures(still).h2_last
    assert figure.converged_after is not None
    half = len(still.t) // 2
    assert path_error(learned)[half:].mean() < 0.7 * path_error(still)[half:].mean()


def test_what_a_network_cannot_follow_is_not_handed_to_the_controller():
    late = ModelSimulator(augment(ROBOT, {Knob("command_delay", None, "delay"): 0.15}, None, Build(DT)), NOISE)
    blank = control_stack({}, untaught())
    online = control_stack({}, untaught(), lambda: OnlineLearner(blank.estimator, OnlineSettings()))
    loop = LoopSettings(20.0, DT)
    still, learned = drive(late, control_stack({}), loop=loop), drive(late, online, loop=loop)
    assert path_error(learned).mean() < 1.1 * path_error(still).mean()


def test_converged_after_by_hand():
    t = np.arange(0.0, 30.0, 0.5)
    mean = np.where(t < 15.0, 1.0, 0.2)
    assert converged_after(t, mean) == 15.0
    assert converged_after(t, np.ones_like(t)) is None


def test_an_estimate_that_has_run_away_begins_anew_at_the_reading(knows):
    """As that of an arm's model without joint stops does, where the arm stands at one."""
    filter_ = knows.estimator
    belief = filter_.init({"pose.x": 1.0})
    reading = {"pose.x": 1.2, "pose.y": np.nan, "pose.theta": 0.3}
    for lost in (replace(belief, P=np.full_like(belief.P, 1e200)), replace(belief, x=np.full_like(belief.x, np.nan))):
        x, after = filter_.step(lost, np.zeros(2), reading)
        assert np.isfinite(after.P).all() and np.abs(after.P).max() < 1.0
        np.testing.assert_allclose(x[filter_.poses], [1.2, 0.0, 0.3], atol=1e-6)
