"""The noise floor of what was learned, under the noise that `gap` and `diagnose` state theirs with."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.outliers import find_outliers
from residual_mpc.diagnosis.fit.noise_left import noise_left
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.horizons import longer_horizons, windows_between
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, floor_of
from residual_mpc.learning.batch.evaluation import Evaluation, with_learned
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot


def stated_floor(
    evaluation: Evaluation,
    runs: tuple[Sequence[Run], Sequence[Robot], dict[str, float]],
    residual: Residual,
    held: np.ndarray,
    kept: Sequence[KeptBack],
    flagged: bool,
    rng: np.random.Generator,
) -> NoiseFloor:
    """The floor on the windows held out (W,), on all where none are. The noise is what effects and residual leave on
    the others. runs: with their models and the noise that is stated; kept: what is held out; flagged: whether samples
    that jump away are left out."""
    tuning = FitSettings()
    logged = evaluation.data
    horizons = longer_horizons(logged.runs, logged.horizon, settings=tuning.predict)
    longer = None
    if horizons:
        jumps = find_outliers(logged).flagged if flagged else {}
        known = np.zeros(len(runs[0]), dtype=bool)
        longer = windows_between(*runs, horizons[0], kept, jumps, known, settings=tuning.predict)
    seen = with_learned(logged, residual)
    noise = noise_left(
        (seen.take(~held) if held.any() else seen, evaluation.scales),
        None if longer is None else (with_learned(longer[0], residual), longer[1]),
        build_space(logged, ()),
        evaluation.settings,
        tuning,
    )
    last = seen.take(held) if held.any() else seen
    return floor_of(replace(last, noise=noise), evaluation.scales, evaluation.settings, rng, settings=tuning.predict)
