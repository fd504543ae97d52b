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
    robot moves little ("small"), more ("medium") and most ("large"); by_influence: in windows whose prediction the
    effect changes little ("weak"), more ("medium") and most ("strong"); by_position: in windows in which the joint
    is in the lower, the middle and the upper third of its positions ("low", "middle", "high"); since, until: when
    the effect begins or ends. None for what it does not do. free: the runs (or motions, or positions) that a limit
    or a stiffness does not restrict, which have no size."""

    by_run: dict[str, float] | None = None
    by_motion: dict[str, float] | None = None
    by_influence: dict[str, float] | None = None
    by_position: dict[str, float] | None = None
    since: Instant | None = None
    until: Instant | None = None
    free: tuple[str, ...] = ()

    @property
    def by_state(self) -> bool:
        """Whether the size depends on how or where the robot moves: then the law is another than the effect's."""
        return any(x is not None for x in (self.by_motion, self.by_influence, self.by_position))

    @property
    def doubtful(self) -> bool:
        """Whether it speaks for another cause: an effect may differ between runs, but does not depend on the motion,
        begin or end, or restrict some runs and leave others alone."""
        return self.by_run is None or bool(self.free)

    def document(self) -> dict[str, Any]:
        """As diagnosis.json has it: keys for what there is."""
        sizes = {"by_run": self.by_run, "by_motion": self.by_motion, "by_influence": self.by_influence}
        sizes |= {"by_position": self.by_position}
        out: dict[str, Any] = {name: dict(found) for name, found in sizes.items() if found is not None}
        if self.free:
            out["free"] = list(self.free)
        for name, at in (("since", self.since), ("until", self.until)):
            if at is not None:
                out[name] = {"run": at.run, "t": at.t}
        return out
