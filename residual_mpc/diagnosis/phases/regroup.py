"""The windows of a diagnosis told apart by groups, in which effects have another size or do nothing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.parts import grouped
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.group_space import Sizes, group_space
from residual_mpc.diagnosis.predict.horizons import HorizonWindows

GroupsOf = Callable[[Dataset], np.ndarray]  # (W,) the group of each window, negative for those that are left out


def regrouped(prepared: Prepared, groups_of: GroupsOf, sizes: Sequence[Sizes]) -> Prepared:
    """All windows in these groups, and the hypotheses with these sizes in the groups 1, 2, ..."""

    def told(windows: tuple[Dataset, Scales] | None) -> tuple[Dataset, Scales] | None:
        here = None if windows is None else grouped(windows[0], groups_of(windows[0]))
        return None if here is None or windows is None or not here.count else (here, windows[1])

    def look_told(look: HorizonWindows) -> HorizonWindows | None:
        group = groups_of(look.raw)
        if not (group >= 0).any():
            return None
        raw, clean = grouped(look.raw, group), grouped(look.clean, group)
        return replace(look, raw=raw, clean=clean, held=look.held[group >= 0], free=told(look.free))

    group = groups_of(prepared.raw)
    return replace(
        prepared,
        raw=grouped(prepared.raw, group),
        clean=grouped(prepared.clean, group),
        held=prepared.held[group >= 0],
        free=prepared.free[group >= 0],
        space=group_space(prepared.space, sizes),
        longer=tuple(x for look in prepared.longer if (x := look_told(look)) is not None),
        near=told(prepared.near),
    )
