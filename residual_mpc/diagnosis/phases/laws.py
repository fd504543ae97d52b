"""Between validation and description: what no known effect explains becomes a law where it depends on a quantity."""

from copy import deepcopy
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.least_squares import Fit, on_problem
from residual_mpc.diagnosis.fit.polish import carry_on
from residual_mpc.diagnosis.laws.add import Unexplained, WithLaws, add_laws
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.refine import Refined, cross_validated_shrink, trusting
from residual_mpc.diagnosis.phases.validate import Validated, validate
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import weighed
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.shrink import shrink_of
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.effects.laws import FITTED_LAW, kind_of
from residual_mpc.models.settings import TUNE


def find_laws(refined: Refined, validated: Validated, rng: np.random.Generator, progress: Progress) -> Validated:
    """The explanation with the laws that predict the held-out windows better beyond doubt; else as it was.

    What is fitted sees no held-out window. The generator is left as it came, so that what follows draws the same.
    """
    options = validated.options
    wanted = FITTED_LAW not in options.without and (not options.only or FITTED_LAW in options.only)
    if not wanted or not validated.explanation.held.any() or not _more_to_explain(validated):
        return validated
    progress("looking for a law in what is left", 0.72)
    rng = deepcopy(rng)
    found = add_laws(_unexplained(validated), rng, options.settings.remainder, options.settings.laws)
    if found is None or not (validated.verdict != "effects" or _replaces(validated, found)):
        return validated
    again = validate(replace(refined, explanation=_explained(refined, found, rng)), rng, progress)
    return again if _predicts(validated, again, rng) else validated


def _more_to_explain(validated: Validated) -> bool:
    """Whether what is left may have a cause of its own: a small gap alone does not confirm effects. The error of the
    model's own time step has none, and where noise hides everything none can be seen."""
    gaps = validated.judged
    if gaps.blinded or (validated.verdict == "effects" and gaps.left_by_step(validated.options.settings)):
        return False
    return validated.verdict not in ("no_gap", "effects") or (validated.verdict == "effects" and not gaps.told)


def _replaces(validated: Validated, found: WithLaws) -> bool:
    """Whether laws take the place of an effect that a small gap seemed to confirm. A law of the speed does not: it is
    friction with another curve."""
    named, now = ({k.term for k in v if k.effect != TUNE} for v in (validated.explanation.final.values, found.values))
    laws = [kind for t in now if (kind := kind_of(t.effect)) is not None]
    return not named <= now and bool(laws) and not any(law.on == "speed" for law in laws)


def _unexplained(validated: Validated) -> Unexplained:
    """The windows of the headline's horizon, or shorter ones where the model cannot predict that far."""
    of = validated.explanation
    near = of.problem.data.horizon < of.raw.horizon
    data = replace(of.problem.data, noise=of.raw.noise) if near else of.clean.take(of.free)
    values = of.final.values if validated.gaps.helps else of.base.values
    scales = measure_scales(data) if near else of.scales
    return Unexplained(data, scales, 1.0 / of.problem.weight, of.space, of.base.values, values)


def _explained(refined: Refined, found: WithLaws, rng: np.random.Generator) -> FittedExplanation:
    """The laws' numbers fitted on all windows that fits may see, and the shrink expected of them."""
    of, options = refined.explanation, refined.options
    settings = options.settings
    before = of.problem  # laws do not change the nominal model, so its sensitivity to the start is reused
    replays = PredictionCache(before.data, found.space)
    problem = weighed(replays, before.sensitivity, 1.0 / before.weight, before.motion)
    problem = trusting(problem, found.values, of.scales, settings)
    final = carry_on(problem, [found.values], options.final_steps, settings=settings.fit)[0]
    base = on_problem(problem, of.base, settings=settings.fit)
    known = replace(refined.prepared, space=found.space)
    expected = cross_validated_shrink(known, problem, final, base, of.with_outliers, rng)
    ends = {k: (final.values[k],) for k in final.knobs if k.effect != TUNE}
    return replace(
        of, problem=problem, base=base, final=final, ends=ends, rivalry=_still_standing(of.rivalry, final),
        vetoed=(), doubtful=(), unlikely={}, expected=expected, tolerated=None, omitted=(), forms=found.forms,
        in_parts={t: v for t, v in of.in_parts.items() if t in final.terms},
        run_sizes={t: v for t, v in of.run_sizes.items() if t in final.terms},
    )  # fmt: skip


def _still_standing(rivalry: Rivalry, final: Fit) -> Rivalry:
    """What was said of the effects that are still named. Their rivals were compared without the laws, and are not: what
    was added with the laws has no rival, though it may have been one of another effect."""
    groups = tuple(g for g in rivalry.groups if all(t in final.terms for t in g[0]))
    shares = {t: rivalry.shares.get(t, 1.0) if t in rivalry.fit.terms else 1.0 for t in final.terms}
    return Rivalry(final, (), groups, shares, final)


def _predicts(before: Validated, after: Validated, rng: np.random.Generator) -> bool:
    """Whether the held-out windows are predicted better beyond doubt, or, by fewer terms, visibly better: several
    effects can imitate any law."""
    of, settings = after.explanation, after.options.settings
    if not after.gaps.helps:
        return False
    was, now = (v.errors[1][of.test] for v in (before, after))
    gain = shrink_of(of.raw.take(of.test), of.scales, was, now, rng, settings=settings)
    simpler = len(of.final.terms) < len(before.explanation.final.terms)
    return gain.value >= settings.laws.worth and (simpler or gain.ci95[0] > 0.0)
