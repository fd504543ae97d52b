"""What to drive where no effect of the library explains the gap: the motion in which the rest shows most, twice, and
the one that goes where no run has been.

What differs between two runs of one motion no law of the commands can explain; what does not is worth a name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.where import regime_masks
from residual_mpc.experiment.drive_setup import DriveSetup
from residual_mpc.experiment.motions import motions
from residual_mpc.experiment.separate import Planned, simulate_run, within_limits
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values

UNSEEN = 0.02  # share of the time below which a regime was hardly driven
ENTERED = 0.05  # and above which a motion shows it


@dataclass(frozen=True)
class Explored:
    """A motion, shows: how many times as fast as on average over the runs so far the gap is expected to grow in it;
    unseen: regimes that the runs so far hardly entered, and it does."""

    planned: Planned
    shows: float
    unseen: tuple[str, ...]


def explore(
    robot: Robot,
    setup: DriveSetup,
    values: Values,
    regimes: Mapping[str, tuple[float, float]],
    seconds: float,
    rng: np.random.Generator,
) -> tuple[Explored, ...]:
    """The motion that shows the gap most, the same again, and the one with most that is unseen, if any.

    regimes: name -> (share of the time, lift of the gap) over the runs so far.
    """
    planned = [within_limits(robot, setup, m, values) for m in motions(setup, seconds, rng)]
    spent = [_time_in(robot, setup, p, values, rng) for p in planned]
    tried = [
        Explored(p, _shows(s, regimes), tuple(n for n, f in s.items() if f > ENTERED and _seen(n, regimes) < UNSEEN))
        for p, s in zip(planned, spent, strict=True)
    ]
    best = max(tried, key=lambda e: e.shows)
    again = replace(best.planned.motion, name=best.planned.motion.name + " again")
    chosen = [best, replace(best, planned=replace(best.planned, motion=again))]
    elsewhere = max(tried, key=lambda e: len(e.unseen))
    return (*chosen, elsewhere) if elsewhere.unseen and elsewhere is not best else tuple(chosen)


def _time_in(
    robot: Robot, setup: DriveSetup, planned: Planned, values: Values, rng: np.random.Generator
) -> dict[str, float]:
    """regime -> share of the motion's time."""
    data = build_dataset([simulate_run(robot, setup, planned.motion, values, rng)], [robot], dict(setup.sigma))
    seen = np.isfinite(data.y).any(axis=2)
    return {name: float((mask & seen).sum() / max(seen.sum(), 1)) for name, mask in regime_masks(data).items()}


def _shows(spent: Mapping[str, float], regimes: Mapping[str, tuple[float, float]]) -> float:
    """Mean of what each regime says: the lift inside it, and what is left outside, by the time spent in each."""
    said = []
    for name, (time, lift) in regimes.items():
        outside = max(1.0 - time * lift, 0.0) / max(1.0 - time, 1e-6)
        inside = min(max(spent.get(name, 0.0), 0.0), 1.0)
        said.append(inside * lift + (1.0 - inside) * outside)
    return float(np.mean(said)) if said else 1.0


def _seen(name: str, regimes: Mapping[str, tuple[float, float]]) -> float:
    return regimes[name][0] if name in regimes else 0.0


def regimes_of(rows: Sequence[Mapping[str, float]]) -> dict[str, tuple[float, float]]:
    """name -> (share of the time, lift) from the `where.regimes` of a diagnosis.json."""
    return {str(r["name"]): (r["share"] / r["lift"] if r["lift"] > 0 else 0.0, float(r["lift"])) for r in rows}
