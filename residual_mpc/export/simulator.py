"""The augmented model as a simulator that is stepped: for planners, reinforcement learning, tests of controllers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented, Build, augmented_from, settings_from
from residual_mpc.export.source import robot_beside
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.load import load_robot
from residual_mpc.models.model_file import read_written
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.sensing import Late
from residual_mpc.models.settings import Settings
from residual_mpc.models.simulating import Simulating, Simulator
from residual_mpc.models.stepping import Stepping

USUAL_PERIOD = 0.02  # s


def corrected_simulator(model: Path, robot: str | None = None, rows: int = 1, period: float | None = None) -> Simulator:
    """The simulator of a diagnosis.json or model.json, effects included; see residual_mpc.models.simulating.Simulator.

    Args:
        model: what `diagnose` or `learn` wrote.
        robot: robot file, MJCF or URDF file, or name; by default the one that the model names.
        rows: simulations side by side.
        period: s that a command is held; by default 0.02, and of a learned model that at which it was learned.

    Raises:
        BadInput: for a model of another robot, a robot that can neither be simulated nor stepped, or a network on an
            engine (which corrects whole replays, see residual_mpc.learning.forms.residual_robot, and is not stepped).
    """
    source = read_written(model)
    nominal = load_robot(read_robot_file(robot or robot_beside(source.content, model)))
    residual = residual_in(source)
    at = period or (USUAL_PERIOD if residual is None else residual.step)
    if isinstance(nominal, Stepping) and (residual is not None or not isinstance(nominal, Simulating)):
        return SteppedSimulator(augmented_from(source, nominal, Build(at)), rows)
    if not isinstance(nominal, Simulating):
        raise BadInput(
            f"{nominal.name!r} cannot be simulated step by step", str(model), "see docs/guide/your-own-model.md"
        )
    if residual is not None:
        raise BadInput(
            "a network on top of a physics engine cannot be simulated step by step",
            str(model),
            "use the diagnosis that it was learned on",
        )
    settings = settings_from(source, nominal)
    try:
        return nominal.simulator(settings, rows, at)
    except ValueError as error:
        raise BadInput(str(error), str(model)) from error


class SteppedSimulator:
    """A robot that says its step x+ = f(x, u, p), network included, as a simulator; in numpy, rows at once."""

    def __init__(self, model: Augmented, rows: int) -> None:
        self.model, self.rows, self.period = model, rows, model.build.dt
        each = np.zeros(rows, dtype=int)
        self._sensors = Late(model.robot, _sensors_alone(model.settings).take(each), self.period)
        self._x = np.tile(model.start(), (rows, 1))  # (rows, nx)
        self.reset()

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.model.robot.actuators

    @property
    def channels(self) -> tuple[str, ...]:
        return self.model.stepped.poses

    def reset(
        self,
        start: Mapping[str, float | np.ndarray] | None = None,
        command: Any = None,
        where: np.ndarray | None = None,
    ) -> dict[str, np.ndarray]:
        """As Simulator.reset; a start names poses alone, and the robot stands: `command` is not taken."""
        if command is not None:
            raise ValueError("a stepped model starts at rest and has no command history: omit `command`")
        unknown = sorted(set(start or {}) - set(self.channels))
        if unknown:
            raise ValueError(
                f"unknown channels in the start: {', '.join(unknown)}; the channels are {', '.join(self.channels)}"
            )
        chosen = np.ones(self.rows, dtype=bool) if where is None else np.broadcast_to(where, self.rows)
        given = {c: np.broadcast_to(np.asarray(v, dtype=float), self.rows) for c, v in (start or {}).items()}
        before = self._sensors.save() if where is not None else ()
        for row in np.flatnonzero(chosen):
            self._x[row] = self.model.at_rest({c: float(v[row]) for c, v in given.items()})
        self._sensors.begin(self._truth())
        if before:
            self._sensors.restore(before, ~chosen)
        return self._sensors.read()

    def step(self, command: Any) -> dict[str, np.ndarray]:
        given = np.asarray(command, dtype=float)
        nu = self.model.nu
        if given.shape not in ((nu,), (self.rows, nu)) or not np.isfinite(given).all():
            raise ValueError(
                f"a command must be finite and of shape ({nu},) or ({self.rows}, {nu}), got shape {given.shape}"
            )
        self._x = self.model.numpy_step(self._x, np.broadcast_to(given, (self.rows, nu)))
        self._sensors.push(self._truth())
        return self._sensors.read()

    def save(self) -> tuple[np.ndarray, Any]:
        return self._x.copy(), self._sensors.save()

    def restore(self, saved: tuple[np.ndarray, Any]) -> None:
        x, late = saved
        self._x = x.copy()
        self._sensors.restore(late, np.ones(self.rows, dtype=bool))

    def _truth(self) -> dict[str, np.ndarray]:
        names = self.model.stepped.states
        return {c: self._x[:, names.index(c)].copy() for c in self.channels}


def _sensors_alone(settings: Settings) -> Settings:
    return Settings(settings.rows, {e: p for e, p in settings.effects.items() if BY_NAME[e].stage == "sensor"})
