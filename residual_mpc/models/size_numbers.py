"""The numbers of an effect that say how much of it there is."""

from collections.abc import Iterable

from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term

ANGLES = ("heading", "phase")  # numbers that come round after a turn


def size_knobs(knobs: Iterable[Knob], term: Term) -> list[Knob]:
    """Those of one effect, in its order; neither angles nor what says only how it acts."""
    mine = (k for k in knobs if k.effect != TUNE and k.term == term and k.parameter not in ANGLES)
    return [k for k in mine if not BY_NAME[k.effect].parameter(k.parameter).shape]
