"""The held-out windows opened: what is left of the gap, what it is like, and the diagnosis as a whole."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.causes import causes_of, most_sure, without_doubtful
from residual_mpc.diagnosis.conditions import moved, notes, setup
from residual_mpc.diagnosis.contenders import alternatives, candidates, rival_sets
from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.gap import Scales
from residual_mpc.diagnosis.horizons import Look
from residual_mpc.diagnosis.how_far import Shrink, shrink_of
from residual_mpc.diagnosis.measured import Measured, measure
from residual_mpc.diagnosis.next_experiment import next_experiment
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.records import Diagnosis, Verdict
from residual_mpc.diagnosis.remainder import NOTHING, Learned, Learner, learn, remainder_of
from residual_mpc.diagnosis.replays import Replays
from residual_mpc.diagnosis.rest.describe import describe
from residual_mpc.diagnosis.rest.records import Rest
from residual_mpc.diagnosis.rest.resemblance import resembles
from residual_mpc.diagnosis.search import Ruler
from residual_mpc.diagnosis.stages import Chain, Shares, staged
from residual_mpc.diagnosis.support import Support, doubts, support_of
from residual_mpc.diagnosis.verdict import MARGIN, clearest, left_share
from residual_mpc.diagnosis.where import locate
from residual_mpc.models.settings import Knob, Term

Progress = Callable[[str, float], None]

FEW = 4  # draws of the noise that tell what of a remainder is noise


@dataclass(frozen=True)
class Made:
    """A diagnosis and what the report draws: errors (W, M, C) of all windows before and after, and which are judged."""

    diagnosis: Diagnosis
    data: Dataset
    scales: Scales
    before: np.ndarray
    after: np.ndarray
    held: np.ndarray


@dataclass(frozen=True)
class Extras:
    """What is computed once the answer stands: the gap as effects are added, the stages' shares, what was learned of
    the remainder, and what it is like."""

    steps: Chain = ()
    stages: Shares = ()
    learned: Learned = NOTHING
    rest: Rest | None = None


def open_held_out(
    of: Explained,
    longer: Sequence[Look],
    options: Options,
    rng: np.random.Generator,
    learners: Sequence[Learner],
    progress: Progress,
    answered: Callable[[Diagnosis], None],
) -> Made:
    """The diagnosis. From here on nothing is fitted to change the explanation. answered: told the answer before the
    extras are computed."""
    found = measure(of, longer, options.final_steps, rng)
    of, helps = found.of, found.helps
    errors = found.errors["before"], found.errors["after" if helps else "before"]
    test = of.test
    achieved = shrink_of(of.raw.take(test), of.scales, errors[0][test], errors[1][test], rng) if helps else None
    supports = support_of(of, longer, found.looks) if helps else {}
    lacking = without_doubtful(of, doubts(supports, None), options.final_steps) if helps else {}
    answered(_diagnosis(found, achieved, supports, lacking, Extras()))
    progress("analysing the remaining error", 0.9)
    learned, rest = _left(found, found.verdict[0], options, rng, learners)
    progress("attributing the gap to the stages", 0.94)
    gaps = found.everywhere["before"], found.everywhere["after"], found.floor_everywhere.total
    final = of.final if helps else None
    steps, stages = staged(of.after_data, of.scales, of.space, final, gaps, options.final_steps // 2)
    diagnosis = _diagnosis(found, achieved, supports, lacking, Extras(steps, stages, learned, rest))
    return Made(diagnosis, of.raw, of.scales, *errors, test)


def _diagnosis(
    found: Measured,
    achieved: Shrink | None,
    supports: Mapping[Term, Support],
    lacking: Mapping[Knob, tuple[float, ...]],
    extras: Extras,
) -> Diagnosis:
    """The records of what was found."""
    of, helps, final = found.of, found.helps, found.of.final
    verdict, share = found.verdict
    # a slow effect hardly shows in the headline's gap: what is left counts where the gap is clearest
    sure = most_sure(verdict, left_share(clearest(found.looks)) if helps else share, _times_floor(found))
    doubt = doubts(supports, extras.rest)
    groups = tuple(g for g in of.rivalry.groups if not any(t in of.left_out for m in g for t in m)) if helps else ()
    others = alternatives(of.rivalry, groups, final) if helps else ()
    return Diagnosis(
        robot=of.space.robot.name,
        verdict=verdict,
        held_out=of.kept if of.held.any() else (),
        gap=found.figures(),
        expected=of.expected if helps else None,
        achieved=achieved,
        stages=extras.stages,
        where=locate(of.raw, of.scales, found.errors["before"]),
        causes=causes_of(of, share, sure, supports, doubt, lacking) if helps else (),
        candidates=candidates(of.rivalry, of.base, final, sure, of.left_out, doubt) if helps else (),
        groups=groups,
        rivals=rival_sets(of.rivalry) if helps else (),
        alternatives=others,
        setup=setup(of.raw, dispersion(final, blocks_of(of.problem.data))),
        not_testable=of.untestable,
        moved=moved(of.base, final) if helps else (),
        unexplained=share,
        learned=extras.learned,
        rest=extras.rest,
        steps=extras.steps,
        outlier_share=of.outliers.share if of.with_outliers else 0.0,
        outlier_channels={c: s for c, s in of.outliers.shares.items() if s > 0} if of.with_outliers else {},
        next_experiment=next_experiment(
            (*groups, *((a.instead_of, a.terms) for a in others if not a.confounded)),
            wheeled="left" in of.raw.blocks[0].robot.actuators,
            verdict=verdict,
        ),
        values=final.values if helps else of.base.values,
        notes=notes(of, found),
    )


def _times_floor(found: Measured) -> float:
    """How many times the noise floor is left, at the horizon where that is most."""
    return max(look.steady.total / max(look.floor.total, 1e-12) for look in found.looks)


def _left(
    found: Measured, verdict: Verdict, options: Options, rng: np.random.Generator, learners: Sequence[Learner]
) -> tuple[Learned, Rest | None]:
    """What the learners make of the rest, and what it is like; what a perfect model might have left under this noise is
    not worth their time."""
    of, first = found.of, found.looks[0]
    if verdict == "no_gap" or found.left.total <= max(MARGIN * first.floor.total, first.floor.luck):
        return NOTHING, None
    name, seen, current = ("after", of.after_data, of.final) if found.helps else ("before", of.raw, of.base)
    predicted, error, row = found.predicted[name], found.errors[name], of.space.settings([current.values])
    learned = NOTHING
    if of.held.any():
        remainder = remainder_of(seen, of.scales, row, predicted, error, of.held)
        learned = learn(remainder, learners, rng.spawn(1)[0])
    judge = Ruler(Replays(seen.take(of.test), of.space), of.scales, first.floor.total**2)
    like = resembles(of.problem, current, of.left_out, judge)
    unspoilt = np.where(np.isfinite(of.clean.y), error, np.nan)
    return learned, describe(seen, of.scales, row, predicted, unspoilt, found.floors[:FEW], like, rng.spawn(1)[0])
