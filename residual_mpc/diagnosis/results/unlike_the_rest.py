"""Stretches that are unlike everything else: a motor that is off for seconds, a push, a collision."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.left_out import blocks_of
from residual_mpc.diagnosis.predict.horizons import joined_spans
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.results.settings import AsideSettings
from residual_mpc.models.settings import Settings, Term

DRAWS = 3  # of the noise


@dataclass(frozen=True)
class Unlike:
    """stretches: which; gap: of their worst window; usual: of the median window; serving: effects that would explain
    some of them, and nothing else."""

    stretches: tuple[KeptBack, ...] = ()
    gap: float = 0.0
    usual: float = 0.0
    serving: tuple[Term, ...] = ()

    def sentence(self, horizon: float) -> str:
        """Which stretches are unlike the rest, and by how much. horizon: of the gaps, s."""
        where = ", ".join(f"{k.run} from {k.start:.4g} to {k.end:.4g} s" for k in self.stretches)
        verb = "is" if len(self.stretches) == 1 else "are"
        return (
            f"{where} {verb} unlike everything else (a gap of {self.gap:.2g} over {horizon:g} s against "
            f"{self.usual:.2g} in the median window)"
        )

    def document(self, horizon: float) -> dict[str, object] | None:
        """What diagnosis.json says of it."""
        if not self.stretches:
            return None
        them = "it" if len(self.stretches) == 1 else "them"
        by = f" {', '.join(map(str, self.serving))} would explain {them}, and nothing else." if self.serving else ""
        return {
            "stretches": [k.document() for k in self.stretches],
            "gap": self.gap,
            "usual": self.usual,
            "note": f"{self.sentence(horizon)}: look at what happened there. The causes and their probabilities are "
            f"those of all else.{by}",
        }


def unlike_the_rest(
    data: Dataset, gaps: np.ndarray, settings: AsideSettings, floor: np.ndarray | float = 0.0
) -> Unlike:
    """Where the windows' own gaps (W,) are by far larger than anywhere else, if that is in few and short stretches, and
    most of what is left is there; NaN: a window with nothing to compare. floor (W,): those of a perfect model."""
    seen = np.nan_to_num(gaps)
    if data.count < settings.fewest:
        return Unlike()
    seen = np.where(seen > settings.noise * np.nan_to_num(floor), seen, 0.0)
    odd = seen > max(settings.unlike * float(np.quantile(seen, settings.usual)), settings.least)
    if not odd.any() or odd.mean() > settings.most or np.sum(seen[odd] ** 2) < settings.share * np.sum(seen**2):
        return Unlike()
    stretches = _stretches(data, odd, settings.apart)
    if len(stretches) > settings.stretches:
        return Unlike()
    return Unlike(stretches, float(seen.max()), float(np.nanmedian(gaps)))


def floor_of_each(data: Dataset, scales: Scales, drawn: np.ndarray) -> np.ndarray:
    """(W,) the windows' own gaps of a perfect model; drawn (draws, W, M, C): its errors."""
    return np.sqrt(np.mean([np.nan_to_num(per_window(data, scales, e)) for e in drawn], axis=0))


def drawn_floor(data: Dataset, scales: Scales, row: Settings) -> np.ndarray:
    """(W,) the same of the model `row`, from a few draws of the noise."""
    return floor_of_each(data, scales, noise_errors(data, row, np.random.default_rng(0), DRAWS))


def joined_stretches(first: Sequence[KeptBack], second: Sequence[KeptBack]) -> tuple[KeptBack, ...]:
    """Both, those that meet as one."""
    spans: dict[str, list[tuple[float, float]]] = {}
    for k in (*first, *second):
        assert k.start is not None and k.end is not None
        spans.setdefault(k.run, []).append((k.start, k.end))
    return tuple(KeptBack(run, *span) for run in sorted(spans) for span in joined_spans(spans[run]))


def _stretches(data: Dataset, odd: np.ndarray, apart: int) -> tuple[KeptBack, ...]:
    """The stretches that the windows `odd` (W,) make, with up to `apart` others between two of one."""
    out: list[KeptBack] = []
    for i in np.unique(data.run[odd]):
        out += blocks_of(data.runs[int(i)].name, data.start[odd & (data.run == i)], data.horizon, apart)
    return tuple(out)
