"""The controllers of a scenario on equal terms: same estimator, weights and limits; the model alone differs."""

from dataclasses import replace

import numpy as np

from controllers.lqr import build_lqr
from controllers.mpc import build_mpc
from controllers.settings import Soft
from residual_mpc.closed_loop.compare import Contender
from residual_mpc.closed_loop.estimator import build_filter
from residual_mpc.closed_loop.online import OnlineLearner
from residual_mpc.closed_loop.protocols import Controller
from residual_mpc.closed_loop.scenario import RunOptions
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Knob, Values
from scenarios.kit import Kit
from scenarios.practice import Learned
from scenarios.scenario import ClosedLoop, beginning


def contenders(scenario: ClosedLoop, kit: Kit, learned: Learned, options: RunOptions) -> dict[str, Contender]:
    """nominal, effects, network, augmented, online (with the MPC alone), oracle."""
    truth = {Knob(*where): value for where, value in scenario.withheld.items()}
    models: dict[str, tuple[Values, Residual | None]] = {
        "nominal": ({}, None),
        "effects": (learned.effects, None),
        "network": ({}, learned.network),
        "augmented": (learned.effects, learned.rest),
        "oracle": (truth, None),
    }
    out = {name: _contender(scenario, kit, *model, options) for name, model in models.items()}
    if options.controller == "mpc":
        blank = _contender(scenario, kit, {}, kit.untaught(options.seed, scenario.dt), options)
        online = Contender(blank.estimator, blank.controller, lambda: OnlineLearner(blank.estimator, kit.online))
        out = {**{n: c for n, c in out.items() if n != "oracle"}, "online": online, "oracle": out["oracle"]}
    return out


def seeds_of(options: RunOptions) -> tuple[int, ...]:
    """The seeds of the plants; the same for every controller."""
    return tuple(range(options.seed, options.seed + options.seeds))


def _contender(
    scenario: ClosedLoop, kit: Kit, effects: Values, residual: Residual | None, options: RunOptions
) -> Contender:
    model = augment(kit.robot, effects, residual, Build(scenario.dt))
    return Contender(build_filter(model, kit.estimator), _controller(scenario, kit, model, options))


def _controller(scenario: ClosedLoop, kit: Kit, model: Augmented, options: RunOptions) -> Controller:
    soft = tuple(Soft(channel, lower, upper) for channel, lower, upper in scenario.limits)
    limits = replace(kit.control.limits, soft=soft)
    settings = replace(kit.control, limits=limits, cruise=scenario.speed, budget=options.budget)
    if options.controller == "mpc":
        return build_mpc(model, settings)
    samples = round(scenario.seconds / scenario.dt) + 1 + settings.horizon
    reference = scenario.reference()
    return build_lqr(model, reference.path(scenario.dt * np.arange(samples)), settings, beginning(reference))
