"""What a user is told before the answer stands: a first look at the gap, and the best set of effects so far."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import gap_of
from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.screen import best_leads, gap_weights
from residual_mpc.diagnosis.search.stepwise import Accepted
from residual_mpc.models.settings import TUNE, Settings, Term, Values

NAMED = 3  # leads that are told
FEWEST = 4  # windows of a first look


@dataclass(frozen=True)
class Lead:
    """An effect that resembles the gap; shrink: the share of the gap that its replay promises to remove alone."""

    term: Term
    shrink: float


@dataclass(frozen=True)
class FirstLook:
    """The nominal model's gap on some windows of `horizon` s, what noise makes of it, each channel's share of its
    square, and the effects that resemble it most, best first: each replayed, none fitted; none of them where the gap is
    as small as the sensors can tell."""

    horizon: float
    gap: float
    noise_floor: float
    channels: dict[str, float]
    leads: tuple[Lead, ...]


@dataclass(frozen=True)
class SoFar:
    """The best set of effects while a search goes on: its numbers, and the gap on the search's windows without any
    effect and with them. Nothing of it has been tested on held-out windows."""

    horizon: float
    windows: int
    before: float
    after: float
    noise_floor: float
    values: Values

    @property
    def terms(self) -> tuple[Term, ...]:
        """The effects, in the order in which they were found."""
        return tuple(dict.fromkeys(k.term for k in self.values if k.effect != TUNE))


EarlyAnswer = FirstLook | SoFar
Told = Callable[[EarlyAnswer], None]


def unheard(answer: EarlyAnswer) -> None:
    """Ignore the answer."""


def first_look(prepared: Prepared) -> FirstLook:
    """A look that costs about `first_look` simulation steps (see PhaseSettings), whatever the robot."""
    space, settings = prepared.space, prepared.options.settings
    steps = prepared.options.phases.first_look
    windows, scales = prepared.headline
    some = windows.take(_some(windows, steps // 6))
    missed = gap_of(some, scales, some.y - predict(some, Settings(1))[0])
    noise = gap_of(some, scales, noise_errors(some, Settings(1), np.random.default_rng(0), 1)[0])
    squares = np.nan_to_num(missed.channels**2)
    shares = squares / max(float(squares.sum()), 1e-300)

    half = shorten(windows, 0.5)
    few = half.take(_some(half, steps // max(sum(len(space.probes(t)) for t in space.candidates), 1)))
    quick = quickened(few, scales, settings=settings.predict)
    problem = build_problem(quick, space, few.sigma, scales.motion, settings=settings.predict)
    nominal = fit_all(problem, [{k: space.null(k) for k in space.tunables}], 0, settings=settings.search.fit)[0]
    whole = float(gap_weights(problem) @ nominal.r.ravel() ** 2)
    removed = [(lead.term, lead.gap / max(whole, 1e-300)) for lead in best_leads(problem, nominal, space.candidates)]
    leads = [Lead(term, 1.0 - float(np.sqrt(max(1.0 - share, 0.0)))) for term, share in removed if share > 0.0]
    if missed.total <= AS_GOOD * noise.total:
        leads = []
    channels = {c: float(s) for c, s in zip(some.channels, shares, strict=True) if s > 0.0}
    return FirstLook(windows.horizon, missed.total, noise.total, channels, tuple(leads[:NAMED]))


def so_far(ruler: Ruler, base: Fit, best: Fit) -> SoFar:
    """What the search stands at."""
    before, after = np.sqrt(ruler.squared([base, best]))
    data = ruler.replays.data
    return SoFar(data.horizon, data.count, float(before), float(after), float(np.sqrt(ruler.floor)), dict(best.values))


def improving(told: Told) -> Accepted:
    """What a search on one set of windows tells: each set that leaves less than those told before it."""
    least = np.inf

    def accepted(ruler: Ruler, base: Fit, best: Fit) -> None:
        nonlocal least
        answer = so_far(ruler, base, best)
        if answer.after < least:
            least = answer.after
            told(answer)

    return accepted


def _some(data: Dataset, steps: int) -> np.ndarray:
    """(W,) bool: windows over all runs, worth so many simulation steps, and no fewer than a few."""
    count = int(np.clip(steps // max(b.steps for b in data.blocks), min(FEWEST, data.count), data.count))
    return np.isin(np.arange(data.count), np.linspace(0, data.count - 1, count).round().astype(int))
