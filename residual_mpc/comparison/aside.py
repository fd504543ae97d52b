"""Stretches of either set that are unlike everything else, such as a push or a wet spot: they are no change."""

from dataclasses import replace

import numpy as np

from residual_mpc.comparison.prepare import ComparisonInput
from residual_mpc.comparison.sets import TwoSets
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.diagnosis.data.gap import per_window
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import AsideSettings
from residual_mpc.diagnosis.results.unlike_the_rest import Unlike, drawn_floor, unlike_the_rest
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Values


def unlike_in_sets(sets: TwoSets, space: ChangeSpace, values: Values, settings: AsideSettings) -> Unlike:
    """Where these values miss the motion by far more than anywhere else."""
    data, row = sets.clean, space.settings([values])
    gaps = np.sqrt(per_window(data, sets.scales, data.y - predict(data, row)[0]))
    if not unlike_the_rest(data, gaps, settings).stretches:
        return Unlike()
    return unlike_the_rest(data, gaps, settings, drawn_floor(data, sets.scales, row))


def without_unlike(given: ComparisonInput, unlike: Unlike) -> ComparisonInput:
    """The runs with these stretches as incidents, which nothing sees."""
    before, after = (tuple(_less(run, unlike) for run in runs) for runs in (given.before, given.after))
    return replace(given, before=before, after=after)


def aside_note(unlike: Unlike, horizon: float) -> tuple[str, ...]:
    """What a reader has to know of it. horizon: of the gaps, s."""
    return (f"{unlike.sentence(horizon)}: left out, look at what happened there",)


def _less(run: Run, unlike: Unlike) -> Run:
    mine = [k for k in unlike.stretches if k.run == run.name]
    new = [(k.start, k.end) for k in mine if k.start is not None and k.end is not None]
    return replace(run, incidents=tuple(sorted([*run.incidents, *new]))) if new else run
