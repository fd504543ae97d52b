"""The fourth phase: the held-out windows are opened, and the explanation is judged on them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.results.conditions import one_run
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.gaps import ExplanationGaps, measure_gaps
from residual_mpc.diagnosis.results.odd_run import OddRun
from residual_mpc.diagnosis.results.shrink import Shrink, shrink_of
from residual_mpc.diagnosis.results.support import Support, support_of
from residual_mpc.diagnosis.results.variation import variations
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.results.verdict import Verdict
from residual_mpc.models.settings import Term


@dataclass(frozen=True, eq=False)
class Validated:
    """gaps: those of the explanation, over every horizon, and whether it helps; achieved: the shrink on the held-out
    windows, None where nothing helps; supports: of each effect; varying: the effects whose size is not steady. odd: the
    run that is unlike all others, if there is one, and without_odd: the gaps of the others."""

    gaps: ExplanationGaps
    achieved: Shrink | None
    supports: Mapping[Term, Support]
    options: Options
    varying: Mapping[Term, Variation] = field(default_factory=dict)
    odd: OddRun | None = None
    without_odd: ExplanationGaps | None = None

    @property
    def usual(self) -> ExplanationGaps:
        """What tells how sure the causes are: a run that is unlike all others says nothing of them."""
        return self.gaps if self.without_odd is None else self.without_odd

    @property
    def explanation(self) -> FittedExplanation:
        """On data with the noise that it leaves."""
        return self.gaps.of

    @property
    def verdict(self) -> Verdict:
        """What the gaps say; however small a gap, it is explained in part where an effect follows another law than its
        own."""
        found, _ = self.gaps.verdict
        return "partial" if found == "effects" and any(v.by_state for v in self.varying.values()) else found

    @property
    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """(W, M, C) before and after, channel units; an explanation that does not help leaves the errors as they
        were."""
        errors = self.gaps.errors
        return errors["before"], errors["after" if self.gaps.helps else "before"]


def validate(refined: Refined, rng: np.random.Generator, progress: Progress) -> Validated:
    """From here on nothing is fitted to change the explanation."""
    progress("evaluating on the held-out windows", 0.67)
    options, longer, settings = refined.options, refined.longer, refined.options.settings
    gaps = measure_gaps(refined.explanation, longer, options.final_steps, rng, settings=settings)
    odd = one_run(gaps)
    if not gaps.helps:
        return Validated(gaps, None, {}, options, odd=odd)
    of, usual = gaps.of, None
    if odd is not None:
        longer = tuple(look.take(look.raw.run != odd.run) for look in longer)
        others = refined.explanation.take(of.raw.run != odd.run)
        usual = measure_gaps(others, longer, options.final_steps, rng, settings=settings)
    before, after = gaps.errors["before"], gaps.errors["after"]
    achieved = shrink_of(of.raw.take(of.test), of.scales, before[of.test], after[of.test], rng, settings=settings)
    judged = gaps if usual is None else usual
    supports = support_of(judged.of, longer, judged.looks, settings=settings)
    return Validated(gaps, achieved, supports, options, variations(of, settings), odd, usual)
