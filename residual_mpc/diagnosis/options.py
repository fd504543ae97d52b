"""What a diagnosis may be told."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Term

Progress = Callable[[str, float], None]  # told what is done now, and the share of it all that is behind


@dataclass(frozen=True)
class Options:
    """horizon s; only, without: effect names; without_because: hypotheses that are left out, each with the reason (see
    `not_commanded`); held_out: what is kept back (None: chosen); search: see SearchSettings.

    search_steps: simulation steps that one hypothesis may cost in the search (windows are thinned evenly to that);
    final_steps: likewise in the last fit but for its last steps, and half of it in the shares of the stages; a perfect
    model may cost 24 times that.
    """

    horizon: float = 1.0
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    without_because: Mapping[Term, str] = field(default_factory=dict)
    held_out: tuple[KeptBack, ...] | None = None
    search_steps: int = 16_000
    final_steps: int = 100_000
    search: SearchSettings = field(default_factory=SearchSettings)
