"""How the size of an effect varies over the runs."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Instant:
    """run: its name; t: s from the run's first sample."""

    run: str
    t: float


@dataclass(frozen=True)
class Variation:
    """by_run: the size in each run, in the unit of the effect's first parameter; by_motion: in windows in which the
    robot moves little ("small"), more ("medium") and most ("large"); by_position: in windows in which the joint is in
    the lower, the middle and the upper third of its positions ("low", "middle", "high"); since, until: when the effect
    begins or ends. None for what it does not do."""

    by_run: dict[str, float] | None = None
    by_motion: dict[str, float] | None = None
    by_position: dict[str, float] | None = None
    since: Instant | None = None
    until: Instant | None = None

    def document(self) -> dict[str, Any]:
        """As diagnosis.json has it: keys for what there is."""
        sizes = {"by_run": self.by_run, "by_motion": self.by_motion, "by_position": self.by_position}
        out: dict[str, Any] = {name: dict(found) for name, found in sizes.items() if found is not None}
        for name, at in (("since", self.since), ("until", self.until)):
            if at is not None:
                out[name] = {"run": at.run, "t": at.t}
        return out
