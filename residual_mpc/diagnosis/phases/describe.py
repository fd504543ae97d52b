"""The last phase: the answer as records, what the explanation leaves, and the stages' shares of the gap."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from residual_mpc.diagnosis.data.where import locate
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.certainty import certainty_of
from residual_mpc.diagnosis.phases.validate import Validated
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup
from residual_mpc.diagnosis.predict.group_space import GroupSpace, sized
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.remainder.description import describe_remainder
from residual_mpc.diagnosis.remainder.learning import NOTHING, Learned, Learner, learn, remainder_of
from residual_mpc.diagnosis.remainder.records import Rest
from residual_mpc.diagnosis.remainder.resemblance import resembles
from residual_mpc.diagnosis.results.alternatives import alternatives, candidates, rival_sets
from residual_mpc.diagnosis.results.causes import causes_of, refitted_without
from residual_mpc.diagnosis.results.conditions import moved, notes, setup
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.gaps import ExplanationGaps
from residual_mpc.diagnosis.results.next_experiment import next_experiment
from residual_mpc.diagnosis.results.records import Candidate, Cause, Diagnosis, DiagnosisResult, GapStep, StageShare
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.stages import staged
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.models.settings import Term, Values

LIKELY = 0.5  # probability of an effect, with what the runs do not tell from it, from which it explains a gap


@dataclass(frozen=True)
class Extras:
    """What is computed once the answer stands: the gap as effects are added, the stages' shares, what was learned of
    the remainder, and what it is like."""

    steps: tuple[GapStep, ...] = ()
    stages: tuple[StageShare, ...] = ()
    learned: Learned = NOTHING
    rest: Rest | None = None


def describe(
    validated: Validated,
    learners: Sequence[Learner],
    rng: np.random.Generator,
    progress: Progress,
    answered: Callable[[Diagnosis], None],
) -> DiagnosisResult:
    """answered: told the answer before the extras are computed."""
    answered(_diagnosis(validated, Extras()))
    found, of, settings = validated.gaps, validated.explanation, validated.options.settings
    progress("analysing the remaining error", 0.87)
    learned, rest = _left(validated.usual, rng, learners, settings)
    progress("attributing the gap to the stages", 0.93)
    gaps = found.everywhere["before"], found.everywhere["after"], found.floor_everywhere.total
    final = of.final if found.helps else None
    budget = validated.options.final_steps // 2
    steps, stages = staged(of.after_data, of.scales, of.space, final, gaps, budget, settings=settings)
    diagnosis = _diagnosis(validated, Extras(steps, stages, learned, rest))
    return DiagnosisResult(diagnosis, of.raw, of.scales, *validated.errors, of.test, of.base.values)


def _diagnosis(validated: Validated, extras: Extras) -> Diagnosis:
    """The records of what was found."""
    found, of, supports = validated.gaps, validated.explanation, validated.supports
    helps, final, settings = found.helps, of.final, validated.options.settings
    verdict, share = validated.verdict, validated.judged.verdict[1]
    certainty = certainty_of(validated, extras.rest)
    varying = dict(certainty.varying)
    groups = tuple(g for g in of.rivalry.groups if not any(t in of.left_out for m in g for t in m)) if helps else ()
    # a size that varies with the motion speaks against the named member alone
    every_doubt = {**shared(certainty.weak, groups), **certainty.doubt}
    others = alternatives(of.rivalry, groups, final, settings=settings) if helps else ()
    refitted = partial(refitted_without, of, steps=validated.options.final_steps, settings=settings)
    causes: tuple[Cause, ...] = ()
    if helps:
        varying = {**varying, **{t: _with(varying.get(t), v) for t, v in of.run_sizes.items()}}
        causes = causes_of(
            of, share, certainty.sure, supports, certainty.doubt, refitted, settings=settings, varying=varying
        )
    varying = {**varying, **{t: _with(varying.get(t), v) for t, v in of.in_parts.items()}}
    looked_at: tuple[Candidate, ...] = ()
    if helps:
        sure = {**shared(certainty.sure, groups), **of.unlikely}
        refuted = (*of.vetoed, *of.doubtful)
        looked_at = as_named(candidates(of.rivalry, of.base, final, sure, refuted, every_doubt), causes)
    if verdict == "effects" and not validated.judged.told and not _likely(causes, looked_at, groups):
        verdict = "partial"  # a gap that is small anyway confirms nothing
    run, unlike = validated.odd, validated.unlike.document(of.raw.horizon)
    odd = None if run is None else run.document(of.raw.runs[run.run].name, of.raw.horizon)
    return Diagnosis(
        robot=of.space.robot.name,
        verdict=verdict,
        held_out=of.kept if of.held.any() else (),
        gap=replace(found.figures(), new_readings=None if validated.fresh is None else validated.fresh.figures()),
        expected=of.expected if helps else None,
        achieved=validated.achieved,
        stages=extras.stages,
        where=locate(of.raw, of.scales, found.errors["before"], settings=settings.data),
        causes=tuple(replace(c, variation=varying.get(c.term)) for c in causes),
        candidates=looked_at,
        groups=groups,
        rivals=rival_sets(of.rivalry, of.unlikely) if helps else (),
        alternatives=others,
        setup=setup(of.raw, dispersion(final, blocks_of(of.problem.data, settings=settings.fit))),
        not_testable=of.untestable,
        moved=moved(of.base, final) if helps else (),
        unexplained=share,
        learned=extras.learned,
        rest=extras.rest,
        steps=extras.steps,
        outlier_share=of.outliers.share if of.with_outliers else 0.0,
        outlier_channels={c: s for c, s in of.outliers.shares.items() if s > 0} if of.with_outliers else {},
        odd_run=odd,
        unlike=unlike,
        next_experiment=next_experiment(
            (*groups, *((a.instead_of, a.terms) for a in others if not a.confounded)),
            wheeled="left" in of.raw.blocks[0].robot.actuators,
            verdict=verdict,
        ),
        values=of.space.whole(final.values) if helps else of.base.values,
        notes=notes(of, validated.judged, odd, unlike, settings=settings),
        groups_of_windows=of.space.groups if helps and isinstance(of.space, GroupSpace) else (),
        at_the_end=_at_the_end(of) if helps else None,
    )


def _with(known: Variation | None, found: Variation) -> Variation:
    """A variation that the fit accounts for, with what else was found of the same effect."""
    if known is None:
        return found
    return replace(known, by_run=found.by_run, since=found.since, until=found.until, free=found.free)


def _at_the_end(of: FittedExplanation) -> Values | None:
    """The values in the group of the last window; None where no group has values of its own."""
    if not isinstance(of.space, GroupSpace):
        return None
    last = np.lexsort((of.raw.start, of.raw.run))[-1]
    group = next(b.group for b in of.raw.blocks if b.where.start <= last < b.where.stop)
    sizes = of.space.groups[group - 1] if group > 0 else {}
    return of.space.whole(sized(of.final.values, sizes, of.space.bounds))


def _likely(causes: Sequence[Cause], looked_at: Sequence[Candidate], groups: Sequence[ConfoundedGroup]) -> bool:
    """Whether any effect that is named is likelier than not, together with what the runs do not tell from it."""
    known = {c.term: c.probability for c in looked_at} | {c.term: c.probability for c in causes}
    alike = [{t for m in g for t in m} for g in groups]
    sums = (sum(known.get(t, 0.0) for t in {c.term, *(t for g in alike if c.term in g for t in g)}) for c in causes)
    return any(x >= LIKELY for x in sums)


def as_named(looked_at: Sequence[Candidate], causes: Sequence[Cause]) -> tuple[Candidate, ...]:
    """The candidates, ranked; a named one has the probability of its cause, which a doubtful number lowers."""
    named = {c.term: c.probability for c in causes}
    out = (replace(c, probability=named.get(c.term, c.probability)) for c in looked_at)
    return tuple(sorted(out, key=lambda c: -c.probability))


def shared(doubt: Mapping[Term, float], groups: Sequence[ConfoundedGroup]) -> dict[Term, float]:
    """The factors with those of the other members of each group, which would be as doubtful in the place of the member
    that is named; of a term in several groups the largest."""
    out = dict(doubt)
    for group in groups:
        here = next((m for m in group if all(t in doubt for t in m)), None)
        if here is None:
            continue
        factor = min(doubt[t] for t in here)
        out |= {t: max(out.get(t, 0.0), factor) for m in group for t in m if t not in doubt}
    return out


def _left(
    found: ExplanationGaps, rng: np.random.Generator, learners: Sequence[Learner], settings: ResultSettings
) -> tuple[Learned, Rest | None]:
    """What the learners make of the rest, and what it is like; what a perfect model might have left under this noise is
    not worth their time."""
    of, first = found.of, found.looks[0]
    if found.verdict[0] == "no_gap" or found.left.total <= max(
        settings.predict.floor.margin * first.floor.total, first.floor.luck
    ):
        return NOTHING, None
    name, seen, current = ("after", of.after_data, of.final) if found.helps else ("before", of.raw, of.base)
    predicted, error, row = found.predicted[name], found.errors[name], of.space.settings([current.values])
    learned = NOTHING
    if of.held.any() and found.left.total > settings.remainder.learned_from:
        remainder = remainder_of(seen, of.scales, row, predicted, error, of.held, tuning=settings.remainder)
        learned = learn(remainder, learners, rng.spawn(1)[0])
    judge = Ruler(PredictionCache(seen.take(of.test), of.space), of.scales, first.floor.total**2, settings.data)
    stepping = found.left_by_step(settings)
    like = None if stepping else resembles(of.problem, current, of.left_out, judge, settings=settings.remainder)
    unspoilt = np.where(np.isfinite(of.clean.y), error, np.nan)
    rest = describe_remainder(
        seen,
        of.scales,
        row,
        predicted,
        unspoilt,
        found.floors[: settings.remainder.description.floor_draws],
        like,
        rng.spawn(1)[0],
        tuning=settings.remainder,
    )
    return learned, replace(rest, depends=(), own_step=True) if stepping else rest
