"""Where the robot stands still: what its servos hold there, and what gravity asks of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, JointDrive
from residual_mpc.logs.run import FloatArray
from residual_mpc.models.model_structure import Torque

QUIET = 0.3  # s that a joint has to have stood still
SLOW = 0.01  # of a signal's whole range, that it may move meanwhile
FEW = 20  # samples at rest below which nothing is said
POSES = 6  # different ones, from which gravity has a say
LOADED = 0.2  # of the largest load of any joint, for a joint that it has a say on
MOST = 400  # samples at which the model's torque is asked for


@dataclass(frozen=True, eq=False)
class StandstillSamples:
    """Samples at rest, in rad, m and the actuators' units, as the columns are understood so far.

    q: (n, joints), 0 where a joint is not measured. sent: by actuator, (n,).
    """

    q: FloatArray
    sent: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.q)


def at_rest(
    case: ColumnEvidence, places: Mapping[str, FloatArray], sent: Mapping[str, FloatArray]
) -> StandstillSamples:
    """The samples at which no measured joint moves and no command changes.

    places: by joint, (n,) rad or m on the grid. sent: by actuator, (n,), of any kind.
    """
    rows = np.flatnonzero(still(case, (*places.values(), *sent.values())))
    if len(rows) > MOST:
        rows = rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
    q = np.stack([places[j.name][rows] if j.name in places else np.zeros(len(rows)) for j in case.structure.joints], 1)
    return StandstillSamples(q, {name: x[rows] for name, x in sent.items()})


def still(case: ColumnEvidence, signals: Sequence[FloatArray]) -> np.ndarray:
    """(n,) bool: where none of the signals (n,) has moved for a while."""
    out = np.ones(len(case.signals.run), dtype=bool)
    width = max(2, round(QUIET / case.signals.dt))
    for x in signals:
        out &= np.isfinite(x) & (_range_before(x, width) < max(SLOW * _spread(x), 1e-9))
    return out


def flips(torque: Torque, rest: StandstillSamples, joint: int, driven: JointDrive) -> dict[tuple[int, int], float]:
    """How well gravity explains what a position servo holds, if the position is taken with one sign and the command
    with another: (sign of the position, sign of the command) -> correlation of torque held with torque needed.

    Empty where gravity says nothing: few poses, or an axis that it hardly loads.
    """
    out: dict[tuple[int, int], float] = {}
    sent = rest.sent[driven.name]
    if len(np.unique(np.round(rest.q / (0.02 * np.ptp(rest.q, axis=0) + 1e-9)), axis=0)) < POSES:
        return {}
    for p in (1, -1):
        q = rest.q.copy()
        q[:, joint] *= p
        zero = np.zeros_like(q)
        load = torque(q, zero, zero)  # (n, joints)
        needed = load[:, joint]
        if np.std(needed) < LOADED * np.std(load, axis=0).max():
            return {}
        for c in (1, -1):
            held = c * sent - q[:, joint]
            spread = np.std(needed) * np.std(held)
            out[p, c] = float(np.mean((needed - needed.mean()) * (held - held.mean())) / spread) if spread > 0 else 0.0
    return out


def _range_before(x: FloatArray, width: int) -> FloatArray:
    """(n,) the range over the `width` samples up to each, inf where there are fewer."""
    out = np.full(len(x), np.inf)
    if len(x) >= width:
        windows = np.lib.stride_tricks.sliding_window_view(x, width)
        with np.errstate(invalid="ignore"):
            out[width - 1 :] = windows.max(axis=1) - windows.min(axis=1)
    return np.where(np.isfinite(out), out, np.inf)


def _spread(x: FloatArray) -> float:
    there = x[np.isfinite(x)]
    return float(np.quantile(there, 0.99) - np.quantile(there, 0.01)) if len(there) else 0.0
