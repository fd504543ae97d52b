"""The real arm, where there is none: the other engine with withheld effects, seen through its sensors."""

from dataclasses import dataclass, field

import numpy as np

from plants.scaler_arm.dynamics.stick_slip import sticking_start, sticking_step
from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER
from plants.scaler_arm.kinematics.loop_closure import CHANNELS
from plants.scaler_arm.withheld import TYPICAL, Withheld, really
from plants.sensors import Sensed, Sensor
from plants.simulator import Plant, Reading, Simulator
from residual_mpc.errors import BadInput

FINE = 0.002  # s: the longest step between looks at the command on its way
NEGLIGIBLE = 1e-7  # s: commands that arrive this close to a step's end arrive there
ENCODERS = Sensor(
    {**{f"position.{m}": 2e-4 for m in MOTORS}, **{f"velocity.{m}": 0.01 for m in MOTORS}}  # rad, rad/s
)
TOOL = {f"tool.{axis}": 0.001 for axis in "xyz"}  # m
CAMERA = Sensor(TOOL, period=1 / 30, spikes=0.2, spike=dict.fromkeys(TOOL, 0.05), loss=0.02)


@dataclass(frozen=True)
class Twin:
    """A simulator whose commands arrive late, whose gears stick, and whose encoders count; see `withheld`."""

    inner: Simulator
    withheld: Withheld = field(repr=False)
    name: str = "scaler_arm"
    actuators: tuple[str, ...] = MOTORS
    channels: tuple[str, ...] = CHANNELS

    def start(self, rng: np.random.Generator, at: Reading) -> Plant:
        return _Running(self, self.inner.start(rng, at))


def twin(engine: str, withheld: Withheld = TYPICAL, sensors: tuple[Sensor, ...] = (ENCODERS, CAMERA)) -> Simulator:
    """The real arm's stand-in in "mujoco" or "pybullet": take the engine that the model at hand does not use.

    The paper's arm is localised by its encoders; the camera, noisy and with spikes, sees the tool point beside them.
    Raises BadInput for another engine.
    """
    arm = really(SCALER, withheld)
    engines: dict[str, Simulator] = {"mujoco": MujocoArm(arm), "pybullet": PybulletArm(arm)}
    if engine not in engines:
        raise BadInput(f"engine must be one of {', '.join(engines)}, got {engine!r}", "twin")
    return Sensed(Twin(engines[engine], withheld), sensors)


class _Running:
    """A leaf: the engine, and the commands that are still on their way."""

    def __init__(self, what: Twin, inner: Plant) -> None:
        self._what, self._inner = what, inner
        at = inner.truth()
        rest = np.array([at[f"position.{m}"] for m in MOTORS])
        self._sent: list[tuple[float, np.ndarray]] = [(-np.inf, rest)]  # (when s, command), oldest first
        self._stuck = sticking_start(rest)

    @property
    def time(self) -> float:
        return self._inner.time

    def measure(self) -> Reading:
        exact = self._inner.measure()
        counts = self._what.withheld.counts
        if not counts:
            return exact
        step = 2 * np.pi / counts
        return {c: step * round(x / step) if c.startswith("position.") else x for c, x in exact.items()}

    def truth(self) -> Reading:
        return self._inner.truth()

    def step(self, command: np.ndarray, dt: float) -> None:
        self._sent.append((self._inner.time, np.asarray(command, dtype=np.float64).copy()))
        for h in self._pieces(dt):
            target, self._stuck = sticking_step(self._what.withheld.sticking, self._stuck, self._arrived(), h)
            self._inner.step(target, h)

    def _pieces(self, dt: float) -> np.ndarray:
        """Steps s, none longer than FINE, that dt falls into, cut where a command arrives."""
        now, delay = self._inner.time, self._what.withheld.delay
        even = np.linspace(0.0, dt, max(1, int(np.ceil(dt / FINE - 1e-9))) + 1)
        arrivals = np.array([sent + delay - now for sent, _ in self._sent[1:]])
        inside = arrivals[np.abs(arrivals[:, None] - even).min(axis=1) > NEGLIGIBLE]
        return np.diff(np.sort(np.append(even, inside[(inside > 0) & (inside < dt)])))

    def _arrived(self) -> np.ndarray:
        """The command sent last at least a delay ago; what is older is forgotten."""
        when = self._inner.time - self._what.withheld.delay + NEGLIGIBLE
        while len(self._sent) > 1 and self._sent[1][0] <= when:
            self._sent.pop(0)
        return self._sent[0][1]

    def close(self) -> None:
        self._inner.close()
