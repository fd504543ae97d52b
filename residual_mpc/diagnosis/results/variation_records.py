"""How the size of an effect varies over the runs."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Instant:
    """run: its name; t: s, on the log's clock."""

    run: str
    t: float


@dataclass(frozen=True)
class Variation:
    """by_run: the size in each run, in the unit of the effect's first parameter, None if it is steady or changes within
    a run; since, until: when the effect begins or ends, None if it does not."""

    by_run: dict[str, float] | None = None
    since: Instant | None = None
    until: Instant | None = None

    def document(self) -> dict[str, Any]:
        """As diagnosis.json has it: keys for what there is."""
        out: dict[str, Any] = {} if self.by_run is None else {"by_run": dict(self.by_run)}
        for name, at in (("since", self.since), ("until", self.until)):
            if at is not None:
                out[name] = {"run": at.run, "t": at.t}
        return out
