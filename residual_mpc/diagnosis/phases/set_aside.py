"""The search once more without stretches that are unlike everything else: they make it name what nothing else shows."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.left_out import across
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.odd_run import odd_run
from residual_mpc.diagnosis.results.unlike_the_rest import drawn_floor, joined_stretches, unlike_the_rest
from residual_mpc.diagnosis.results.variation import makes_the_odd_run
from residual_mpc.models.settings import Term


def unlike_in_fits(prepared: Prepared, refined: Refined) -> tuple[tuple[KeptBack, ...], tuple[Term, ...]]:
    """Stretches of the windows that fits have seen which the explanation misses by far more than all others, or would
    miss without an effect that serves nothing else, such as a stop for a table that was hit once, with these effects;
    else a run that is unlike all others, unless an effect has another size there."""
    of, settings = refined.explanation, prepared.options.settings.aside
    data, values = prepared.clean.take(prepared.free), of.final.values
    rows = of.space.settings([values, *({k: v for k, v in values.items() if k.term != t} for t in of.final.terms)])
    gaps = [np.sqrt(per_window(data, prepared.scales, data.y - y)) for y in predict(data, rows)]
    odd = _odd_run(data, gaps[0])
    if odd and makes_the_odd_run(of, prepared.options.settings):
        odd = ()
    if not any(unlike_the_rest(data, g, settings).stretches for g in gaps):
        return odd, ()
    floor = drawn_floor(data, prepared.scales, rows.take(np.array([0])))
    whole, *less = (unlike_the_rest(data, g, settings, floor).stretches for g in gaps)
    serving = [(t, found) for t, found in zip(of.final.terms, less, strict=True) if len(found) == 1 and found != whole]
    for _, found in serving:
        whole = joined_stretches(whole, found)
    return whole or odd, tuple(t for t, _ in serving)


def _odd_run(data: Dataset, gaps: np.ndarray) -> tuple[KeptBack, ...]:
    """The whole run that is unlike all others, if there is one."""
    odd = odd_run(gaps**2, data.run)
    if odd is None:
        return ()
    run = data.runs[odd.run]
    return (KeptBack(run.name, float(run.t[0]), float(run.t[-1]) + data.horizon),)


def without(prepared: Prepared, aside: Sequence[KeptBack]) -> Prepared:
    """What no fit sees any more; the figures are about all windows."""
    return with_fits_on(prepared, lambda data: ~across(data, aside))


def with_fits_on(prepared: Prepared, mask: Callable[[Dataset], np.ndarray]) -> Prepared:
    """With fits on the windows of a mask (W,) alone."""

    def less(windows: tuple[Dataset, Scales] | None) -> tuple[Dataset, Scales] | None:
        keep = np.zeros(0, dtype=bool) if windows is None else mask(windows[0])
        return None if windows is None or not keep.any() else (windows[0].take(keep), windows[1])

    longer = tuple(replace(look, free=less(look.free)) for look in prepared.longer)
    return replace(prepared, free=prepared.free & mask(prepared.raw), longer=longer, near=less(prepared.near))
