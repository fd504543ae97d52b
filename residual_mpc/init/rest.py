"""Where the robot stands still: what its servos hold there, and what gravity asks of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.init.roles import Case, Driven
from residual_mpc.logs.run import FloatArray
from residual_mpc.models.anatomy import Torque

QUIET = 0.3  # s that a joint has to have stood still
SLOW = 0.02  # of a joint's usual range, per second
FEW = 20  # samples at rest below which nothing is said
MOST = 400  # samples at which the model's torque is asked for


@dataclass(frozen=True, eq=False)
class Rest:
    """Samples at rest, in rad, m and the actuators' units, as the columns are understood so far.

    q: (n, joints), 0 where a joint is not measured. sent: by actuator, (n,).
    """

    q: FloatArray
    sent: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.q)


def at_rest(case: Case, places: Mapping[str, FloatArray], sent: Mapping[str, FloatArray]) -> Rest:
    """The samples at which no measured joint moves and no command changes.

    places: by joint, (n,) rad or m on the grid. sent: by actuator, (n,), of any kind.
    """
    still = np.ones(len(case.signals.run), dtype=bool)
    width = max(1, round(QUIET / case.signals.dt))
    for x in (*places.values(), *sent.values()):
        still &= np.isfinite(x) & (_range_before(x, width) < max(SLOW * QUIET * _spread(x), 1e-9))
    rows = np.flatnonzero(still)
    if len(rows) > MOST:
        rows = rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
    q = np.stack([places[j.name][rows] if j.name in places else np.zeros(len(rows)) for j in case.anatomy.joints], 1)
    return Rest(q, {name: x[rows] for name, x in sent.items()})


def flips(
    torque: Torque, rest: Rest, joint: int, driven: Driven
) -> dict[tuple[int, int], float]:
    """How well gravity explains what the actuator holds, if the position is taken with one sign and the command with
    another: (sign of the position, sign of the command) -> correlation of torque held with torque needed."""
    out: dict[tuple[int, int], float] = {}
    sent = rest.sent[driven.name]
    for p in (1, -1):
        q = rest.q.copy()
        q[:, joint] *= p
        zero = np.zeros_like(q)
        needed = torque(q, zero, zero)[:, joint]
        for c in (1, -1):
            held = c * sent - q[:, joint] if driven.kind == "position" else c * sent
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
