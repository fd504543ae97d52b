"""Which rivals leave a visibly larger gap than the chosen set, whatever the likelihood says."""

from collections.abc import Sequence
from dataclasses import replace

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.close_rivals import Rival, are_twins, without_small_differences
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.diagnosis.search.substitutes import imitate
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob


def _told_apart(rival: Rival, settings: SearchSettings) -> Rival:
    """The rival as one that the data tell from the chosen set."""
    return replace(rival, ratio=max(rival.ratio, settings.steps.alike), alike=False)


def with_gaps_seen(found: Found, fit: Fit, rivals: list[Rival], settings: SearchSettings) -> list[Rival]:
    """The rivals, of which those are told apart whose gap one would see to be larger than the chosen fit's, by more
    than the error of the model's own time step; where that error may make the difference, they are alike and take no
    place. Precise encoders may outweigh the pose in the likelihood, and what they show is no reason to give up what the
    pose shows. The gap of a low-pass of the readings is not compared with that of what imitates it: its input at a
    window's start is reconstructed from noisy readings, which alone enlarges the gap."""
    tuned, out = settings.rivals, list(rivals)
    close = [
        i for i, r in enumerate(rivals) if (r.alike or r.ratio < tuned.better) and not low_pass_for_another(fit, r)
    ]
    if not close:
        return out
    fits = without_small_differences(found.problem, [fit, *(rivals[i].fit for i in close)], settings)
    own, *gaps = found.ruler.squared(fits[::-1])[::-1]
    least = max(tuned.visible * found.ruler.floor, tuned.share * own)
    if max(gaps) <= own + least:
        return out
    step = max(least, found.ruler.step_error(fit))
    for i, gap in zip(close, gaps, strict=True):
        if gap > own + step:
            out[i] = _told_apart(rivals[i], settings=settings)
        elif gap > own + least:
            out[i] = replace(rivals[i], ratio=max(rivals[i].ratio, 0.0), alike=True)
    return out


def told_over(
    found: Found, fit: Fit, rivals: list[Rival], over: Sequence[Ruler], settings: SearchSettings
) -> list[Rival]:
    """The rivals, of which those are told apart, twins excepted, that leave a far larger gap over other horizons, to
    which neither is fitted: larger by more than the noise and than all that the fit leaves, of which the error of the
    model's own time step is a part."""
    out = list(rivals)
    close = [
        i
        for i, r in enumerate(rivals)
        if r.ratio < settings.steps.alike and not are_twins(found.problem, r) and not low_pass_for_another(fit, r)
    ]
    if not close or not over:
        return out
    fits = without_small_differences(found.problem, [fit, *(rivals[i].fit for i in close)], settings)
    for ruler in over:
        own, *gaps = ruler.squared(fits[::-1])[::-1]
        least = max(ruler.floor, own)  # no less than the step's error, of which there is at most own - floor
        for i, gap in zip(close, gaps, strict=True):
            if gap > own + least:
                out[i] = _told_apart(out[i], settings=settings)
    return out


def low_pass_for_another(fit: Fit, rival: Rival) -> bool:
    """Whether one of two effects that imitate each other is a low-pass of the readings."""
    imitates = rival.exchange is not None and imitate(*rival.exchange)
    return imitates and with_low_pass(fit) != with_low_pass(rival.fit)


def with_low_pass(fit: Fit) -> bool:
    return any(_is_low_pass(k) for k in fit.knobs)


def _is_low_pass(knob: Knob) -> bool:
    return knob.effect != TUNE and BY_NAME[knob.effect].parameter(knob.parameter).quantity == "reading lag"
