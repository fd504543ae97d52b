"""Draw the size of a change by its visibility in the recorded runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target
from residual_mpc.blind.recorded.visibility import WindowErrors, visibility, window_errors
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

FAINTEST = 3.0  # visibility of the smallest change: a test at z = 2 that knows the change misses one in six
CLEAREST = 30.0  # visibility of the largest change
TRIES = 4  # bisections of the strength towards a visibility
NEAR = 1.15  # factor within which a visibility counts as reached


@dataclass(frozen=True)
class Sized:
    """sizes: parameters of a change; visibility: its z (see `visibility`), NaN for a kind without one."""

    sizes: Sizes
    visibility: float


Sizer = Callable[[Kind, Target, float, np.random.Generator], Sized | None]


@dataclass(frozen=True, eq=False)
class UntouchedHalves:
    """Both halves before any change, and the errors of the nominal model in them."""

    robot: RobotFile
    before: Half
    after: Half
    untouched: WindowErrors

    @staticmethod
    def of(robot: RobotFile, before: Half, after: Half) -> UntouchedHalves:
        """Compute the errors of the nominal model in both halves."""
        return UntouchedHalves(robot, before, after, window_errors(robot, before, after))

    def sized(self, kind: Kind, target: Target, strength: float, rng: np.random.Generator) -> Sized | None:
        """The change whose visibility is at this strength on a logarithmic scale from the faintest (0) to the clearest
        (1) that the kind reaches in these runs; None if even the kind's largest size is not visible."""
        seed = int(rng.integers(2**32))
        if not kind.directed:
            return Sized(kind.size(self.after, target, strength, np.random.default_rng(seed)), float("nan"))
        largest = self._at(kind, target, 1.0, seed)
        if largest is None or largest.visibility < FAINTEST:
            return None
        wanted = FAINTEST * (min(largest.visibility, CLEAREST) / FAINTEST) ** strength
        low, high, best = 0.0, 1.0, largest
        for _ in range(TRIES):
            if max(best.visibility, wanted) < NEAR * min(best.visibility, wanted):
                break
            middle = 0.5 * (low + high)
            tried = self._at(kind, target, middle, seed)
            if tried is None or tried.visibility < wanted:
                low = middle
            else:
                high = middle
            if tried is not None and _apart(tried, wanted) < _apart(best, wanted):
                best = tried
        return best

    def _at(self, kind: Kind, target: Target, strength: float, seed: int) -> Sized | None:
        """The change at one strength of the kind's range; None if it cannot be put into these runs."""
        sizes = kind.size(self.after, target, strength, np.random.default_rng(seed))
        try:
            before, after = (
                kind.apply(half, target, sizes, np.random.default_rng(seed)) for half in (self.before, self.after)
            )
            changed = window_errors(self.robot, before, after)
        except BadInput:
            return None
        return Sized(sizes, visibility(self.untouched, changed))


def _apart(sized: Sized, wanted: float) -> float:
    return abs(float(np.log(max(sized.visibility, 1e-9) / wanted)))
