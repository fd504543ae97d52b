"""The model's state from what the sensors report: an extended Kalman filter on the augmented model.

Memory (commands on their way, a motor's lag, play) is driven by known commands and follows the model; pose and unknown
disturbances are corrected by the measurement. Sensor effects of the model (bias, scale, mounting, delay,
low-pass) are undone first.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.closed_loop.protocols import Reading
from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import changes, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.export.augmented import Augmented
from residual_mpc.export.casadi_model import casadi_model
from residual_mpc.export.compiled import Buffered, buffered, compiled, compiler
from residual_mpc.models.sensing import SINCE_START, Curve, sensor_value, swing_of

AGES: tuple[Quantity, ...] = ("reading delay", "reading lag")
LOST = 1e12  # variance of any state, in its unit squared, above which the model has diverged and the belief is useless
SMALL = 15_000  # instructions, beyond which compiling takes longer than an estimator with one call per sample saves


@dataclass(frozen=True)
class EstimatorSettings:
    """All 1-sigma. noise: of each pose's sensor, channel unit; drift: what a pose moves a second beside the model,
    channel unit / sqrt(s); rate: the same of the velocities of a robot with inertia, channel unit / s / sqrt(s);
    disturbance: how far an unknown constant wanders a second, its unit / sqrt(s). gate: an innovation beyond that many
    sigma is a wrong estimate of the sensor, unless `stubborn` come in a row.
    """

    noise: tuple[float, ...] = (0.002, 0.002, 0.006)  # m, m, rad
    drift: tuple[float, ...] = (0.01, 0.01, 0.05)  # m, m, rad a root second
    disturbance: tuple[float, ...] = (0.02, 0.02, 0.1)  # m/s, m/s, rad/s a root second
    rate: float = 0.5  # rad/s a root second
    gate: float = 6.0
    stubborn: int = 5

    def __post_init__(self) -> None:
        if min(*self.noise, *self.drift, *self.disturbance, self.rate, self.gate) <= 0 or self.stubborn < 1:
            raise ValueError(f"every setting of the estimator must be > 0, got {self}")


@dataclass(frozen=True, eq=False)
class StateBelief:
    """x (nx,) and P (nx, nx) at the time that the sensors speak of; sent: commands since then, oldest first; rejected:
    measurements refused in a row; origin (ny,): the poses at the start.
    """

    x: np.ndarray
    P: np.ndarray
    sent: tuple[np.ndarray, ...]
    rejected: int
    origin: np.ndarray


@dataclass(frozen=True, eq=False)
class Filter:
    """init -> belief, step(belief, command sent last, reading) -> (x now, belief). p (np,): the model's parameters."""

    model: Augmented
    settings: EstimatorSettings
    p: np.ndarray
    stage: Buffered
    poses: np.ndarray  # (ny,) places in x
    Q: np.ndarray  # (nx, nx) a step
    late: int  # samples by which the sensors are late
    part: float  # share of a sample beyond that
    anew: tuple[int, ...] = ()  # places in x that begin at 0 at each measurement
    output: Buffered | None = None  # where the model tracks something else than its poses

    def init(self, at: Mapping[str, float]) -> StateBelief:
        """At rest at a known pose, by channel."""
        x, P = self._at_rest(at)
        return StateBelief(x, P, (), 0, x[self.poses])

    def _at_rest(self, at: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """x (nx,) and P (nx, nx) of a robot at rest at a measured pose, by channel."""
        P = np.zeros((self.model.nx, self.model.nx))
        P[self.poses, self.poses] = np.square(self.settings.noise)
        return self.model.start(at), P

    def with_parameters(self, p: np.ndarray) -> "Filter":
        """The same filter, its model with other numbers (np,)."""
        return replace(self, p=np.asarray(p, dtype=np.float64))

    def step(self, belief: StateBelief, command: np.ndarray | None, reading: Reading) -> tuple[np.ndarray, StateBelief]:
        """command (nu,): what was sent at the last sample, None at the first."""
        waiting = deque(belief.sent)
        x, P, rejected = belief.x, belief.P, belief.rejected
        if command is not None:
            waiting.append(np.asarray(command, dtype=np.float64))
        while len(waiting) > self.late:
            x, P = self._predict(x, P, waiting.popleft())
        if not (np.isfinite(x).all() and np.abs(P).max() < LOST):
            x, P = self._restarted(reading, belief.origin)
        if self.anew:  # what a prediction adds up beside the poses begins at the measurement
            x = x.copy()
            x[list(self.anew)] = 0.0
        if len(waiting) == self.late:  # before that, the sensors speak of the time before the start
            y = self._pose(reading, belief.origin)
            x, P, rejected = self._correct(x, P, y, rejected, waiting[0] if waiting else None)
        now = x
        for u in waiting:
            now = self.drive(now, u)
        return now, StateBelief(x, P, tuple(waiting), rejected, belief.origin)

    def drive(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """(nx,) the model's state a sample later."""
        a = self.stage.arguments
        a[0][:], a[1][:], a[2][:] = x, u, self.p
        self.stage.run()
        return self.stage.results[0].copy()

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """(ny,) what the model tracks at x (nx,), as `Augmented.outputs` has it, and faster."""
        if self.output is None:
            return np.asarray(x[self.poses])
        self.output.arguments[0][:] = x
        self.output.run()
        return self.output.results[0].copy()

    def _predict(self, x: np.ndarray, P: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        new = self.drive(x, u)
        A = self.stage.results[1].reshape(len(x), len(x)).T
        with np.errstate(over="ignore", invalid="ignore"):
            return new, A @ P @ A.T + self.Q

    def _restarted(self, reading: Reading, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The state at rest at the measured pose, for a model that has diverged, as a model without joint stops does if
        the robot is at a stop. Channels without a measurement now are taken from the start."""
        y = self._pose(reading, origin)
        at = np.where(np.isfinite(y), y, origin)
        return self._at_rest(dict(zip(self.model.stepped.poses, at.tolist(), strict=True)))

    def _correct(
        self, x: np.ndarray, P: np.ndarray, y: np.ndarray, rejected: int, coming: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """y (ny,): the measured pose."""
        expected = x[self.poses]
        if self.part and coming is not None:  # the reading lies between two samples of the model
            expected = expected + (1.0 - self.part) * (self.drive(x, coming)[self.poses] - expected)
        seen = np.isfinite(y)
        if not seen.any():
            return x, P, rejected
        where, R = self.poses[seen], np.diag(np.square(self.settings.noise))[np.ix_(seen, seen)]
        e = (y - expected)[seen]
        angle = np.array([c == "pose.theta" for c in self.model.stepped.poses])[seen]
        e[angle] = np.remainder(e[angle] + np.pi, 2 * np.pi) - np.pi
        S = P[np.ix_(where, where)] + R
        far = bool((np.abs(e) > self.settings.gate * np.sqrt(np.diag(S))).any())
        if far and rejected + 1 < self.settings.stubborn:
            return x, P, rejected + 1
        K = np.linalg.solve(S, P[where]).T
        x = x + K @ e
        P = P - K @ S @ K.T
        return x, 0.5 * (P + P.T), 0

    def _pose(self, reading: Reading, origin: np.ndarray) -> np.ndarray:
        """(ny,) the measured pose with bias, eccentricity, scale and mounting undone; NaN where nothing came."""
        poses, settings = self.model.stepped.poses, self.model.settings
        y = np.array([reading.get(c, np.nan) for c in poses], dtype=np.float64)
        for i, c in enumerate(poses):
            offset = sensor_value(self.model.robot, settings, "reading offset", c)
            if offset is not None:
                y[i] -= offset[0]
            scale = sensor_value(self.model.robot, settings, "reading scale", c)
            swing = swing_of(self.model.robot, settings, c)
            y[i] = Curve(scale, origin[i] if c in SINCE_START else 0.0, swing).true(y[i : i + 1])[0]
        for effect, values in present(settings.effects, "point"):
            assert effect.undo is not None
            y[0], y[1] = effect.undo(NUMPY, {k: v[0, 0] for k, v in values.items()}, y[0], y[1], y[2])
        return y


def build_filter(model: Augmented, settings: EstimatorSettings, compile: bool = True) -> Filter:
    """Raises ValueError where the settings do not fit the model's poses."""
    states, poses = model.stepped.states, model.stepped.poses
    if len(settings.noise) != len(poses) or len(settings.drift) != len(poses):
        raise ValueError(
            f"noise and drift must have {len(poses)} entries, one per pose, "
            f"got {len(settings.noise)} and {len(settings.drift)}"
        )
    where = np.array([states.index(c) for c in poses])
    q = np.zeros(model.nx)
    q[where] = np.square(settings.drift) * model.build.dt
    q[[states.index(c) for c in model.stepped.rates]] = settings.rate**2 * model.build.dt
    unknown = [i for i, s in enumerate(states) if s.startswith("disturbance.")]
    if unknown:
        if len(settings.disturbance) != len(unknown):
            raise ValueError(
                f"disturbance must have {len(unknown)} entries for this model, got {len(settings.disturbance)}"
            )
        q[unknown] = np.square(settings.disturbance) * model.build.dt
    c = casadi_model(model)
    small = c.stage.n_instructions() < SMALL
    stage = compiled(c.stage, compiler() if compile and small else None)
    n, m = model.nx, model.nu
    call = buffered(stage, (n, m, len(model.p)), (n, n * n, n * m))
    # a low-pass answers a ramp as a delay of its time constant does
    ages = (changes(model.settings.effects, q) for q in AGES)
    late = sum(float(a.max()) for a in ages if a is not None) / model.build.dt
    whole = int(np.ceil(late - 1e-9))
    part = float(late - np.floor(late + 1e-9))
    anew = tuple(states.index(name) for name in model.stepped.restarts)
    output = None
    if c.output is not None:
        ny = len(model.stepped.tracked)
        output = buffered(compiled(c.output, compiler() if compile else None), (n,), (ny, ny * n))
    return Filter(model, settings, model.p, call, where, np.diag(q), whole, part, anew, output)
