"""The fourth phase: the held-out windows are opened, and the explanation is judged on them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import per_window
from residual_mpc.diagnosis.data.left_out import SLACK, across, unfit
from residual_mpc.diagnosis.data.stale import any_slow
from residual_mpc.diagnosis.data.unknown_past import after_unknown_past, has_memory, runs_with_unknown_past
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.results.conditions import one_run
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.gaps import ExplanationGaps, measure_gaps
from residual_mpc.diagnosis.results.odd_run import OddRun
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.shrink import Shrink, shrink_of
from residual_mpc.diagnosis.results.support import Support, support_of
from residual_mpc.diagnosis.results.unlike_the_rest import (
    Unlike,
    floor_of_each,
    joined_stretches,
    unlike_the_rest,
)
from residual_mpc.diagnosis.results.variation import makes_the_odd_run, variations
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.results.verdict import Verdict
from residual_mpc.models.settings import Term


@dataclass(frozen=True, eq=False)
class Validated:
    """gaps: those of the explanation, over every horizon, and whether it helps; achieved: the shrink on the held-out
    windows, None where nothing helps; supports: of each effect; varying: the effects whose size is not steady. odd: the
    run that is unlike all others, if there is one; unlike: stretches that are unlike everything else. without: the gaps
    without these and the incidents of the logs, if there are any; fresh: the gaps without what slow sensors repeat, if
    any sensor is slow."""

    gaps: ExplanationGaps
    achieved: Shrink | None
    supports: Mapping[Term, Support]
    options: Options
    varying: Mapping[Term, Variation] = field(default_factory=dict)
    odd: OddRun | None = None
    unlike: Unlike = Unlike()
    without: ExplanationGaps | None = None
    fresh: ExplanationGaps | None = None

    @property
    def judged(self) -> ExplanationGaps:
        """What the verdict is about: of slow sensors, only the new readings."""
        return self.gaps if self.fresh is None else self.fresh

    @property
    def usual(self) -> ExplanationGaps:
        """What tells how sure the causes are: neither an incident nor a run that is unlike all others does."""
        return self.judged if self.without is None else self.without

    @property
    def explanation(self) -> FittedExplanation:
        """On data with the noise that it leaves."""
        return self.gaps.of

    @property
    def verdict(self) -> Verdict:
        """What the gaps say; however small a gap, it is explained in part where an effect follows another law than its
        own."""
        found, _ = self.judged.verdict
        return "partial" if found == "effects" and any(v.by_state for v in self.varying.values()) else found

    @property
    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """(W, M, C) before and after, channel units; an explanation that does not help leaves the errors as they
        were."""
        errors = self.gaps.errors
        return errors["before"], errors["after" if self.gaps.helps else "before"]


def validate(refined: Refined, rng: np.random.Generator, progress: Progress) -> Validated:
    """From here on nothing is added to the explanation."""
    progress("evaluating on the held-out windows", 0.67)
    options, longer, settings = refined.options, refined.longer, refined.options.settings
    measure = partial(measure_gaps, steps=options.final_steps, rng=rng, settings=settings)
    judged, fresh, seen = refined.explanation, None, longer
    if any_slow(judged.raw):
        judged, seen = judged.of_new_readings(), tuple(look.of_new_readings() for look in longer)
        fresh = measure(judged, seen)
    gaps = measure(refined.explanation, longer, judged=fresh)
    odd, unlike = one_run(fresh or gaps), _unlike(fresh or gaps, settings)
    unknown = _unknown_starts(gaps.of, unlike)
    if unknown.any() and gaps.helps:
        measure = partial(measure, unknown_starts=unknown)
        fresh = None if fresh is None else measure(judged, seen)
        gaps = measure(refined.explanation, longer, judged=fresh)
    if odd is not None and gaps.helps and makes_the_odd_run((fresh or gaps).of, settings):
        odd = None
    if not gaps.helps:
        return Validated(gaps, None, {}, options, odd=odd, unlike=unlike, fresh=fresh)
    of, without = gaps.of, None
    keep = _usual(of.raw, odd, unlike)
    if keep.any() and not keep.all():
        rest = ((look, _usual(look.raw, odd, unlike)) for look in seen)
        seen = tuple(look.take(mask) for look, mask in rest if mask.any())
        without = measure(judged.take(keep), seen)
    before, after = gaps.errors["before"], gaps.errors["after"]
    achieved = shrink_of(of.raw.take(of.test), of.scales, before[of.test], after[of.test], rng, settings=settings)
    usual = without or fresh or gaps
    supports = support_of(usual.of, seen, usual.looks, settings=settings)
    return Validated(gaps, achieved, supports, options, variations(usual.of, settings), odd, unlike, without, fresh)


def _unlike(gaps: ExplanationGaps, settings: ResultSettings) -> Unlike:
    """Stretches that are unlike everything else, with those that no fit has seen for that."""
    of = gaps.of
    if gaps.verdict[0] == "no_gap":
        return Unlike()
    left = np.sqrt(per_window(of.raw, of.scales, gaps.errors["after" if gaps.helps else "before"]))
    past, row = settings.data.unknown_past, of.space.settings([of.final.values if gaps.helps else of.base.values])
    unknown = runs_with_unknown_past(of.clean, past) & has_memory(row)
    left[~after_unknown_past(of.raw, np.ones(of.raw.count, dtype=bool), unknown, past)] = np.nan  # the past made these
    found = unlike_the_rest(of.raw, left, settings.aside, floor_of_each(of.after_data, of.scales, gaps.floors))
    stretches = joined_stretches(of.aside, found.stretches)
    there = across(of.raw, stretches)
    if not there.any():
        return Unlike()
    return Unlike(stretches, float(np.nanmax(left[there])), float(np.nanmedian(left)), of.serving)


def _unknown_starts(of: FittedExplanation, unlike: Unlike) -> np.ndarray:
    """(R,) bool: the runs that begin with a stretch that is unlike everything else: earlier commands may still act
    there. What is held out does not tell."""
    told = [k for k in unlike.stretches if not (across(of.raw, (k,)) & of.held).any()]
    begins = [(k.run, k.start) for k in told if k.start is not None]
    return np.array([any(name == r.name and t <= r.t[0] + SLACK for name, t in begins) for r in of.raw.runs])


def _usual(data: Dataset, odd: OddRun | None, unlike: Unlike) -> np.ndarray:
    """(W,) bool: the windows across no incident and no stretch that is unlike everything else, of runs that are like
    others."""
    keep = ~unfit(data) & ~across(data, unlike.stretches)
    return keep if odd is None else keep & (data.run != odd.run)
