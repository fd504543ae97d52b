"""Where an arm should be: a table of the user's, or a motion by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.logs.columns import did_you_mean

TURN = 4.0  # s, of one round of a named motion
RAMP = 1.0  # s, in which its clock starts
SWING, REACH = 0.35, 0.25  # rad (m) of each joint, and share of its range, whichever is less
RADIUS = 0.06  # m, of the tool's circle
BETWEEN = 1.5  # s, from posture to posture


@dataclass(frozen=True, eq=False)
class Waypoints:
    """What is tracked at times: names, t (n,) s from 0 on, values (n, ny); cubic in between, the last value held.

    beyond: s at the end that are looked ahead to, and not driven.
    """

    names: tuple[str, ...]
    t: np.ndarray
    values: np.ndarray
    beyond: float = 0.0

    @property
    def seconds(self) -> float:
        return float(self.t[-1]) - self.beyond

    def path(self, t: np.ndarray) -> np.ndarray:
        """(n, ny) at times t (n,) s."""
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(self.t, self.values)(np.clip(t, self.t[0], self.t[-1])))

    def ordered(self, names: tuple[str, ...], where: str) -> "Waypoints":
        """The columns in the order of these names. Raises BadInput where one is missing."""
        missing = [n for n in names if n not in self.names]
        if missing:
            raise BadInput(
                f"the reference has no column {missing[0]!r}", where, f"give t and {', '.join(names)}, rad or m"
            )
        return replace(self, names=names, values=self.values[:, [self.names.index(n) for n in names]])


def read_reference(path: Path) -> Waypoints:
    """A CSV with the columns t (s) and `position.<joint>` (rad, m), or tool.x, tool.y, tool.z (m).

    Raises BadInput for a file that is missing, no table, or has values or stamps that cannot be.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError, UnicodeDecodeError) as error:
        fault = f"the reference cannot be read: {error}"
        raise BadInput(fault, str(path), "give a CSV file with a column t") from error
    if "t" not in table or len(table.columns) < 2 or len(table) < 2:
        raise BadInput("the reference needs a column t, another one, and two rows", str(path))
    values = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise BadInput(f"row {row + 2} of the reference has an empty cell or no number", str(path))
    t = values[:, list(table.columns).index("t")]
    if not (np.diff(t) > 0).all():
        raise BadInput("the stamps of the reference must increase", str(path))
    names = tuple(str(c) for c in table.columns if c != "t")
    return Waypoints(names, t - t[0], values[:, [list(table.columns).index(n) for n in names]])


def named_motion(name: str, model: Augmented, rounds: int = 3) -> Waypoints:
    """A motion about the arm's home. Raises BadInput for a name that is unknown or not of what the model tracks."""
    motions: dict[str, Callable[[Augmented, np.ndarray], np.ndarray]] = {
        "sines": _sines, "postures": _postures, "circle": _circle,
    }  # fmt: skip
    if name not in motions:
        raise BadInput(f"no file and no motion is called {name!r}", "--reference", did_you_mean(name, [*motions]))
    t = np.linspace(0.0, (rounds + 1) * TURN, 200 * (rounds + 1) + 1)
    return Waypoints(model.stepped.tracked, t, motions[name](model, t), TURN)


def is_of_the_tool(names: tuple[str, ...]) -> bool:
    """Whether these columns or this motion's name (as the only one) are of the tool."""
    return any(n.startswith("tool.") for n in names) or names == ("circle",)


def _clock(t: np.ndarray) -> np.ndarray:
    """Time that begins slowly, so that an arm at rest can follow."""
    return np.where(t < RAMP, t * t / (2 * RAMP), t - 0.5 * RAMP)


def _sines(model: Augmented, t: np.ndarray) -> np.ndarray:
    """Every joint swings about home, each at its own pace."""
    home, size = _about(model)
    k = np.arange(len(home))
    phase = 2 * np.pi * _clock(t)[:, None] / TURN * (1.0 + 0.25 * (k % 3))
    return np.asarray(home + size * np.sin(phase))


def _postures(model: Augmented, t: np.ndarray) -> np.ndarray:
    """From posture to posture, with a rest in each."""
    home, size = _about(model)
    rng = np.random.default_rng(0)
    count = int(np.ceil(t[-1] / BETWEEN)) + 2
    stops = np.vstack([home, home + size * rng.uniform(-1, 1, (count, len(home)))])
    leg, part = np.divmod(t / BETWEEN, 1.0)
    share = np.clip(part / 0.7, 0.0, 1.0)
    smooth = share**3 * (10 - 15 * share + 6 * share**2)  # no jerk at either end
    a, b = stops[leg.astype(int)], stops[leg.astype(int) + 1]
    return np.asarray(a + smooth[:, None] * (b - a))


def _circle(model: Augmented, t: np.ndarray) -> np.ndarray:
    """The tool on a slanted circle through its place at home."""
    begin, phase = model.outputs(model.start()), 2 * np.pi * _clock(t) / TURN
    around = np.stack([np.cos(phase) - 1.0, np.sin(phase), 0.5 * np.sin(phase)], axis=-1)
    return np.asarray(begin + RADIUS * around)


def _about(model: Augmented) -> tuple[np.ndarray, np.ndarray]:
    """(n,) home, and (n,) how far each joint swings about it."""
    at = model.stepped
    home = model.start()[[at.states.index(c) for c in at.poses]]
    low, high = (np.array(side) for side in zip(*at.spans, strict=True))
    size = np.minimum(SWING, REACH * (high - low))
    return np.clip(home, low + 1.2 * size, high - 1.2 * size), size
