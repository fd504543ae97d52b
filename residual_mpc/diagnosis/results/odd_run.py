"""A run that fits far worse than all the others: one explanation of all runs hides what differs in it."""

from dataclasses import dataclass

import numpy as np

WORSE = 4.0  # times the mean square of the worst of the other runs
CHANCE = 0.01  # probability of such ranks of its windows by chance, over all runs together


@dataclass(frozen=True)
class OddRun:
    """run: its index; gap: of it; others: the largest of the other runs."""

    run: int
    gap: float
    others: float

    def document(self, name: str, horizon: float) -> dict[str, object]:
        """What diagnosis.json says of it. horizon: of the gaps, s."""
        return {
            "run": name,
            "gap": self.gap,
            "others": self.others,
            "note": f"{name} fits far worse than every other run (a gap of {self.gap:.2g} over {horizon:g} s against "
            f"at most {self.others:.2g}): the robot or its motion may have been different. Diagnose it alone, or "
            "compare the other runs with it (`residual-mpc compare`).",
        }


def odd_run(squares: np.ndarray, run: np.ndarray) -> OddRun | None:
    """From the windows' squared gaps (W,) and the runs (W,) that they belong to; None where no single run is odd."""
    seen = np.isfinite(squares)
    squares, run = squares[seen], run[seen]
    runs = np.unique(run)
    if len(runs) < 3:  # of two, nobody knows which one is odd
        return None
    means = np.array([squares[run == i].mean() for i in runs])
    *_, second, worst = np.argsort(means)
    mine = run == runs[worst]
    if not means[worst] > WORSE * means[second]:
        return None
    from scipy.stats import mannwhitneyu  # half a second to load, for what few runs have

    p = mannwhitneyu(squares[mine], squares[~mine], alternative="greater").pvalue
    if p * len(runs) > CHANCE:
        return None
    return OddRun(int(runs[worst]), float(np.sqrt(means[worst])), float(np.sqrt(means[second])))
