"""The controllers of a scenario on equal terms: same estimator, weights and limits; the model alone differs."""

from dataclasses import replace

import numpy as np

from controllers.lqr import build_lqr
from controllers.mpc import build_mpc
from controllers.settings import Soft
from residual_mpc.closed_loop.compare import ControlStack
from residual_mpc.closed_loop.estimator import build_filter
from residual_mpc.closed_loop.online import OnlineLearner
from residual_mpc.closed_loop.protocols import Controller
from residual_mpc.closed_loop.scenario import RunOptions
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Knob, Values
from scenarios.closed_loop.robot_setup import RobotSetup
from scenarios.closed_loop.task import ClosedLoopTask, start_reading
from scenarios.closed_loop.training_runs import TrainingOutcome


def controllers(
    task: ClosedLoopTask, setup: RobotSetup, learned: TrainingOutcome, options: RunOptions
) -> dict[str, ControlStack]:
    """nominal, effects, network, augmented, online (with the MPC alone), oracle."""
    truth = {Knob(*where): value for where, value in task.withheld.items()}
    models: dict[str, tuple[Values, Residual | None]] = {
        "nominal": ({}, None),
        "effects": (learned.effects, None),
        "network": ({}, learned.network),
        "augmented": (learned.effects, learned.rest),
        "oracle": (truth, None),
    }
    out = {name: _stack(task, setup, *model, options) for name, model in models.items()}
    if options.controller == "mpc":
        blank = _stack(task, setup, {}, setup.blank_network(options.seed, task.dt), options)
        online = ControlStack(blank.estimator, blank.controller, lambda: OnlineLearner(blank.estimator, setup.online))
        out = {**{n: c for n, c in out.items() if n != "oracle"}, "online": online, "oracle": out["oracle"]}
    return out


def seeds_of(options: RunOptions) -> tuple[int, ...]:
    """The seeds of the plants; the same for every controller."""
    return tuple(range(options.seed, options.seed + options.seeds))


def _stack(
    task: ClosedLoopTask, setup: RobotSetup, effects: Values, residual: Residual | None, options: RunOptions
) -> ControlStack:
    model = augment(setup.robot, effects, residual, Build(task.dt))
    return ControlStack(build_filter(model, setup.estimator), _controller(task, setup, model, options))


def _controller(task: ClosedLoopTask, setup: RobotSetup, model: Augmented, options: RunOptions) -> Controller:
    soft = tuple(Soft(channel, lower, upper) for channel, lower, upper in task.limits)
    limits = replace(setup.control.limits, soft=soft)
    settings = replace(setup.control, limits=limits, cruise=task.speed, budget=options.budget)
    if options.controller == "mpc":
        return build_mpc(model, settings)
    samples = round(task.seconds / task.dt) + 1 + settings.horizon
    reference = task.reference()
    return build_lqr(model, reference.path(task.dt * np.arange(samples)), settings, start_reading(reference))
