"""Rates with their intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

_Z = 1.959964  # two-sided 95 %


@dataclass(frozen=True)
class Rate:
    """``hits`` out of ``count``."""

    hits: int
    count: int

    @property
    def value(self) -> float | None:
        """The rate; None where nothing was counted."""
        return self.hits / self.count if self.count else None

    @property
    def ci95(self) -> tuple[float, float] | None:
        """Wilson's score interval (Wilson 1927), which stays inside [0, 1] and is sound at 0 and 1."""
        if not self.count:
            return None
        n, p, z2 = self.count, self.hits / self.count, _Z**2
        middle = (p + z2 / (2 * n)) / (1 + z2 / n)
        half = _Z / (1 + z2 / n) * sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        return max(0.0, middle - half), min(1.0, middle + half)

    def document(self) -> dict[str, object]:
        """As plain JSON values."""
        ci = self.ci95
        return {
            "value": self.value,
            "ci95": None if ci is None else list(ci),
            "hits": self.hits,
            "count": self.count,
        }


def rate(outcomes: Iterable[bool | None]) -> Rate:
    """The rate of True among the outcomes that are not None."""
    known = [o for o in outcomes if o is not None]
    return Rate(sum(known), len(known))
