"""Test of a diagnosis on new runs: planned to separate its explanations, or recorded after a known change."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, Prepared, prepare
from residual_mpc.diagnosis.predict.noise_floor import as_good_as_told, floor_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.step_error import within_step_error
from residual_mpc.experiment.confirmation.agreement import costs_at, expected_numbers, score, sigmas_of
from residual_mpc.experiment.confirmation.effect_tests import Quality, Scored, tested_effects
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput, with_combinations
from residual_mpc.experiment.confirmation.known_change import changed_values
from residual_mpc.experiment.confirmation.problem import FittedExplanations, fit_explanations
from residual_mpc.experiment.confirmation.records import Confirmation, ExplanationTest, NewGap
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.settings import Settings, Values

ROUNDING = 1e-6  # of a difference of scores


def confirm(
    given: ConfirmationInput,
    settings: ConfirmationSettings,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
) -> Confirmation:
    """Test a diagnosis on new runs.

    Raises BadInput if the runs contain nothing that can be compared.
    """
    with threadpool_limits(1, "blas"):
        options = replace(given.options, held_out=())
        prepared = prepare(DiagnosisInput(given.runs, given.robots, given.noise, given.tunable, options), rng, progress)
        progress("fitting each explanation to the new runs", 0.2)
        every = with_combinations(given.explanations, settings.combinations)
        given = replace(given, explanations=every)
        changed = [changed_values(e.values, given.changes) for e in given.explanations]
        begin = [{**e.values, **values} for e, values in zip(given.explanations, changed, strict=True)]
        fitted = fit_explanations(prepared, begin, settings)
        scored = _scored(given, fitted, changed, prepared, settings)
        explanations = _explanations(scored, prepared, changed)
        kept, space = scored.kept, fitted.problem.space
        nominal = {k: space.null(k) for k in space.tunables}
        progress("testing each effect", 0.6)
        refitted = space.settings([nominal, fitted.fits[kept].values])
        quality = _quality(prepared, refitted, rng, settings)
        effects = tested_effects(scored, explanations, quality)
        explanations = _among_combinations(explanations)
        progress("measuring the gap on the new runs", 0.8)
        gaps = _gaps(prepared, space.settings([nominal, changed[kept]]), rng, settings)
    return Confirmation(explanations, kept, effects, gaps, quality.whole)


def _quality(prepared: Prepared, rows: Settings, rng: np.random.Generator, settings: ConfirmationSettings) -> Quality:
    """How well the second of two models fits the new runs, beside the first one."""
    data, scales = prepared.clean, prepared.scales
    nominal, fitted = (gap_of(data, scales, data.y - p) for p in predict(data, rows))
    floor = floor_of(data, scales, rows.take(np.array([1])), rng, settings=settings.results.predict)
    whole = as_good_as_told(fitted, floor)
    return Quality(whole or fitted.total**2 <= (1.0 - settings.explains) * nominal.total**2, whole)


def _scored(
    given: ConfirmationInput,
    fitted: FittedExplanations,
    changed: Sequence[Values],
    prepared: Prepared,
    settings: ConfirmationSettings,
) -> Scored:
    blocks = blocks_of(fitted.problem.data, settings=settings.results.fit)
    phi = max(dispersion(min(fitted.fits, key=lambda f: f.cost), blocks), given.dispersion)
    each = zip(given.explanations, sigmas_of(given), strict=True)
    expected = [expected_numbers(e.values, given.changes, sigma, settings.varies) for e, sigma in each]
    at_expected = costs_at(fitted.problem, changed)
    scores = [
        score(fit, phi, numbers, cost) for fit, numbers, cost in zip(fitted.fits, expected, at_expected, strict=True)
    ]
    scores = _told_apart(scores, fitted, prepared, settings)
    open_ = [i for i, its in enumerate(scores) if its - min(scores) <= settings.beyond_doubt + ROUNDING]
    # what was diagnosed is kept unless it is excluded, and of what takes its place as much of it as may be
    kept = min(open_, key=lambda i: (len(given.explanations[i].instead_of) if i else -1, scores[i]))
    return Scored(given, fitted, phi, tuple(changed), tuple(expected), tuple(scores), kept, settings)


def _told_apart(
    scores: Sequence[float], fitted: FittedExplanations, prepared: Prepared, settings: ConfirmationSettings
) -> list[float]:
    """The scores, of which none is beyond doubt where the predictions differ from those of the best explanation by less
    than the error of the model's own time step."""
    best, most = int(np.argmin(scores)), min(scores) + settings.beyond_doubt
    doubted = [i for i, score in enumerate(scores) if score > most]
    out = list(scores)
    if doubted:
        rows = fitted.problem.space.settings([fitted.fits[i].values for i in (best, *doubted)])
        _, *alike = within_step_error(prepared.clean, prepared.scales, rows, settings.results.data)
        for i, same in zip(doubted, alike, strict=True):
            out[i] = most if same else scores[i]
    return out


def _explanations(scored: Scored, prepared: Prepared, changed: Sequence[Values]) -> tuple[ExplanationTest, ...]:
    data, scales, space = prepared.clean, prepared.scales, scored.fitted.problem.space
    lowest = min(scored.scores)
    out: list[ExplanationTest] = []
    rows = zip(scored.given.explanations, scored.fitted.fits, changed, scored.scores, strict=True)
    for e, fit, values, its in rows:
        told, refitted = (_total(data, scales, space.settings([v])) for v in (values, fit.values))
        above = its - lowest
        excluded = above > scored.settings.beyond_doubt + ROUNDING
        parts = e.parts or ((len(out),) if out else ())
        out.append(ExplanationTest(e.terms, e.instead_of, e.values, told, refitted, above, excluded, excluded, parts))
    return tuple(out)


def _among_combinations(explanations: Sequence[ExplanationTest]) -> tuple[ExplanationTest, ...]:
    """The explanations with what is said of an alternative whatever else is exchanged: it holds nowhere if every
    combination with it is excluded, too."""
    out = []
    for k, e in enumerate(explanations):
        mine = [c for c in explanations if c.combined and k in c.parts]
        above = min(c.above for c in (e, *mine))
        out.append(replace(e, above=above, nowhere=e.excluded and all(c.excluded for c in mine)))
    return tuple(out)


def _total(data: Dataset, scales: Scales, row: Settings) -> float:
    return gap_of(data, scales, data.y - predict(data, row)[0]).total


def _gaps(
    prepared: Prepared, rows: Settings, rng: np.random.Generator, settings: ConfirmationSettings
) -> tuple[NewGap, ...]:
    """rows: the nominal model, then the model under test."""
    looks = [(prepared.clean, prepared.scales), *((look.clean, look.scales) for look in prepared.longer)]
    out = []
    for data, scales in looks:
        nominal, explained = (gap_of(data, scales, data.y - p) for p in predict(data, rows))
        floor = floor_of(data, scales, rows.take(np.array([1])), rng, settings=settings.results.predict)
        out.append(
            NewGap(
                data.horizon, data.count, nominal.total, explained.total, floor.total, as_good_as_told(explained, floor)
            )
        )
    return tuple(out)
