"""Which runs or blocks no fit may see."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class KeptBack:
    """A whole run, or whole windows of one: from and to in s."""

    run: str
    start: float | None = None
    end: float | None = None

    def document(self) -> str | dict[str, object]:
        """As diagnosis.json has it."""
        if self.start is None:
            return self.run
        return {"run": self.run, "from": self.start, "to": self.end}


def choose_held_out(
    data: Dataset, nominal: np.ndarray, *, settings: DataSettings = DataSettings()
) -> tuple[KeptBack, ...]:
    """A quarter of the runs, or of each run's windows in stretches; nothing where there are fewer than four windows.

    nominal (W,): mean square of the nominal model's scaled error in each window. Runs are drawn from all ranks of
    it, and a stretch is one where it is typical of its run, so that what is kept back is neither the easiest nor
    the hardest part. A run that alone has some sensor, or alone had its motors switched off, is never kept back whole:
    no fit would know what it alone can tell.
    """
    hold_out = settings.hold_out
    names = [r.name for r in data.runs]
    present = np.unique(data.run)
    alone = _alone(data, present)
    whole = present[~alone]
    out: list[KeptBack] = []
    if len(whole) >= hold_out.by_run_from:
        n = max(1, int(round(hold_out.share * len(whole))))
        size = [float(np.nanmean(nominal[data.run == i])) for i in whole]
        ranked = whole[np.argsort(size, kind="stable")]
        pick = ranked[((np.arange(n) + 0.5) * len(whole) / n).astype(int)]
        out = [KeptBack(names[i]) for i in sorted(pick)]
    for i in present[alone] if out else present:
        mine = np.flatnonzero(data.run == i)
        mine = mine[np.argsort(data.start[mine])]
        if len(mine) < hold_out.fewest:
            continue
        most = hold_out.long_stretch if len(mine) >= hold_out.long else hold_out.stretch
        chunk = np.arange(len(mine)) // max(1, min(most, len(mine) // hold_out.every))
        phase = _typical(np.nan_to_num(nominal[mine]), chunk, settings=settings)
        for c in np.unique(chunk[chunk % hold_out.every == phase]):
            stretch = data.start[mine[chunk == c]]
            out.append(KeptBack(names[i], float(stretch[0]), float(stretch[-1] + data.horizon)))
    return tuple(out)


def _alone(data: Dataset, present: np.ndarray) -> np.ndarray:
    """(R,) bool: whether each of the runs `present` (R,) has a sensor, or a spell with motors off, that no other has.
    """
    has: dict[int, set[str]] = {int(i): set() for i in present}
    for (i, channel), signal in data.signals.items():
        if i in has and len(signal.y):
            has[i].add(channel)
    for i, things in has.items():
        columns = data.runs[i].columns
        things |= {c for c, x in columns.items() if c.startswith("enabled.") and (x == 0).any()}
    owners = Counter(thing for things in has.values() for thing in things)
    return np.array([any(owners[thing] == 1 for thing in has[int(i)]) for i in present])


def _typical(nominal: np.ndarray, chunk: np.ndarray, settings: DataSettings) -> int:
    """Which of the interleaved stretches has the mean nominal error closest to that of the whole run."""
    means = np.array(
        [nominal[chunk % settings.hold_out.every == phase].mean() for phase in range(settings.hold_out.every)]
    )
    off = np.log((means + 1e-12) / (nominal.mean() + 1e-12))
    return int(
        np.argmin(np.where(off > 0, 3.0 * off, -off))
    )  # rather too easy: what is rare has to be seen to be fitted


def held_out_mask(data: Dataset, kept: Sequence[KeptBack]) -> np.ndarray:
    """(W,) bool: the windows that are kept back.

    Raises BadInput for a run that is not there, or where all or none of the windows would be kept back.
    """
    names = [r.name for r in data.runs]
    mask = np.zeros(data.count, dtype=bool)
    for k in kept:
        if k.run not in names:
            raise BadInput(
                f"held-out run {k.run!r} is not among the runs", "`held_out`", f"the runs are {', '.join(names[:12])}"
            )
        mine = data.run == names.index(k.run)
        if k.start is not None and k.end is not None:
            mine &= (data.start >= k.start - 1e-6) & (data.start + data.horizon <= k.end + 1e-6)
        mask |= mine
    if kept and (mask.all() or not mask.any()):
        raise BadInput(
            f"some but not all windows must be held out, got {int(mask.sum())} of {data.count}",
            "`held_out`",
            "hold out some windows and leave some for the fit",
        )
    return mask
