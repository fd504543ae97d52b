"""The gaps of an explanation, on the held-out windows and on all, against those that noise alone makes."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Gap, gap_of
from residual_mpc.diagnosis.records import GapFigures, Verdict
from residual_mpc.diagnosis.replay import predict
from residual_mpc.diagnosis.thinning import floor_draws

LUCK = 4.0  # standard deviations of a perfect model's squared gap that chance is allowed


@dataclass(frozen=True, eq=False)
class Measured:
    """of: the explanation. predicted and errors (W, M, C), channel units, gaps on the held-out windows and totals
    everywhere, each of the "nominal" model (gaps and errors alone), "before" (its tunable numbers fitted) and "after"
    the effects. floors (draws, W, M, C): errors of a perfect model; draws, draws_everywhere (draws,) their squared
    gaps."""

    of: Explained
    predicted: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]
    gaps: dict[str, Gap]
    everywhere: dict[str, float]
    floors: np.ndarray
    draws: np.ndarray
    draws_everywhere: np.ndarray

    @property
    def floor(self) -> float:
        return float(np.sqrt(self.draws.mean()))

    @property
    def floor_everywhere(self) -> float:
        return float(np.sqrt(self.draws_everywhere.mean()))

    @property
    def helps(self) -> bool:
        """Whether the explanation makes the gap on the held-out windows smaller."""
        return self.of.anything and self.gaps["after"].total < self.gaps["before"].total

    def verdict(self, margin: float) -> tuple[Verdict, float]:
        """And the share of the squared gap beyond the floor that is left. margin: over the floor, that is no gap."""
        if not self.helps:
            # beyond the noise everywhere, and on the very windows that the figures are printed for
            beyond = self.everywhere["before"] > max(margin * self.floor_everywhere, with_luck(self.draws_everywhere))
            beyond &= self.gaps["before"].total > with_luck(self.draws)
            return ("unknown", 1.0) if beyond else ("no_gap", 0.0)
        excess = max(self.gaps["before"].total ** 2 - self.floor**2, 1e-12)
        share = float(np.clip((self.gaps["after"].total ** 2 - self.floor**2) / excess, 0.0, 1.0))
        return "effects" if share <= 0.25 else "partial", share

    def figures(self, horizon: float) -> GapFigures:
        """As the document has them; an explanation that does not help leaves the gap as it was."""
        data, after = self.of.raw, self.gaps["after" if self.helps else "before"]
        test, clean = self.of.test, self.of.after_data
        floor = np.sqrt(np.mean([gap_of(clean, self.of.scales, e, test).channels ** 2 for e in self.floors], axis=0))
        still, before = self.of.scales.still, self.gaps["before"]
        return GapFigures(
            nominal=self.gaps["nominal"].total,
            before=before.total,
            after=after.total,
            noise_floor=self.floor,
            horizon=horizon,
            windows=int(test.sum()),
            skipped=data.skipped,
            still=tuple(c for c, s, m in zip(data.channels, still, self.of.scales.compared, strict=True) if s and m),
            channels={
                c: (float(before.channels[k]), float(after.channels[k]), float(floor[k]))
                for k, c in enumerate(data.channels)
                if not still[k]
            },
        )


def measure(of: Explained, steps: int, rng: np.random.Generator) -> Measured:
    """Opens the held-out windows. steps: see `floor_draws`."""
    after_data, scales, test = of.after_data, of.scales, of.test
    rows = of.space.settings([{}, of.base.values, of.final.values])
    nominal, before, _ = predict(of.raw, rows)
    after = predict(after_data, rows)[2]
    errors = {"nominal": of.raw.y - nominal, "before": of.raw.y - before, "after": after_data.y - after}
    floors = noise_errors(after_data, of.space.settings([of.final.values]), rng, floor_draws(after_data, steps))
    return Measured(
        of,
        {"before": before, "after": after},
        errors,
        {k: gap_of(of.raw, scales, e, test) for k, e in errors.items()},
        {k: gap_of(of.raw, scales, e).total for k, e in errors.items()},
        floors,
        np.square([gap_of(after_data, scales, e, test).total for e in floors]),
        np.square([gap_of(after_data, scales, e).total for e in floors]),
    )


def with_luck(draws: np.ndarray) -> float:
    """The gap that noise hardly ever exceeds, from squared gaps that it alone made."""
    return float(np.sqrt(draws.mean() + LUCK * draws.std(ddof=1)))
