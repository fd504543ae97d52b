"""The controllers of a scenario on equal terms: same estimator, weights and limits; the model alone differs."""

import numpy as np

from controllers.lqr import build_lqr
from controllers.mpc import build_mpc
from controllers.settings import Limits, MpcSettings, Soft
from residual_mpc.closed_loop.compare import Contender
from residual_mpc.closed_loop.estimator import EstimatorSettings, build_filter
from residual_mpc.closed_loop.online import OnlineLearner, OnlineSettings
from residual_mpc.closed_loop.protocols import Controller
from residual_mpc.closed_loop.scenario import RunOptions
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.models.settings import Knob, Values
from residual_mpc.residual.body import BODY
from residual_mpc.residual.mlp import Mlp, initial_weights
from residual_mpc.residual.record import Residual
from scenarios.practice import ROBOT, Learned
from scenarios.scenario import DriveScenario

# What an online learner starts from, before any data: a small wheeled robot's speeds, and a tenth of them to learn
TYPICAL = np.array([0.2, 0.05, 1.0, 8.0, 8.0])  # m/s, m/s, rad/s, rad/s, rad/s
TO_LEARN = np.array([0.05, 0.02, 0.3])  # m/s, m/s, rad/s
LIMIT = 3.0  # typical inputs: a velocity that feeds back cannot run away


def contenders(scenario: DriveScenario, learned: Learned, options: RunOptions) -> dict[str, Contender]:
    """nominal, effects, network, augmented, online (with the MPC alone), oracle."""
    truth = {Knob(*where): value for where, value in scenario.withheld.items()}
    models: dict[str, tuple[Values, Residual | None]] = {
        "nominal": ({}, None),
        "effects": (learned.effects, None),
        "network": ({}, learned.network),
        "augmented": (learned.effects, learned.rest),
        "oracle": (truth, None),
    }
    out = {name: _contender(scenario, *model, options) for name, model in models.items()}
    if options.controller == "mpc":
        blank = _contender(scenario, {}, untaught(options.seed, scenario.dt), options)
        settings = OnlineSettings()
        online = Contender(blank.estimator, blank.controller, lambda: OnlineLearner(blank.estimator, settings))
        out = {**{n: c for n, c in out.items() if n != "oracle"}, "online": online, "oracle": out["oracle"]}
    return out


def untaught(seed: int, dt: float) -> Residual:
    """A network of zero output, as it is before any data."""
    net = Mlp(5)
    inputs = (*(f"previous.{n}" for n in BODY), "command.left", "command.right")
    theta = initial_weights(net, np.random.default_rng(seed))
    return Residual(net, theta, inputs, BODY, np.zeros(5), TYPICAL, TO_LEARN, "body", dt, ROBOT.name, LIMIT)


def seeds_of(options: RunOptions) -> tuple[int, ...]:
    """The seeds of the plants; the same for every controller."""
    return tuple(range(options.seed, options.seed + options.seeds))


def _contender(scenario: DriveScenario, effects: Values, residual: Residual | None, options: RunOptions) -> Contender:
    model = augment(ROBOT, effects, residual, Build(scenario.dt))
    return Contender(build_filter(model, EstimatorSettings()), _controller(scenario, model, options))


def _controller(scenario: DriveScenario, model: Augmented, options: RunOptions) -> Controller:
    soft = tuple(Soft(channel, lower, upper) for channel, lower, upper in scenario.limits)
    settings = MpcSettings(limits=Limits(soft=soft), cruise=scenario.speed, budget=options.budget)
    if options.controller == "mpc":
        return build_mpc(model, settings)
    samples = round(scenario.seconds / scenario.dt) + 1 + settings.horizon
    path = scenario.reference().path(scenario.dt * np.arange(samples))
    return build_lqr(model, path, settings)
