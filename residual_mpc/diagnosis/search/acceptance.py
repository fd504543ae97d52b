"""Whether an effect is accepted: what an engineer would see of it, and what the likelihood says."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, fit_trust, gap_of, per_window, window_trust
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.marginalisation import tolerant
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD, SMALL
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, reweigh, tolerating
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.step_error import finer_prediction, some_windows, step_error
from residual_mpc.diagnosis.search.additions import NONE
from residual_mpc.diagnosis.search.settings import SearchSettings

STEP_WINDOWS = 10  # on which a search measures the error of the time step
FINE_WINDOWS = 24  # on which it replays a model with a smaller one


@dataclass(frozen=True)
class Ruler:
    """Squared gaps on the search's windows: what an engineer would see, beside what a likelihood sees."""

    replays: PredictionCache
    scales: Scales
    floor: float  # squared gap of a perfect model
    settings: DataSettings

    def squared(self, fits: list[Fit]) -> np.ndarray:
        """(H,) squared gap of each fit, in which the windows count at their limit whose prediction diverges under the
        last of them, or that are unlike the others under each of them."""
        data = self.replays.data
        return self._squared(data, np.stack([data.y - p for p in self.replays([f.values for f in fits])]))

    def finely_stepped(self, fits: list[Fit]) -> np.ndarray | None:
        """The same of the models stepped infinitely finely, on a few windows; None where no model here has another
        step."""
        data = self.replays.own or self.replays.data
        few = some_windows(data, FINE_WINDOWS)
        errors = []
        for fit in fits:
            row = self.replays.space.settings([fit.values])
            here = predict(few, row)[0]
            apart = finer_prediction(few, row, here)
            if apart is None:
                return None
            errors.append(few.y - here - apart)
        return self._squared(few, np.stack(errors))

    def _squared(self, data: Dataset, errors: np.ndarray) -> np.ndarray:
        """See `squared`, from errors (H, W, M, C)."""
        sizes = np.stack([np.nan_to_num(per_window(data, self.scales, e), nan=np.inf) for e in errors])
        smallest = errors[np.argmin(sizes, axis=0), np.arange(data.count)]
        diverged = window_trust(data, self.scales, errors[-1], settings=self.settings)
        trust = np.minimum(diverged, fit_trust(data, self.scales, smallest, settings=self.settings))
        return np.array([gap_of(data, self.scales, e, trust).total ** 2 for e in errors])

    @property
    def much(self) -> float:
        """The squared gap above which more is left than the sensors can tell from nothing (verdict `partial`)."""
        return self.threshold(SMALL**2)

    def threshold(self, least: float) -> float:
        """The same with another squared gap up to which gaps are small."""
        return max(AS_GOOD**2 * self.floor, least)

    def step_error(self, fit: Fit) -> float:
        """The squared gap that the model's own time step makes at this fit; 0 where no model here has another step."""
        data = self.replays.own or self.replays.data
        row = self.replays.space.settings([fit.values])
        found = step_error(data, self.scales, row, self.settings, STEP_WINDOWS)
        return 0.0 if found is None else found**2

    def much_left(self, fit: Fit) -> bool:
        """Whether a fit leaves that much."""
        return bool(self.squared([fit])[0] > self.much)

    def visible(self, fit: Fit, settings: SearchSettings) -> bool:
        """Whether a fit leaves far more than the noise and the error of the model's own time step."""
        left, tuned = float(self.squared([fit])[0]), settings.steps
        return left > tuned.visible * self.floor and left > tuned.beyond_step * self.step_error(fit)


def squared_gaps(replays: PredictionCache, scales: Scales, fits: Sequence[Fit], settings: SearchSettings) -> np.ndarray:
    """(H,) squared gap of each fit, in which a window counts at most as one whose motion is missed altogether."""
    y, lost = replays.data.y, settings.rivals.lost
    squares = [per_window(replays.data, scales, y - p) for p in replays([f.values for f in fits])]
    return np.array([np.mean(np.minimum(np.nan_to_num(s, nan=lost), lost)) for s in squares])


def build_ruler(
    replays: PredictionCache, scales: Scales, base: Fit, rng: np.random.Generator, settings: DataSettings
) -> Ruler:
    """The ruler of a search; its floor comes from noise drawn by rng."""
    data = replays.data
    errors = noise_errors(data, replays.space.settings([base.values]), rng, 2, exact=replays.own)
    return Ruler(replays, scales, float(np.mean([gap_of(data, scales, e).total ** 2 for e in errors])), settings)


def judge(
    problem: Problem,
    fit: Fit,
    noise: np.ndarray,
    scales: Scales,
    settings: SearchSettings,
    beside: Fit | None = None,
) -> Problem:
    """The problem with small differences marginalised that this fit's residuals make likely, with each channel weighed
    by what is left then, never less than its noise, and with the windows that are unlike the others under the fit
    weighing less (Huber's weights on whole windows).

    beside: a fit that this one is compared with. Each channel is then weighted by the smaller of the two residuals, so
    that a set is penalised for a channel that the other one explains."""
    data = problem.data
    trust = fit_trust(data, scales, data.y - problem.replays([fit.values])[0], settings=settings.data)
    count = None if (trust == 1.0).all() else trust
    plain = tolerant(
        replace(reweigh(problem, noise), count=count, tolerances=problem.tolerances), fit, settings=settings.fit
    )
    r = plain.residuals([f.values for f in (fit, beside) if f is not None]).reshape(-1, *data.y.shape)
    seen = np.isfinite(data.y)
    left = np.einsum("hwmc,hwmc->hc", r, r) / np.maximum(np.einsum("w,wmc->c", trust, seen.astype(float)), 1.0)
    fair = reweigh(problem, noise * np.maximum(np.sqrt(left.min(axis=0)), 1.0))
    return tolerant(replace(fair, count=count, tolerances=problem.tolerances), fit, settings=settings.fit)


def convincing(
    problem: Problem,
    ruler: Ruler,
    current: Fit,
    best: Fit,
    base: Fit,
    blocks: np.ndarray,
    settings: SearchSettings,
) -> Fit | None:
    """The best fit, if it is beyond doubt against coloured residuals, and seen above the noise and above the error of
    the model's own time step, which a small effect may stand for; else None. It is taken from where it ends without
    small differences if these held it where its gap is far larger: they may take up what a number has to."""
    _, was, now = ruler.squared([base, current, best])
    held, removed, left = now, was - now, max(was - ruler.floor, 0.0)
    if removed < max(settings.over_floor * ruler.floor, settings.share * left):
        return None  # the cheap question first
    fair = judge(problem, best, 1.0 / problem.weight, ruler.scales, settings=settings, beside=current)
    if fair.marginal is not None:  # small differences let a fit rest where its gap is not smallest
        plain = fit_all(
            tolerating(fair, None),
            [current.values, best.values],
            3,
            rough=True,
            fresh=[NONE, NONE],
            settings=settings.fit,
        )
        _, was, now = ruler.squared([base, *plain])
        removed, left = was - now, max(was - ruler.floor, 0.0)
        if removed < max(settings.over_floor * ruler.floor, settings.share * left):
            return None
        if now < settings.rivals.far_smaller * held:
            current, best = plain
            fair = judge(problem, best, 1.0 / problem.weight, ruler.scales, settings=settings, beside=current)
    if fair.marginal is None:  # nothing is marginalised: the likelihood is as sure of itself as ever
        settings = settings.without_tolerances()
    after, before = fit_all(fair, [best.values, current.values], 3, fresh=[NONE, NONE], settings=settings.fit)
    ratio = (before.cost - after.cost) / dispersion(after, blocks)
    knobs = len(after.knobs) - len(before.knobs)
    # far above the noise residuals are coloured and the ratio cautious: a quarter of what is left asks for less of it
    sizeable = left > settings.steps.far_from_floor * ruler.floor and removed > settings.sizeable * left
    least = settings.beyond_doubt_sizeable if sizeable else settings.beyond_doubt
    closes = left > ruler.floor and removed > settings.most * left  # the search is not finished while one effect does
    if closes:
        least = min(least, settings.beyond_doubt_most)
    convinces = ratio >= least + settings.per_knob * knobs
    if not convinces and not (closes and _clear_alone(fair, current, best, blocks, settings)):
        return None
    return None if _stands_for_the_step(ruler, current, best, removed, settings) else best


def _clear_alone(fair: Problem, current: Fit, best: Fit, blocks: np.ndarray, settings: SearchSettings) -> bool:
    """Whether the best fit is beyond doubt if nothing else differs. Small differences in everything, of which each
    remains possible, make no effect of their own size likely; that most of what is left is one of them is the simpler
    account."""
    if fair.marginal is None:
        return False  # it has been asked already
    strict = settings.without_tolerances()
    alone = tolerating(fair, None)
    after, before = fit_all(alone, [best.values, current.values], 3, fresh=[NONE, NONE], settings=settings.fit)
    knobs = len(after.knobs) - len(before.knobs)
    return before.cost - after.cost >= (strict.beyond_doubt + strict.per_knob * knobs) * dispersion(after, blocks)


def _stands_for_the_step(ruler: Ruler, current: Fit, best: Fit, removed: float, settings: SearchSettings) -> bool:
    """Whether what the best fit removes is the error of the model's own time step: it is within a multiple of that, and
    with an infinitely small step less than half of it is left."""
    step = ruler.step_error(best)
    if removed < settings.over_floor * step:
        return True
    if removed > settings.steps.beyond_step * step:
        return False
    finely = ruler.finely_stepped([current, best])
    return finely is not None and finely[0] - finely[1] < settings.steps.lasting * removed
