"""The held-out windows opened: what is left of the gap, what it is like, and the diagnosis as a whole."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.causes import causes_of, most_sure
from residual_mpc.diagnosis.conditions import moved, notes, setup
from residual_mpc.diagnosis.contenders import alternatives, candidates, rival_sets
from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.gap import Scales
from residual_mpc.diagnosis.horizons import Look
from residual_mpc.diagnosis.how_far import shrink_of
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
from residual_mpc.diagnosis.stages import staged
from residual_mpc.diagnosis.support import doubts, evidence_of
from residual_mpc.diagnosis.verdict import MARGIN
from residual_mpc.diagnosis.where import locate

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


def open_held_out(
    of: Explained,
    longer: Sequence[Look],
    options: Options,
    rng: np.random.Generator,
    learners: Sequence[Learner],
    progress: Progress,
) -> Made:
    """The diagnosis. From here on nothing is fitted to change the explanation."""
    found = measure(of, longer, options.final_steps, rng)
    of, (verdict, share), helps = found.of, found.verdict, found.helps
    scales, final, test = of.scales, of.final, of.test
    before, after = found.errors["before"], found.errors["after" if helps else "before"]
    achieved = shrink_of(of.raw.take(test), scales, before[test], after[test], rng) if helps else None
    progress("looking at what is left", 0.9)
    learned, rest = _left(found, verdict, options, rng, learners)
    sure = most_sure(verdict, share, _times_floor(found))
    progress("sharing the gap among the stages", 0.94)
    gaps = found.everywhere["before"], found.everywhere["after"], found.floor_everywhere.total
    steps, stages = staged(of.after_data, scales, of.space, final if helps else None, gaps, options.final_steps // 2)
    groups = tuple(g for g in of.rivalry.groups if not any(t in of.left_out for m in g for t in m)) if helps else ()
    others = alternatives(of.rivalry, groups, final) if helps else ()
    evidence = evidence_of(of) if helps else {}
    doubt = doubts(final.terms, evidence, rest) if helps else {}
    diagnosis = Diagnosis(
        robot=of.space.robot.name,
        verdict=verdict,
        held_out=of.kept if of.held.any() else (),
        gap=found.figures(),
        expected=of.expected if helps else None,
        achieved=achieved,
        stages=stages,
        where=locate(of.raw, scales, before),
        causes=causes_of(of, share, sure, evidence, doubt) if helps else (),
        candidates=candidates(of.rivalry, of.base, final, sure, of.left_out, doubt) if helps else (),
        groups=groups,
        rivals=rival_sets(of.rivalry) if helps else (),
        alternatives=others,
        setup=setup(of.raw, dispersion(final, blocks_of(of.problem.data))),
        not_testable=of.untestable,
        moved=moved(of.base, final) if helps else (),
        unexplained=share,
        learned=learned,
        rest=rest,
        steps=steps,
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
    return Made(diagnosis, of.raw, scales, before, after, test)


def _times_floor(found: Measured) -> float:
    """How many times the noise floor is left, at the horizon where that is most, of what is not small anyway."""
    return max(
        (look.after.total / max(look.floor.total, 1e-12) for look in found.looks),
        default=1.0,
    )


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
