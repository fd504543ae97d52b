"""References: a user's table, or a motion of an arm by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models import optional

TURN = 4.0  # s, period of a named motion
RAMP = 1.0  # s, in which it accelerates to full speed
SWING, REACH = 0.35, 0.25  # amplitude of each joint: rad (m), and share of its range, whichever is less
RADIUS = 0.06  # m, of the tool's circle
BETWEEN = 1.5  # s, from posture to posture, rest included


@dataclass(frozen=True, eq=False)
class Waypoints:
    """Waypoints of the tracked channels `names`: values (n, ny), rad or m, at t (n,) s from 0 on, interpolated by a
    monotone cubic; the last value is held.

    beyond: s at the end that only the controllers' preview uses. file: the table that they were read from, empty
    without one. Raises BadInput for values that are not finite or do not have one row per stamp and one column per
    name, and for stamps that do not increase.
    """

    names: tuple[str, ...]
    t: np.ndarray
    values: np.ndarray
    beyond: float = 0.0
    file: str = ""

    def __post_init__(self) -> None:
        for name in ("t", "values"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        shape, wanted = np.shape(self.values), (len(self.t), len(self.names))
        if shape != wanted or len(self.t) < 2:
            fault = f"a reference needs two rows and a column for each of {', '.join(self.names)}, got {shape}"
            raise BadInput(fault, "reference", f"give values of shape {wanted} and at least two stamps")
        if not (np.isfinite(self.values).all() and np.isfinite(self.t).all()):
            raise BadInput("the reference has values that are not finite", "reference", "fill them in")
        if not (np.diff(self.t) > 0.0).all():
            raise BadInput("the stamps of the reference do not increase", "reference", "sort them, remove duplicates")

    @property
    def seconds(self) -> float:
        return float(self.t[-1]) - self.beyond

    @property
    def where(self) -> str:
        """What an error message names."""
        return self.file or "`reference`"

    def row(self, k: int) -> str:
        """The place and time of row k, for messages."""
        place = f"line {k + 2}" if self.file else f"row {k}"
        return f"{place}, {self.t[k]:.4g} s after the start,"

    def path(self, t: np.ndarray) -> np.ndarray:
        """(n, ny) at times t (n,) s."""
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(self.t, self.values)(np.clip(t, self.t[0], self.t[-1])))

    def with_held(self, model: Augmented) -> "Waypoints":
        """With a column for each joint that the model holds and the reference leaves out: it stays where it rests."""
        at = model.stepped
        left = [c for c in at.tracked if c in _held(model) and c not in self.names]
        rest = model.start()[[at.states.index(c) for c in left]]
        values = np.hstack([self.values, np.tile(rest, (len(self.t), 1))])
        return replace(self, names=(*self.names, *left), values=values)

    def ordered(self, names: tuple[str, ...], where: str) -> "Waypoints":
        """The columns in the order of these names; headings between -pi and pi lose their jumps by a whole turn. Raises
        BadInput where a column is missing."""
        missing = [n for n in names if n not in self.names]
        if missing:
            raise BadInput(
                f"the reference has no column {missing[0]!r}", where, f"give t (s) and {', '.join(names)} (rad or m)"
            )
        values = self.values[:, [self.names.index(n) for n in names]]
        for i in (i for i, n in enumerate(names) if n == "pose.theta"):
            if np.abs(values[:, i]).max() <= np.pi + 1e-6:  # beyond, it counts turns, and a large step is meant
                values[:, i] = np.unwrap(values[:, i])
        return replace(self, names=names, values=values)


def read_reference(path: Path) -> Waypoints:
    """A CSV with the columns t (s) and `position.<joint>` (rad, m), tool.x, tool.y, tool.z (m), or `pose.*` (m, rad).

    Raises BadInput for a file that is missing or not a table, for missing values, and for stamps that do not increase.
    """
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError, UnicodeDecodeError) as error:
        fault = f"the reference cannot be read: {error}"
        raise BadInput(fault, str(path), "give a CSV file with a column t") from error
    if "t" not in table or len(table.columns) < 2 or len(table) < 2:
        raise BadInput(
            f"the reference must have a column t, at least one other column and two rows, got the columns"
            f" {', '.join(map(str, table.columns))} and {len(table)} row{'' if len(table) == 1 else 's'}", str(path),
            "give t (s) and position.<joint> (rad, m), tool.x, tool.y, tool.z (m) or pose.x, pose.y, pose.theta",
        )  # fmt: skip
    values = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        fault = f"line {row + 2} of the reference has an empty cell or one that is not a number"
        raise BadInput(fault, str(path), "fill it in, or remove the line")
    t = values[:, list(table.columns).index("t")]
    if not (np.diff(t) > 0).all():
        line = int(np.flatnonzero(np.diff(t) <= 0)[0]) + 3
        raise BadInput(f"t must increase, but does not at line {line}", str(path), "sort the lines, remove duplicates")
    names = tuple(str(c) for c in table.columns if c != "t")
    columns = [list(table.columns).index(n) for n in names]
    return Waypoints(names, t - t[0], values[:, columns], file=str(path))


def named_motion(name: str, model: Augmented, rounds: int = 3) -> Waypoints:
    """A motion about the arm's home position. Raises BadInput for an unknown name."""
    motions: dict[str, Callable[[Augmented, np.ndarray], np.ndarray]] = {
        "sines": _sines, "postures": _postures, "circle": _circle,
    }  # fmt: skip
    if name not in motions:
        raise BadInput(f"{name!r} is neither a file nor a named motion", "`reference`", did_you_mean(name, [*motions]))
    if not model.stepped.spans:
        raise BadInput(
            f"the motion {name!r} is for an arm, and {model.robot.name!r} drives", "`reference`",
            f"give a CSV file with t, {', '.join(model.stepped.tracked)}",
        )  # fmt: skip
    t = np.linspace(0.0, (rounds + 1) * TURN, 200 * (rounds + 1) + 1)
    return Waypoints(model.stepped.tracked, t, motions[name](model, t), TURN)


def is_of_the_tool(names: tuple[str, ...]) -> bool:
    """Whether these columns, or the motion with this single name, are in tool space."""
    return any(n.startswith("tool.") for n in names) or names == ("circle",)


def _clock(t: np.ndarray) -> np.ndarray:
    """Time with a smooth start from rest, s."""
    return np.where(t < RAMP, t * t / (2 * RAMP), t - 0.5 * RAMP)


def _sines(model: Augmented, t: np.ndarray) -> np.ndarray:
    """Every joint swings about home, each at its own frequency."""
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
    smooth = share**3 * (10 - 15 * share + 6 * share**2)  # at rest, without acceleration, at either end
    a, b = stops[leg.astype(int)], stops[leg.astype(int) + 1]
    return np.asarray(a + smooth[:, None] * (b - a))


def _circle(model: Augmented, t: np.ndarray) -> np.ndarray:
    """The tool on a tilted ellipse through its home position."""
    begin, phase = model.outputs(model.start()), 2 * np.pi * _clock(t) / TURN
    around = np.stack([np.cos(phase) - 1.0, np.sin(phase), 0.5 * np.sin(phase)], axis=-1)
    return np.asarray(begin + RADIUS * around)


def _held(model: Augmented) -> set[str]:
    """The channels of the joints that the model holds."""
    return {f"position.{name}" for name in optional.held(model.robot)}


def _about(model: Augmented) -> tuple[np.ndarray, np.ndarray]:
    """(n,) home and (n,) amplitude of each joint, rad or m; one that is held has none."""
    at = model.stepped
    home = model.start()[[at.states.index(c) for c in at.poses]]
    low, high = (np.array(side) for side in zip(*at.spans, strict=True))
    size = np.minimum(SWING, REACH * (high - low)) * [c not in _held(model) for c in at.poses]
    return np.clip(home, low + 1.2 * size, high - 1.2 * size), size
