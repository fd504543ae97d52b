"""The gaps of an explanation, over every horizon, against those that noise alone makes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.constant_velocity import constant_velocity
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Gap, Scales, gap_of, per_window, window_trust
from residual_mpc.diagnosis.data.left_out import across
from residual_mpc.diagnosis.data.noise_model import ChannelNoise
from residual_mpc.diagnosis.data.unknown_past import has_memory, runs_with_unknown_past, soon_after_unknown_past
from residual_mpc.diagnosis.fit.noise_left import noise_left
from residual_mpc.diagnosis.predict.horizons import FORETOLD, HorizonWindows
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.noise_floor import (
    AS_GOOD,
    NoiseFloor,
    beyond_luck,
    floor_draws,
    floor_of,
    floor_under,
)
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.step_error import step_error
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.forecast import worse_than_forecast
from residual_mpc.diagnosis.results.makes_smaller import makes_smaller
from residual_mpc.diagnosis.results.own_step import Seen, only_the_step
from residual_mpc.diagnosis.results.quantiles import quantiles
from residual_mpc.diagnosis.results.records import GapFigures, HorizonFigures
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import (
    HorizonGaps,
    Verdict,
    clearest,
    deciding,
    hardly_explained,
    left_share,
    verdict_of,
)
from residual_mpc.effects.laws import is_law
from residual_mpc.models.settings import Settings

COARSE = 0.3  # of what effects remove, from which on the time step may be the cause


@dataclass(frozen=True, eq=False)
class ExplanationGaps:
    """of: the explanation, on data with the noise that it leaves. predicted and errors (W, M, C), channel units, of the
    "nominal" model (errors alone), "before" (its tunable numbers fitted) and "after" the effects; looks: the gaps
    over each horizon, the headline's first, and anywhere: whether they are beyond the noise on all windows; helps:
    whether the explanation makes the gap smaller; useless: whether even the explained model is worse than a
    forecast of constant velocity; constant_velocity: the gap of that forecast; step_error: that of the model's own
    time step, None where it has none; stepping: whether without it there is no gap beyond the noise; blinded: whether
    no gap is seen because the sensors' noise alone makes a perfect model worse than that forecast. floors (draws, W,
    M, C): errors of a perfect model."""

    of: FittedExplanation
    predicted: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]
    everywhere: dict[str, float]
    floors: np.ndarray
    floor_everywhere: NoiseFloor
    looks: tuple[HorizonGaps, ...]
    anywhere: bool
    helps: bool
    useless: bool
    constant_velocity: float
    step_error: float | None
    stepping: bool
    blinded: bool

    @property
    def coarse(self) -> bool:
        """Whether the time step's error could make what the effects explain: it is beyond the noise, and no small part
        of what they remove."""
        first = self.looks[0]
        removed = max(first.before.total**2 - self.left.total**2, 0.0) ** 0.5
        return self.step_error is not None and self.step_error > max(first.floor.total, COARSE * removed)

    @property
    def told(self) -> bool:
        """Whether no more is left than the sensors can tell."""
        return all(x.steady.total <= AS_GOOD * x.floor.total for x in deciding(self.looks))

    def left_by_step(self, settings: ResultSettings) -> bool:
        """Whether the error of the model's own time step is most of what is left beyond the noise."""
        excess = max(self.left.total**2 - self.looks[0].floor.total**2, 0.0)
        return self.step_error is not None and self.step_error**2 >= settings.gaps.step_most * excess

    @property
    def verdict(self) -> tuple[Verdict, float]:
        """And the share of the squared gap beyond the floor that is left."""
        if not self.helps:
            return ("unknown", 1.0) if self.anywhere or self.blinded else ("no_gap", 0.0)
        verdict = verdict_of(self.looks)
        if verdict == "effects" and any(is_law(t.effect) for t in self.of.final.terms):
            verdict = "partial"  # a law names no cause
        if verdict == "effects" and hardly_explained(clearest(self.looks)):
            verdict = "partial"
        return verdict, left_share(self.looks[0])

    @property
    def left(self) -> Gap:
        """The gap that is left at the headline's horizon, on the windows that are judged."""
        return self.looks[0].after if self.helps else self.looks[0].before

    def figures(self) -> GapFigures:
        """As the document has them; an explanation that does not help leaves the gap as it was."""
        first, data = self.looks[0], self.of.raw
        still, compared = self.of.scales.still, self.of.scales.compared
        return GapFigures(
            nominal=first.nominal.total,
            before=first.before.total,
            after=self.left.total,
            noise_floor=first.floor.total,
            horizon=first.horizon,
            windows=first.windows,
            skipped=data.skipped,
            still=tuple(c for c, s, m in zip(data.channels, still, compared, strict=True) if s and m),
            channels=_channels(data, first, self.helps),
            horizons=tuple(self._horizon(data, look) for look in self.looks),
            constant_velocity=self.constant_velocity,
            step_error=self.step_error,
            own_step=self.stepping,
            blinded=self.blinded,
        )

    def _horizon(self, data: Dataset, look: HorizonGaps) -> HorizonFigures:
        return HorizonFigures(
            horizon=look.horizon,
            nominal=look.nominal.total,
            before=look.before.total,
            after=(look.after if self.helps else look.before).total,
            noise_floor=look.floor.total,
            windows=look.windows,
            held_out=look.held_out,
            channels=_channels(data, look, self.helps),
            window_gaps={
                "before": look.quantiles["before"],
                "after": look.quantiles["after" if self.helps else "before"],
            },
        )


def measure_gaps(
    of: FittedExplanation,
    longer: Sequence[HorizonWindows],
    steps: int,
    rng: np.random.Generator,
    settings: ResultSettings,
    judged: ExplanationGaps | None = None,
    unknown_starts: np.ndarray | None = None,
) -> ExplanationGaps:
    """Opens the held-out windows. steps: see `floor_draws`; judged: the gaps of the new readings of slow sensors, which
    say whether there is a gap and what helps; unknown_starts (R,) bool: further runs at whose start earlier commands
    may still act."""
    rows = of.space.settings([{}, of.base.values, of.final.values])
    nominal, before, _ = predict(of.raw, rows)
    after = predict(of.after_data, rows)[2]
    predicted = {"before": before, "after": after}
    errors = {"nominal": of.raw.y - nominal, "before": of.raw.y - before, "after": of.after_data.y - after}
    test, scales = of.test, of.scales
    forecast = of.raw.y - constant_velocity(of.raw)
    steady = gap_of(of.raw, scales, forecast, test).total
    if judged is None:
        helps, useless = _helps(of, longer, rows, errors, forecast, settings)
    else:
        helps, useless = judged.helps, judged.useless
    row = rows.take(np.array([2 if helps else 1]))
    noise = _noise(of, longer, row, settings=settings)
    raw, seen = replace(of.raw, noise=noise), replace(of.after_data, noise=noise)
    quick = quickened(seen, scales, settings=settings.predict, row=row)
    floors = noise_errors(quick, row, rng, floor_draws(seen, steps, settings=settings.predict), seen)
    floor = floor_under(seen, scales, floors, test, settings=settings.predict)
    everywhere = floor_under(seen, scales, floors, np.ones(seen.count), settings=settings.predict)
    unknown = runs_with_unknown_past(of.clean, settings.data.unknown_past)
    unknown = (unknown if unknown_starts is None else unknown | unknown_starts) & has_memory(row)
    looks = [_look(raw, scales, errors, test, bool(of.held.any()), floor, unknown, settings=settings)]
    # outliers count as a gap if they are named, or if their effect is excluded
    jumps = of.unnamed_outliers or (of.with_outliers and helps)
    # beyond the noise on all windows, and on the very windows that the figures are printed for
    whole = (raw, errors["before"]) if jumps else _nominal_errors(of.clean, rows)
    horizons = [Seen(whole[0], whole[1], scales, everywhere)]
    anywhere = horizons[0].beyond_noise(settings) and beyond_luck(looks[0].before, floor)
    for look in longer:
        more, all_before, all_floor = _longer(of, look, rows, row, noise, rng, jumps, unknown, settings=settings)
        if all_floor.total < FORETOLD:
            looks.append(more)
            horizons.append(Seen(all_before[0], all_before[1], look.scales, all_floor))
            anywhere = anywhere or horizons[-1].beyond_noise(settings)
    if judged is None:
        stepping = anywhere and only_the_step(horizons, rows.take(np.array([1])), settings=settings)
        anywhere = anywhere and not stepping
        blinded = not anywhere and not stepping and bool(floor.total > np.fmax(steady, settings.gaps.useless))
    else:
        anywhere, stepping, blinded = judged.anywhere, judged.stepping, judged.blinded
    helps = helps and anywhere  # nothing to explain is no gap, whatever fits better
    return ExplanationGaps(
        replace(of, raw=raw, clean=replace(of.clean, noise=noise)),
        predicted,
        errors,
        {k: gap_of(raw, scales, e).total for k, e in errors.items()},
        floors,
        everywhere,
        tuple(looks),
        anywhere,
        helps,
        useless,
        steady,
        step_error(of.raw, scales, row, settings=settings.data),
        stepping,
        blinded,
    )


def _helps(
    of: FittedExplanation,
    longer: Sequence[HorizonWindows],
    rows: Settings,
    errors: dict[str, np.ndarray],
    forecast: np.ndarray,
    settings: ResultSettings,
) -> tuple[bool, bool]:
    """Whether the explanation makes the gap smaller, and whether even with it the model is useless, which no
    explanation helps; forecast (W, M, C): errors of a forecast of constant velocity."""
    trust = window_trust(of.raw, of.scales, errors["before"], settings=settings.data)
    helps = of.anything and makes_smaller(of, longer, rows, errors, trust, settings=settings)
    usual = trust * (of.test & ~across(of.raw, of.aside))
    left = errors["after" if helps else "before"]
    useless = worse_than_forecast(of.raw, of.scales, left, forecast, usual, settings=settings)
    return helps and not useless, useless


def _noise(
    of: FittedExplanation, longer: Sequence[HorizonWindows], row: Settings, settings: ResultSettings
) -> tuple[ChannelNoise, ...]:
    """The noise that the model leaves on the windows that fits may see: of the next longer horizon, where there is one,
    since slow noise does not show in short windows, and no more than there is in short ones."""
    free = [look.free for look in longer if look.free is not None]
    headline = (of.clean.take(of.free), of.scales)
    return noise_left(headline, free[0] if free else None, of.space, row, settings=settings.fit)


def _look(
    data: Dataset,
    scales: Scales,
    errors: dict[str, np.ndarray],
    test: np.ndarray,
    held_out: bool,
    floor: NoiseFloor,
    unknown: np.ndarray,
    settings: ResultSettings,
) -> HorizonGaps:
    """unknown (R,) bool: runs with an unknown past, whose first windows say nothing of the model."""
    gaps = {k: gap_of(data, scales, e, test) for k, e in errors.items()}
    early = test & soon_after_unknown_past(data, unknown, settings.data.unknown_past)
    judged = test if early.sum() == test.sum() else test & ~early
    trust = window_trust(data, scales, errors["after"], settings=settings.data)
    steady = gap_of(data, scales, errors["after"], trust * judged)
    return HorizonGaps(
        data.horizon, int(test.sum()), bool(held_out), gaps["nominal"], gaps["before"], gaps["after"], steady, floor,
        {k: quantiles(per_window(data, scales, errors[k])[test], data.take(test)) for k in ("before", "after")},
        int(early.sum()),
    )  # fmt: skip


def _longer(
    of: FittedExplanation,
    look: HorizonWindows,
    rows: Settings,
    row: Settings,
    noise: tuple[ChannelNoise, ...],
    rng: np.random.Generator,
    jumps: bool,
    unknown: np.ndarray,
    settings: ResultSettings,
) -> tuple[HorizonGaps, tuple[Dataset, np.ndarray], NoiseFloor]:
    """The gaps over a longer horizon on the windows that are judged, and errors and floor of the model on all of them;
    jumps: with the samples that jump away."""
    raw = replace(look.raw, noise=noise)
    seen = replace(look.clean, noise=noise) if of.with_outliers else raw
    nominal, before, _ = predict(raw, rows)
    errors = {"nominal": raw.y - nominal, "before": raw.y - before, "after": seen.y - predict(seen, rows)[2]}
    floor = floor_of(seen, look.scales, row, rng, settings=settings.predict)
    judged = (
        floor if look.test.all() else floor_of(seen.take(look.test), look.scales, row, rng, settings=settings.predict)
    )
    here = _look(raw, look.scales, errors, look.test, bool(look.held.any()), judged, unknown, settings=settings)
    whole = (raw, errors["before"]) if jumps else _nominal_errors(look.clean, rows)
    return here, whole, floor


def _nominal_errors(data: Dataset, rows: Settings) -> tuple[Dataset, np.ndarray]:
    """The windows, and what the model with its tunable numbers fitted, the second of `rows`, leaves there (W, M, C)."""
    return data, data.y - predict(data, rows.take(np.array([1])))[0]


def _channels(data: Dataset, look: HorizonGaps, helps: bool) -> dict[str, tuple[float, float, float]]:
    after = look.after if helps else look.before
    return {
        c: (float(look.before.channels[k]), float(after.channels[k]), float(look.floor.channels[k]))
        for k, c in enumerate(data.channels)
        if np.isfinite(look.before.channels[k])
    }
