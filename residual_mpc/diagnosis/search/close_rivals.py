"""Which rivals are too close to the chosen set to be told from it, whatever their likelihoods say."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95, covariance
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.predict.problem import Problem, tolerating
from residual_mpc.diagnosis.predict.step_error import no_farther_than
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.substitutes import imitate
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term


@dataclass(frozen=True)
class Rival:
    """A set with one member (or pair) replaced: what went, what came, the refitted whole, and its likelihood ratio
    against the chosen set (positive: worse)."""

    gone: EffectSet
    came: EffectSet
    fit: Fit
    ratio: float
    alike: bool

    @property
    def exchange(self) -> tuple[Term, Term] | None:
        """The one effect that went and the one that came; None where several did."""
        return (self.gone[0], self.came[0]) if len(self.gone) == len(self.came) == 1 else None


def too_close(
    problem: Problem, ruler: Ruler, fit: Fit, rivals: Sequence[Rival], settings: SearchSettings
) -> list[bool]:
    """Which of the rivals that the likelihood tells from the fit are so close to it that something else may have
    decided: the model's own time step, or, between effects that imitate each other or that the likelihood hardly
    tells apart, what neither explains. problem: the one that they were fitted on.
    """
    told = [i for i, r in enumerate(rivals) if not r.alike and 0.0 < r.ratio]
    near = [i for i in told if rivals[i].ratio < settings.rivals.far or are_twins(problem, rivals[i])]
    beside = _within_what_is_left(problem, ruler, fit, [rivals[i] for i in near], settings)
    out = [False] * len(rivals)
    for i, left in zip(near, beside, strict=True):
        out[i] = left
    error = ruler.step_error(fit) if told else 0.0
    stepped = sorted({*near, *_as_small(ruler, fit, rivals, told, settings)}) if error > 0.0 else []
    for i, step in zip(stepped, _within_step_error(ruler, fit, [rivals[i] for i in stepped], error), strict=True):
        out[i] = out[i] or step
    return out


def _as_small(
    ruler: Ruler, fit: Fit, rivals: Sequence[Rival], told: Sequence[int], settings: SearchSettings
) -> list[int]:
    """Which of the rivals `told` leave a squared gap that is larger than the fit's by no more than a share of what the
    fit leaves beyond the noise."""
    *gaps, own = ruler.squared([*(rivals[i].fit for i in told), fit])
    return [i for i, gap in zip(told, gaps, strict=True) if gap - own < settings.rivals.of_left * (own - ruler.floor)]


def _within_step_error(ruler: Ruler, fit: Fit, rivals: list[Rival], error: float) -> list[bool]:
    """Which predictions differ from the fit's by less than the error of the model's own time step, whatever the
    likelihood, which takes that error for noise: a dead time before the actuator and one behind the sensor are rounded
    to steps in different ways, and a mass may fit some of the error that another does not. error: its squared gap."""
    if not rivals:
        return []
    own, *others = ruler.replays([fit.values, *(r.fit.values for r in rivals)])
    return no_farther_than(ruler.replays.data, ruler.scales, own, others, float(np.sqrt(error)))


def without_small_differences(problem: Problem, fits: list[Fit], settings: SearchSettings) -> list[Fit]:
    """The fits carried on without small differences elsewhere, which let a fit rest where its gap is not smallest."""
    if problem.marginal is None:
        return fits
    plain = tolerating(problem, None)
    return fit_all(plain, [f.values for f in fits], settings.rivals.gap_steps, rough=True, settings=settings.fit)


def _within_what_is_left(
    problem: Problem, ruler: Ruler, fit: Fit, rivals: list[Rival], settings: SearchSettings
) -> list[bool]:
    """Which of these rivals, all in place of the same effect, imitate it or are hardly told from it by the likelihood,
    remove a good part of what it removes, and leave hardly more of the squared gap than the fit: less than a share of
    what both leave beyond the noise, than the error of the model's own time step, or, where there are small differences
    elsewhere, too little to see. A twin, which no run here can tell apart, counts unless its gap is visibly larger, and
    larger by more than all that the fit leaves beyond the noise.

    A likelihood takes what is left for noise. Where it is an effect that nobody names, it may favour either.
    """
    twins = [are_twins(problem, r) for r in rivals]
    near = [
        t or (r.exchange is not None and (imitate(*r.exchange) or r.ratio < settings.rivals.hardly))
        for r, t in zip(rivals, twins, strict=True)
    ]
    if not any(near):
        return near
    *compared, chosen = without_small_differences(
        problem, [*(r.fit for r, n in zip(rivals, near, strict=True) if n), fit], settings
    )
    *others, bare, own = ruler.squared([*compared, _without(problem, fit, rivals[0].gone, settings), chosen])
    most = max(settings.rivals.of_left * (own - ruler.floor), ruler.step_error(fit))
    if problem.marginal is not None:
        most = max(most, settings.rivals.visible * ruler.floor)
    seen = max(most, own - ruler.floor, settings.rivals.visible * ruler.floor, settings.rivals.share * own)
    least = settings.rivals.works * (bare - own)  # of what the effect removes; a twin does the same by definition
    more = iter(others)
    out = []
    for is_near, twin in zip(near, twins, strict=True):
        gap = next(more) if is_near else np.inf
        out.append(bool(gap - own < (seen if twin else most)) and (twin or bool(bare - gap >= least)))
    return out


def _without(problem: Problem, fit: Fit, gone: EffectSet, settings: SearchSettings) -> Fit:
    """The rest of a set, fitted without small differences."""
    rest = {k: v for k, v in fit.values.items() if k.effect == TUNE or k.term not in gone}
    plain = tolerating(problem, None)
    return fit_all(plain, [rest], settings.rivals.gap_steps, rough=True, settings=settings.fit)[0]


def is_its_simple_case(fit: Fit, rival: Rival, blocks: np.ndarray, settings: SearchSettings) -> bool:
    """Whether the rival is what the effect in the fit comes to where two of its numbers are equal, and these are equal
    within their 95 % intervals: those of the sandwich covariance, and what no robot's law is exact to."""
    if rival.exchange is None:
        return False
    gone, came = rival.exchange
    equal = BY_NAME[gone.effect].equal
    if equal is None or came != Term(equal[0], gone.target):
        return False
    knobs = [Knob(gone.effect, gone.target, p) for p in equal[1]]
    one, other = (fit.values[k] for k in knobs)
    spread = np.sqrt(np.maximum(np.diag(covariance(fit, blocks)), 0.0))
    half = [max(T95 * spread[fit.knobs.index(k)], settings.rivals.law * abs(fit.values[k])) for k in knobs]
    return bool(abs(one - other) <= sum(half))


def are_twins(problem: Problem, rival: Rival) -> bool:
    """Whether the runs cannot tell the one effect that came from the one that went."""
    return rival.exchange is not None and problem.space.are_twins(*rival.exchange)
