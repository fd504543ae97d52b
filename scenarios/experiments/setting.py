"""What an experiment learns from: two recordings of one robot, the current model, and what came before."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.learning.cases import Condition
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import Samples, h2_norms, initial_memory, predict
from residual_mpc.learning.stream.updates import StreamResult, StreamSettings, learn_stream

Names = tuple[tuple[str, ...], tuple[str, ...]]  # of inputs and outputs
ASKED = 10.0  # s of data on which the paper's condition is asked


@dataclass(frozen=True, eq=False)
class Setting:
    """samples: learned from; fresh: another recording, for scoring alone; names, form: of the residual; earlier: the
    residual of the case before, None for none."""

    samples: Samples
    fresh: Samples
    names: Names
    form: str
    robot: str
    earlier: Residual | None = None


@dataclass(frozen=True, eq=False)
class SeedResult:
    """One experiment done once. condition: None where nothing came before; before, after: mean H2 norm on the fresh
    recording of the current model alone, and of all that was learned."""

    setting: Setting
    settings: StreamSettings
    condition: Condition | None
    streamed: StreamResult
    before: float
    after: float


def learn(setting: Setting, settings: StreamSettings, rng: np.random.Generator) -> SeedResult:
    """Ask the paper's condition, learn, and score on the fresh recording with the weights at rest."""
    fixed: tuple[Residual, ...] = ()
    condition = None
    if setting.earlier is not None:
        early = setting.samples.take(slice(0, round(ASKED / setting.samples.step)))
        condition = Condition(_mean((), early, settings), _mean((setting.earlier,), early, settings))
        fixed = (setting.earlier,) if condition.holds else ()
    done = learn_stream(setting.samples, setting.names, setting.form, setting.robot, settings, rng, fixed)
    before, after = (_mean(r, setting.fresh, settings) for r in ((), (*fixed, done.residual)))
    return SeedResult(setting, settings, condition, done, before, after)


def _mean(residuals: Sequence[Residual], samples: Samples, settings: StreamSettings) -> float:
    velocity = predict(residuals, samples, initial_memory(samples), settings.low_pass).velocity
    return float(np.nanmean(h2_norms(samples, velocity)))
