"""The account, the model errors that both sets share: the effects that a diagnosis of the runs before names."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.comparison.settings import AccountSettings
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, prepare
from residual_mpc.diagnosis.phases.search import search_headline
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values


def account_of(
    before: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    tunable: Sequence[str],
    options: Options,
    settings: AccountSettings,
    rng: np.random.Generator,
    progress: Progress,
) -> Values:
    """Parameter values of the effects that the search finds on the runs before.

    Unlike in a diagnosis, an effect counts even if it is no larger than usual differences: its errors depend on the
    motions, and what makes the runs of a set differ hides changes. A needless effect costs little.
    """
    results = options.settings
    search = replace(
        results.search,
        largest=settings.largest,
        shortlist=settings.shortlist,
        finalists=settings.finalists,
        fit=_without_small_differences(results.search.fit),
        beam=1,
        steps=replace(results.search.steps, much=1.0),
    )
    cheaper = replace(
        options,
        held_out=(),
        search_steps=settings.steps if robots[0].step else settings.steps_of_equations,
        settings=replace(results, remainder=replace(results.remainder, search=search)),
    )
    prepared = prepare(DiagnosisInput(tuple(before), tuple(robots), noise, tuple(tunable), cheaper), rng, _silent)
    return search_headline(prepared, rng, progress).fit.values


def _without_small_differences(fit: FitSettings) -> FitSettings:
    """The settings of a fit that marginalises no small differences in everything."""
    return replace(fit, predict=replace(fit.predict, tolerances=replace(fit.predict.tolerances, levels=(0.0,))))


def _silent(stage: str, done: float) -> None:
    """Report no progress."""
