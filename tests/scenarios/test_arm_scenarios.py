"""The arm's scenarios: motions within reach, twins that differ by what is withheld, a network that helps to predict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.mpc import build_mpc
from plants.scaler_arm.kinematics.forward import forward_kinematics
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER
from plants.scaler_arm.kinematics.inverse import inverse_kinematics
from residual_mpc.closed_loop import LoopSettings, build_filter, run_closed_loop
from residual_mpc.closed_loop.compare import ControlStack, compare, document
from residual_mpc.closed_loop.metrics import figures, h2_norm, path_error
from residual_mpc.closed_loop.online import OnlineLearner
from residual_mpc.closed_loop.scenario import RunOptions, find_scenario
from residual_mpc.closed_loop.stacks import stack_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.export import Build, augment
from residual_mpc.models.settings import Knob
from scenarios.arm import DT, ONLINE, arm_twin, blank_network, circle_line, servo_arm, train_network
from scenarios.closed_loop.controllers import _controller
from scenarios.closed_loop.task import start_reading

NAMES = ("arm_circle_line", "arm_circle_z")


def drive(setup, simulator, effects, residual=None, seconds=2.0, learner=False, reference=None):
    """An episode of the compiled-free MPC on a twin."""
    model = augment(setup.robot, effects, residual, Build(DT))
    estimator = build_filter(model, setup.estimator, compile=False)
    controller = build_mpc(model, replace(setup.control, compile=False))
    reference = reference or circle_line()
    online = OnlineLearner(estimator, ONLINE) if learner else None
    return run_closed_loop(
        simulator, estimator, controller, reference, LoopSettings(seconds, DT), np.random.default_rng(0), "episode",
        online, start_reading(reference),
    )  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_every_motion_is_within_reach_and_every_effect_is_known(name):
    s = find_scenario(name).task
    home = forward_kinematics(np.array([0.0, -0.1, 0.3, 0.35, 0.412, 0.0]))[1]
    for make in (s.reference, *(m for m, _ in s.training_motions)):
        path = make().path(DT * np.arange(1100))
        q = inverse_kinematics(path[:, :3], np.broadcast_to(home, (len(path), 3, 3)))  # raises beyond a joint limit
        assert np.abs(np.diff(q, axis=0)).max() < SCALER.speed * DT
        assert np.abs(np.diff(path, axis=0))[0].max() < 1e-4, "it starts from rest"
        begin = np.array([make().begin()[f"position.{m}"] for m in MOTORS])
        np.testing.assert_allclose(begin, q[0], atol=1e-9)
    for effect, _, parameter in s.withheld:
        BY_NAME[effect].parameter(parameter)


@pytest.mark.parametrize("name", NAMES)
def test_knowing_what_is_withheld_drives_better(name):
    """Nominal and oracle alone, on the twin in its engine: the rest of the story is told by the slow test."""
    s = find_scenario(name).task
    setup, simulator = s.setup(), s.simulator()
    truth = {Knob(*where): value for where, value in s.withheld.items()}
    errors = [path_error(drive(setup, simulator, e, seconds=2.5, reference=s.reference())) for e in ({}, truth)]
    nominal, oracle = (np.sqrt(np.mean(e[50:] ** 2)) for e in errors)
    assert oracle < 2.5e-4 and oracle < 0.3 * nominal


def test_an_episode_of_the_arm_is_a_run_and_tracks_the_tool():
    setup = servo_arm()
    withheld = find_scenario("arm_circle_line").task.simulator().inner.withheld
    e = drive(setup, arm_twin("mujoco", withheld), {}, seconds=0.5)
    assert e.poses[:3] == ("tool.x", "tool.y", "tool.z") and e.truth.shape == (51, 6)
    run = e.run()
    assert {"command.f", "position.f", "velocity.f", "tool.x"} <= set(run.columns)
    q = np.stack([run.columns[f"position.{m}"] for m in MOTORS], axis=-1)
    np.testing.assert_allclose(forward_kinematics(q)[0], e.truth[:, :3], atol=1e-3)  # up to the encoders' noise
    f = figures(e)
    assert np.isfinite(f.heading_rmse) and f.tracking_max < 0.01
    np.testing.assert_allclose(h2_norm(e), np.linalg.norm((e.happened - e.predicted)[:-1, :3], axis=1))


def test_the_learner_learns_from_the_velocities_that_the_h2_norm_judges():
    """Each predicted from the joints at its own sample, eq. (fk_prop): a window is no rollout from its beginning, where
    joints that nothing corrects would go their own way.
    """
    setup, blank = servo_arm(), blank_network(0, DT)
    some = blank.with_theta(0.3 * np.random.default_rng(1).standard_normal(blank.net.size))
    model, bare = (augment(setup.robot, {}, r, Build(DT)) for r in (some, None))
    estimator = build_filter(model, setup.estimator, compile=False)
    rows = []
    episode = run_closed_loop(
        find_scenario("arm_circle_line").task.simulator(), estimator,
        build_mpc(model, replace(setup.control, compile=False)),
        circle_line(), LoopSettings(0.2, DT), np.random.default_rng(0), "episode",
        lambda x, u, pose: rows.append((x, u)), start_reading(circle_line()),
    )  # fmt: skip
    x, u = (np.array([row[i] for row in rows[:-1]]) for i in (0, 1))
    predicted = episode.predicted[:-1, :3]
    window = stack_of(model).driven(estimator.drive, x, u)
    np.testing.assert_allclose(np.diff(window.positions, axis=0) / DT, predicted, atol=1e-12)
    q = x[:, : bare.nx]
    learned = predicted - (bare.outputs(bare.numpy_step(q, u)) - bare.outputs(q))[:, :3] / DT
    assert np.abs(learned).max() > 1e-3
    np.testing.assert_allclose(learned, some(window.z), atol=1e-12)


@pytest.mark.slow
def test_a_network_taught_in_task_space_predicts_better_and_online_it_learns_too():
    """Against the nominal model at the same times on the same seed: against its own beginning a learner that is quick
    would look like one that learns nothing.
    """
    s = find_scenario("arm_circle_line").task
    setup, simulator = s.setup(), s.simulator()
    nominal = drive(setup, simulator, {}, seconds=8.5)
    network = train_network(setup.robot, (nominal.run(),), {}, blank_network(0, DT), 0)
    assert np.abs(network(np.full(6, 0.2))).max() > 1e-4
    with_it = drive(setup, simulator, {}, network, seconds=4.0)
    still = h2_norm(nominal)
    assert np.mean(h2_norm(with_it)) < 0.25 * np.mean(still[:400])
    assert figures(with_it).tracking_rmse < 0.4 * figures(nominal).tracking_rmse
    online = drive(setup, simulator, {}, blank_network(0, DT), seconds=8.5, learner=True)
    assert (online.believed[0] == nominal.believed[0]).all(), "the same seed begins alike"
    seconds = [np.mean(h2_norm(online)[k : k + 100]) / np.mean(still[k : k + 100]) for k in range(100, 800, 100)]
    assert max(seconds) < 0.6, "from its second second on, in every one"
    assert np.mean(h2_norm(online)[-200:]) < 0.4 * np.mean(still[-200:])
    assert figures(online).tracking_rmse < 0.6 * figures(nominal).tracking_rmse


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["mpc", "lqr"])
def test_the_arms_controllers_are_compared_on_equal_terms(controller):
    s = find_scenario("arm_circle_line").task.shorter(3.0)
    setup = s.setup()
    truth = {Knob(*where): value for where, value in s.withheld.items()}
    rivals = {}
    for name, effects in (("nominal", {}), ("oracle", truth)):
        model = augment(setup.robot, effects, None, Build(DT))
        control = _controller(s, setup, model, RunOptions(controller))
        rivals[name] = ControlStack(build_filter(model, setup.estimator), control)
    reference = s.reference()
    comparison = compare(
        s.simulator(), rivals, reference, LoopSettings(s.seconds, DT), (0, 1), at=start_reading(reference)
    )
    d = document(comparison, s.name, s.plant, np.random.default_rng(0))
    assert d["controllers"]["oracle"]["tracking_rmse"] < 0.3 * d["controllers"]["nominal"]["tracking_rmse"]
    assert d["controllers"]["oracle"]["failures"] == 0
