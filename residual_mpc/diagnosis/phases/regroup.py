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
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.models.settings import Term

GroupsOf = Callable[[Dataset], np.ndarray]  # (W,) the group of each window, negative for those that are left out


def regrouped(prepared: Prepared, group: GroupsOf, sizes: Sequence[Sizes]) -> Prepared:
    """All windows in these groups, and the hypotheses with these sizes in the groups 1, 2, ..."""

    def windows_of(windows: tuple[Dataset, Scales] | None) -> tuple[Dataset, Scales] | None:
        here = None if windows is None else grouped(windows[0], group(windows[0]))
        return None if here is None or windows is None or not here.count else (here, windows[1])

    def horizon_of(look: HorizonWindows) -> HorizonWindows | None:
        mine = group(look.raw)
        keep = mine >= 0
        if not keep.any() or (look.held.any() and not look.held[keep].any()):
            return None  # what is left was seen by fits
        raw, clean = grouped(look.raw, mine), grouped(look.clean, mine)
        return replace(look, raw=raw, clean=clean, held=look.held[keep], free=windows_of(look.free))

    mine = group(prepared.raw)
    return replace(
        prepared,
        raw=grouped(prepared.raw, mine),
        clean=grouped(prepared.clean, mine),
        held=prepared.held[mine >= 0],
        free=prepared.free[mine >= 0],
        space=group_space(prepared.space, sizes),
        longer=tuple(x for look in prepared.longer if (x := horizon_of(look)) is not None),
        near=windows_of(prepared.near),
    )


def still_judged(before: Prepared, now: Prepared) -> bool:
    """Whether windows that were held out are left to judge by, if there were any."""
    return bool(now.held.any()) or not bool(before.held.any())


def in_their_place(rivalry: Rivalry, some: Sequence[Term], steady: Sequence[Term], far: float) -> frozenset[Term]:
    """Some effects that have another size in groups of windows, with what may stand in their place, which has it as
    well. steady: the effects that are alike everywhere; far: likelihood ratio from which a rival has no probability."""
    terms = set(some)
    for r in rivalry.rivals:  # the first member of a group may have taken the place of the one that was found
        if (r.alike or r.ratio < far) and (set(r.gone) <= terms or set(r.came) <= terms):
            terms |= {*r.gone, *r.came}
    for group in rivalry.groups:
        if any(set(member) <= terms for member in group):
            terms |= {t for member in group for t in member}
    return frozenset(terms.difference(steady))
