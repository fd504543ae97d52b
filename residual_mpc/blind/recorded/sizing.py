"""Draw the size of a change by its visibility in the recorded runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target
from residual_mpc.blind.recorded.visibility import WindowErrors, faintest, visibility, window_errors
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

CLEAREST = 10.0  # visibility of the largest change, as a multiple of that of the smallest
TRIES = 4  # bisections of the strength towards a visibility
NEAR = 1.15  # factor within which a visibility counts as reached
FACTORS = 4.0 ** np.arange(-4, 3)  # of the nominal value, around which the one that fits the runs is sought
FINE = 0.07  # of a logarithm, to which that factor is found
DIVERGED = 1e12  # error of a model that predicts fewer samples than the nominal one


@dataclass(frozen=True)
class Sized:
    """sizes: parameters of a change; visibility: its z (see `visibility`), NaN for a kind without one."""

    sizes: Sizes
    visibility: float


Sizer = Callable[[Kind, Target, float, np.random.Generator], Sized | None]


@dataclass(frozen=True, eq=False)
class UntouchedHalves:
    """Both halves before any change, and the errors of the nominal model in them; fitted: by kind and target, what
    `_fitted` found."""

    robot: RobotFile
    before: Half
    after: Half
    untouched: WindowErrors
    fitted: dict[tuple[str, str, Target], float] = field(default_factory=dict)

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
        least = faintest(self.untouched)
        if largest is None or largest.visibility < least:
            return None
        wanted = least * min(largest.visibility / least, CLEAREST) ** strength
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
            if not kind.factor:
                return Sized(sizes, visibility(self.untouched, self._with(kind, target, sizes, seed)))
            (name,) = sizes
            best = self._fitted(kind, target, name)
            both = [self._with(kind, target, {name: best * x}, seed) for x in (1.0, sizes[name])]
        except BadInput:
            return None
        return Sized(sizes, visibility(*both))

    def _with(self, kind: Kind, target: Target, sizes: Sizes, seed: int = 0) -> WindowErrors:
        """The errors with a change in both halves. The noise is that without a change, since its estimate takes as long
        as a replay."""
        before, after = (
            kind.apply(half, target, sizes, np.random.default_rng(seed)) for half in (self.before, self.after)
        )
        return window_errors(self.robot, before, after, self.untouched.noise)

    def _fitted(self, kind: Kind, target: Target, name: str) -> float:
        """The factor with which the median window errs least.

        Where a model turns ten times as far as the robot, a tenth more of that is ten times the change that the robot
        would show; what a comparison has to see is the change of the factor that fits.
        """
        key = (kind.effect, kind.place, target)
        if key not in self.fitted:

            wanted = np.isfinite(self.untouched.errors).sum()

            def missed(logarithm: float) -> float:
                e = self._with(kind, target, {name: float(np.exp(logarithm))}).errors
                there = np.isfinite(e)
                if there.sum() < 0.99 * wanted:
                    return DIVERGED
                squares = np.where(there, e, 0.0) ** 2
                return float(np.median(squares.sum(axis=(1, 2)) / np.maximum(there.sum(axis=(1, 2)), 1)))

            grid = np.log(FACTORS)
            near, apart = float(grid[int(np.argmin([missed(x) for x in grid]))]), float(grid[1] - grid[0])
            found = minimize_scalar(missed, bounds=(near - apart, near + apart), method="bounded",
                                    options={"xatol": FINE})  # fmt: skip
            self.fitted[key] = float(np.exp(found.x))
        return self.fitted[key]


def _apart(sized: Sized, wanted: float) -> float:
    return abs(float(np.log(max(sized.visibility, 1e-9) / wanted)))
