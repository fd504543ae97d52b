"""The search once more without stretches that are unlike everything else: they make it name what nothing else shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.left_out import across
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.unlike_the_rest import Unlike, unlike_the_rest


def unlike_in_fits(prepared: Prepared, refined: Refined) -> Unlike:
    """Stretches of the windows that fits have seen which the explanation misses by far more than all others."""
    of = refined.explanation
    data = prepared.clean.take(prepared.free)
    error = data.y - predict(data, of.space.settings([of.final.values]))[0]
    return unlike_the_rest(data, np.sqrt(per_window(data, prepared.scales, error)), prepared.options.settings.aside)


def without(prepared: Prepared, aside: Sequence[KeptBack]) -> Prepared:
    """What no fit sees any more; the figures are about all windows."""

    def less(windows: tuple[Dataset, Scales] | None) -> tuple[Dataset, Scales] | None:
        keep = np.zeros(0, dtype=bool) if windows is None else ~across(windows[0], aside)
        return None if windows is None or not keep.any() else (windows[0].take(keep), windows[1])

    longer = tuple(replace(look, free=less(look.free)) for look in prepared.longer)
    free = prepared.free & ~across(prepared.raw, aside)
    return replace(prepared, free=free, longer=longer, near=less(prepared.near))
