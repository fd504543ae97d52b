"""What a search sees over each horizon, and whether it is worth searching."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Gap, Scales, gap_of
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.noise_fit import with_noise
from residual_mpc.diagnosis.options import Options, PhaseSettings
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, beyond, floor_of
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import build_problem, times_longer
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.stepwise import Found


def everywhere(prepared: Prepared) -> Dataset:
    """All windows of the headline's horizon that fits may see, evenly fewer of a long log."""
    data, options = prepared.fitting, prepared.options
    return data.take(evenly(data, options.final_steps, settings=options.settings.data))


def worth_searching(data: Dataset, gap: Gap, floor: NoiseFloor, options: Options) -> bool:
    """Whether longer windows are searched for more effects: where that is cheap, or bearable with what may be a gap to
    explain, in all or in one channel. A search alarms nobody, so that less is enough for it than for the verdict where
    there are windows enough for its tests. A physics engine's steps are never cheap. Where the errors of what was found
    have grown beyond the motion itself, as they do in an arm that torques drive, other effects only fit the growth."""
    if gap.total >= options.phases.lost:
        return False
    phases, settings = options.phases, options.settings
    many = len(np.unique(blocks_of(data, settings=settings.fit))) >= phases.blocks
    equations = all(b.robot.step is None for b in data.blocks)
    if many and equations and data.cost <= phases.cheap:
        return True
    margin = settings.predict.floor.margin
    with np.errstate(invalid="ignore"):
        seen = gap.total > margin * floor.total or bool((gap.channels > margin * floor.channels).any())
    perhaps = data.count >= phases.few and seen
    return is_bearable(data, phases) and (perhaps or beyond(gap, floor, settings=settings.predict))


def is_bearable(data: Dataset, phases: PhaseSettings) -> bool:
    """Whether hypotheses are cheap enough on as many windows as tests need, or on all if there are fewer."""
    return min(phases.blocks, data.count) * data.cost // data.count <= phases.bearable


def seen_over(
    data: Dataset, scales: Scales, found: Found, prepared: Prepared, rng: np.random.Generator
) -> tuple[Dataset, Gap, NoiseFloor]:
    """Longer windows with the noise that what was found leaves there, its gap and its floor."""
    settings = prepared.options.settings
    row = prepared.space.settings([found.fit.values])
    predicted, times = predict(data, row)[0], times_longer(found.problem)
    problem = build_problem(data, prepared.space, data.sigma, times=times, settings=settings.predict)
    data = with_noise(data, problem, scales, predicted, settings=settings.fit)
    return data, gap_of(data, scales, data.y - predicted), floor_of(data, scales, row, rng, settings=settings.predict)


def other_horizons(prepared: Prepared, found: Found) -> list[Ruler]:
    """Rulers on the windows that fits may see over the horizons that nothing was found on, of those with a few."""
    settings = prepared.options.settings
    looks = [(prepared.fitting, prepared.scales), *(look.free for look in prepared.longer if look.free is not None)]
    row = prepared.space.settings([found.fit.values])
    out = []
    for data, scales in looks:
        if data.horizon == found.problem.data.horizon or data.count < settings.predict.horizons.fewest:
            continue
        some = data.take(evenly(data, prepared.options.final_steps, settings=settings.data))
        floor = floor_of(some, scales, row, np.random.default_rng(0), settings=settings.predict).total ** 2
        out.append(Ruler(PredictionCache(some, prepared.space), scales, floor, settings.data))
    return out
