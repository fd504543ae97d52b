"""The same runs over several horizons: what adds up slowly shows over seconds, not within one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset, window_starts
from residual_mpc.diagnosis.data.gap import Scales, gap_of, measure_scales
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.left_out import telling, unfit, unfit_spans, untold, without
from residual_mpc.diagnosis.data.outliers import with_outliers_removed
from residual_mpc.diagnosis.data.stale import without_repeats
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings

LONGER, LONGEST = 5.0, 30.0  # s: the horizons that are looked at (contract, section 4)
FORETOLD = 0.1  # noise floor up to which a motion counts as foretold (contract, section 4)


@dataclass(frozen=True, eq=False)
class HorizonWindows:
    """The runs over one horizon. raw: all its W windows as they were logged, clean: less the samples that jump away;
    held (W,) bool: the windows that lie in what is held out; free: the windows that fits may see, cut from whatever
    lies between and shorter where that is, with the scales of their motion; None where nothing there is longer than
    the horizon before."""

    horizon: float
    raw: Dataset
    clean: Dataset
    scales: Scales
    held: np.ndarray
    free: "tuple[Dataset, Scales] | None"

    def take(self, keep: np.ndarray) -> "HorizonWindows":
        """The windows of `raw` where the mask (W,) is true."""
        return replace(self, raw=self.raw.take(keep), clean=self.clean.take(keep), held=self.held[keep])

    def of_new_readings(self) -> "HorizonWindows":
        """Without what slow sensors repeat."""
        return replace(self, raw=without_repeats(self.raw))

    @property
    def test(self) -> np.ndarray:
        """(W,) bool: the windows that figures are printed for: those held out; where there are none, all that tell
        something of the robot."""
        return self.held if self.held.any() else telling(self.raw)


def longer_horizons(runs: Sequence[Run], horizon: float, settings: PredictSettings) -> tuple[float, ...]:
    """s: 5 s and the longest up to 30 s that the runs hold at least a few windows of, each well beyond the one
    before."""
    lengths = np.array([r.t[-1] - r.t[0] for r in runs])
    out: list[float] = []
    for wanted in (LONGER, float(min(LONGEST, np.floor(np.median(lengths) / LONGER) * LONGER))):
        fits = int(np.floor(lengths / wanted + 1e-6).sum()) if wanted > 0.0 else 0
        if fits >= settings.horizons.fewest and wanted >= settings.horizons.apart * max([horizon, *out]):
            out.append(wanted)
    return tuple(out)


def full_windows(runs: Sequence[Run], horizon: float) -> list[np.ndarray]:
    """Where the windows of each run begin, s; a run that is shorter than the horizon has none."""
    return [window_starts(r, horizon) if r.t[-1] - r.t[0] >= horizon - r.period else r.t[:0] for r in runs]


def windows_over(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float,
    shorter: float,
    kept: Sequence[KeptBack],
    flagged: Mapping[tuple[int, str], np.ndarray],
    unknown: np.ndarray,
    settings: PredictSettings,
) -> HorizonWindows | None:
    """The runs over a horizon, of which `shorter` is the one before; None where nothing moves or no window has a
    measured start."""
    whole = full_windows(runs, horizon)
    if sum(map(len, whole)) < settings.horizons.fewest:
        return None
    try:
        raw = build_dataset(runs, robots, noise, horizon, whole, settings=settings.data)
        scales = measure_scales(raw)
        if unfit(raw).all():
            return None
        raw = raw.take(~untold(raw))
    except BadInput:  # said already, of the first horizon
        return None
    clean = with_outliers_removed(raw, flagged)
    spans = [held_spans(r, kept) for r in runs]
    held = np.array([_inside(spans[i], t, t + horizon) for i, t in zip(raw.run, raw.start, strict=True)])
    return HorizonWindows(
        horizon,
        raw,
        clean,
        scales,
        held,
        _free(runs, robots, noise, horizon, shorter, spans, flagged, unknown, settings=settings),
    )


def windows_between(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float,
    kept: Sequence[KeptBack],
    flagged: Mapping[tuple[int, str], np.ndarray],
    unknown: np.ndarray,
    settings: PredictSettings,
) -> tuple[Dataset, Scales] | None:
    """The windows of this horizon outside the held-out spans, with the scales of their motion; None if too few have a
    measured start, or nothing moves."""
    spans = [held_spans(r, kept) for r in runs]
    return _cut(runs, robots, noise, horizon, spans, flagged, unknown, settings)


def _free(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float,
    shorter: float,
    spans: Sequence[Sequence[tuple[float, float]]],
    flagged: Mapping[tuple[int, str], np.ndarray],
    unknown: np.ndarray,
    settings: PredictSettings,
) -> tuple[Dataset, Scales] | None:
    """The longest windows up to the horizon of which enough lie between what is held out."""
    horizons = settings.horizons
    for length in (horizon, *(x for x in horizons.lengths if x < horizon)):
        if length < horizons.apart * shorter:
            break
        cut = _cut(runs, robots, noise, length, spans, flagged, unknown, settings)
        if cut is not None:
            return cut
    return None


def _cut(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    length: float,
    spans: Sequence[Sequence[tuple[float, float]]],
    flagged: Mapping[tuple[int, str], np.ndarray],
    unknown: np.ndarray,
    settings: PredictSettings,
) -> tuple[Dataset, Scales] | None:
    spans = [joined_spans([*s, *unfit_spans(r)]) for r, s in zip(runs, spans, strict=True)]
    between = [free_starts(r, s, length) for r, s in zip(runs, spans, strict=True)]
    past = settings.data.unknown_past
    skips = past.forgotten * unknown  # (R,) s
    later = [free_starts(r, s, length, float(x)) for r, s, x in zip(runs, spans, skips, strict=True)]
    if sum(map(len, later)) >= max(settings.horizons.fewest, (1.0 - past.most_longer) * sum(map(len, between))):
        between = later
    if sum(map(len, between)) < settings.horizons.fewest:
        return None
    try:
        cut = build_dataset(runs, robots, noise, length, between, settings=settings.data)
        cut = with_outliers_removed(without(cut, untold(cut)), flagged)
        return cut, measure_scales(cut)
    except BadInput:  # none has a measured start, or nothing moves
        return None


def foretold(clean: Dataset, scales: Scales, rng: np.random.Generator, settings: PredictSettings) -> bool:
    """Whether the nominal model predicts these windows: its noise floor stays under FORETOLD, and none diverges."""
    some = clean.take(evenly(clean, settings.horizons.look_steps, settings=settings.data))
    if not np.isfinite(predict(some, Settings(1))[0][np.isfinite(some.y)]).all():
        return False
    return bool(gap_of(some, scales, noise_errors(some, Settings(1), rng, 1)[0]).total < FORETOLD)


def held_spans(run: Run, kept: Sequence[KeptBack]) -> list[tuple[float, float]]:
    """What is held out of a run, s, neighbours joined, in order."""
    return joined_spans(
        [(-np.inf, np.inf) if k.start is None or k.end is None else (k.start, k.end) for k in kept if k.run == run.name]
    )


def joined_spans(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The spans, s, in order, those that meet as one."""
    out: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if out and begin <= out[-1][1] + 1e-6:
            out[-1] = (out[-1][0], max(out[-1][1], end))
        else:
            out.append((begin, end))
    return out


def _inside(spans: Sequence[tuple[float, float]], begin: float, end: float) -> bool:
    return any(a - 1e-6 <= begin and end <= b + 1e-6 for a, b in spans)


def free_starts(run: Run, spans: Sequence[tuple[float, float]], horizon: float, skip: float = 0.0) -> np.ndarray:
    """(W,) s: windows one after the other in each stretch between what is held out, from `skip` s after the first stamp
    on."""
    first = float(run.t[0]) + skip
    edges = [first, *(max(x, first) for span in spans for x in span), float(run.t[-1])]
    out = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        slack = run.period if end >= run.t[-1] else 0.0  # none of what is held out
        count = int(np.floor((end - begin + slack) / horizon + 1e-9)) if end > begin else 0
        out.append(begin + horizon * np.arange(count))
    return np.concatenate(out)
