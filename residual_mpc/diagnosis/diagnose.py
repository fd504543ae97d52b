"""The whole diagnosis: prepare, search, refine, validate, fit laws, describe."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.checkpoint import Checkpoint, Keeper
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.describe import describe
from residual_mpc.diagnosis.phases.early_answers import Told, first_look, unheard
from residual_mpc.diagnosis.phases.effects_in_parts import effects_in_parts
from residual_mpc.diagnosis.phases.laws import find_laws
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, Prepared, prepare
from residual_mpc.diagnosis.phases.refine import Refined, refine
from residual_mpc.diagnosis.phases.remaining import much_left
from residual_mpc.diagnosis.phases.run_sizes import sizes_by_run, with_run_sizes
from residual_mpc.diagnosis.phases.search import Searched, search_effects, search_further
from residual_mpc.diagnosis.phases.set_aside import unlike_in_fits, without
from residual_mpc.diagnosis.phases.unlikely import without_unlikely
from residual_mpc.diagnosis.phases.validate import validate
from residual_mpc.diagnosis.predict.longer_steps import longer_steps_of
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
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
    checkpoint: Checkpoint | None = None,
    told: Told = unheard,
) -> DiagnosisResult:
    """robots[i] is the nominal model of runs[i]; learners: those that try to learn what is left; answered: told the
    answer as soon as it stands, before what is left is described; checkpoint: the phases that were finished before, and
    where further ones are kept; told: what is known before the answer stands (a first look, and the best set of effects
    so far).

    Raises BadInput where nothing can be compared.
    """
    given = DiagnosisInput(tuple(runs), tuple(robots), noise, tuple(tunable), options)
    with threadpool_limits(1, "blas"):  # matrices of this size lose by a second thread
        prepared = prepare(given, rng, progress)
        keep = Keeper(checkpoint or Checkpoint(), rng, _known(prepared), _without_memory)
        if told is not unheard and (checkpoint is None or checkpoint.last is None):
            progress("taking a first look", 0.02)
            told(first_look(prepared))
        # what the search holds is not kept once it is refined
        refined = keep("refine", lambda: _refined(prepared, keep, rng, progress, told))
        judged = keep("validate", lambda: without_unlikely(refined, validate(refined, rng, progress), rng, progress))
        explained = keep("laws", lambda: find_laws(*judged, rng, progress))
        return describe(explained, learners, rng, progress, answered)


def _refined(prepared: Prepared, keep: Keeper, rng: np.random.Generator, progress: Progress, told: Told) -> Refined:
    """What the search found, fitted to the end; with effects that act in a part of the runs alone or have their own
    sizes in each run, or once more without the stretches that turn out to be unlike everything else, unless that only
    takes away what served them."""
    refined = _refined_once(keep("search", lambda: search_effects(prepared, rng, progress, keep, told)), rng, progress)
    if much_left(prepared, refined.explanation.final.values, rng):
        finish = partial(_refined_once, rng=rng, progress=progress)
        by_run = sizes_by_run(refined, progress)
        most = np.inf if by_run is None else by_run.error
        varied = effects_in_parts(prepared, refined, most, finish, rng, progress)
        if varied is None and by_run is not None:
            varied = with_run_sizes(by_run, finish, rng, progress)
        if varied is not None:
            return varied
    aside, serving = unlike_in_fits(prepared, refined)
    if not aside:
        return refined
    progress("searching again without what is unlike the rest", 0.3)
    again = _refined_once(search_effects(without(prepared, aside), rng, progress, told=told), rng, progress)
    terms, now = set(refined.explanation.final.terms), set(again.explanation.final.terms)
    if serving and terms - set(serving) == now:
        return refined  # what serves one stretch alone has not distorted the rest
    alone = tuple(t for t in serving if t not in now)  # the rest shows what is still named
    return replace(again, explanation=replace(again.explanation, aside=aside, serving=alone))


def _refined_once(searched: Searched, rng: np.random.Generator, progress: Progress) -> Refined:
    """Where all windows show that the search is not finished, it goes on once."""
    refined = refine(searched, rng, progress)
    first = refined.explanation
    again = search_further(searched, first, rng.spawn(1)[0], progress)
    if again is None:
        return refined
    more = refine(again, rng, progress)
    last = more.explanation
    vetoed, doubtful = (
        tuple(dict.fromkeys(t for t in (*before, *now) if t not in last.final.terms))
        for before, now in ((first.vetoed, last.vetoed), (first.doubtful, last.doubtful))
    )
    return replace(more, explanation=replace(last, vetoed=vetoed, doubtful=doubtful))


def _known(prepared: Prepared) -> list[Any]:
    """What the phases refer to and every run has after the first of them: robots, runs and the windows."""
    looks = [d for look in prepared.longer for d in (look.raw, look.clean, *(look.free or ())[:1])]
    data = [prepared.raw, prepared.clean, *looks, *(prepared.near or ())[:1]]
    robots = list(dict.fromkeys(b.robot for d in data for b in d.blocks))
    longer = [r for robot in robots for r in longer_steps_of(robot, prepared.options.settings.predict)]
    shared = [prepared.space.robot, *robots, *longer, *prepared.raw.runs]
    return [prepared, prepared.space, prepared.options, *data, *shared]


def _without_memory(thing: Any) -> Any:
    """Predictions that were made before are made again."""
    if not isinstance(thing, PredictionCache):
        return NotImplemented
    return PredictionCache, (thing.data, thing.space, None, None, thing.own, thing.change)
