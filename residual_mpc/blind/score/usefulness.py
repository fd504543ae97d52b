"""Whether the diagnosed model is of use: its gap beside those of the nominal model, of a perfect one, and of a
forecast that knows no model and lets every channel move on at constant velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from residual_mpc.blind.score.claim import Claim
from residual_mpc.blind.score.rates import Rate, rate


@dataclass(frozen=True)
class Usefulness:
    """Medians over the cases of the gaps on held-out runs, None where nobody stated one; useful: cases whose
    diagnosed model is better than the forecast; nominal_useful: cases whose nominal model is."""

    before: float | None
    after: float | None
    noise_floor: float | None
    constant_velocity: float | None
    useful: Rate
    nominal_useful: Rate

    def document(self) -> dict[str, Any]:
        """As plain JSON values."""
        return {
            "before": self.before,
            "after": self.after,
            "noise_floor": self.noise_floor,
            "constant_velocity": self.constant_velocity,
            "useful": self.useful.document(),
            "nominal_useful": self.nominal_useful.document(),
        }


def usefulness(claims: Sequence[Claim]) -> Usefulness:
    """The gaps of ``claims``."""

    def middle(name: str) -> float | None:
        return median(stated) if (stated := [c.gap[name] for c in claims if name in c.gap]) else None

    def better(name: str) -> Rate:
        both = [c.gap for c in claims if name in c.gap and "constant_velocity" in c.gap]
        return rate(g[name] < g["constant_velocity"] for g in both)

    return Usefulness(
        before=middle("before"),
        after=middle("after"),
        noise_floor=middle("noise_floor"),
        constant_velocity=middle("constant_velocity"),
        useful=better("after"),
        nominal_useful=better("before"),
    )
