"""The account of the robot that both sets share: the effects that a diagnosis of the runs before names."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, prepare
from residual_mpc.diagnosis.phases.search import search_effects
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values


def account_of(
    before: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    tunable: Sequence[str],
    options: Options,
    kept: Sequence[KeptBack],
    rng: np.random.Generator,
    progress: Progress,
) -> Values:
    """The values of the set that the search finds on the runs before; kept: what no fit may see."""
    held = tuple(k for k in kept if k.run in {r.name for r in before})
    held_out = Options(
        horizon=options.horizon,
        only=options.only,
        without=options.without,
        without_because=options.without_because,
        held_out=held,
        search_steps=options.search_steps,
        settings=options.settings,
    )
    given = DiagnosisInput(tuple(before), tuple(robots), noise, tuple(tunable), held_out)
    prepared = prepare(given, rng, lambda stage, done: None)
    searched = search_effects(prepared, rng, progress)
    return searched.rivalry.fit.values
