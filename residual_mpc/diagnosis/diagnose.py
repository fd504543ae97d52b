"""The whole diagnosis: prepare, search, refine, validate, describe."""

from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.describe import describe
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, prepare
from residual_mpc.diagnosis.phases.refine import refine
from residual_mpc.diagnosis.phases.search import search_effects
from residual_mpc.diagnosis.phases.validate import validate
from residual_mpc.diagnosis.remainder.learning import Learner, RidgeLearner
from residual_mpc.diagnosis.results.records import Diagnosis, DiagnosisResult
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot


def diagnose(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: dict[str, float],
    tunable: Sequence[str],
    options: Options,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
    learners: Sequence[Learner] = (RidgeLearner(),),
    answered: Callable[[Diagnosis], None] = lambda diagnosis: None,
) -> DiagnosisResult:
    """robots[i] is the nominal model of runs[i]; learners: those that try to learn what is left; answered: told the
    answer as soon as it stands, before what is left is described.

    Raises BadInput where nothing can be compared.
    """
    given = DiagnosisInput(tuple(runs), tuple(robots), noise, tuple(tunable), options)
    with threadpool_limits(1, "blas"):  # matrices of this size lose by a second thread
        prepared = prepare(given, rng, progress)
        searched = search_effects(prepared, rng, progress)
        refined = refine(searched, rng, progress)
        validated = validate(refined, rng, progress)
        return describe(validated, learners, rng, progress, answered)
