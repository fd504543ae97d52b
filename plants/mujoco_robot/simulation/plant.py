"""A MuJoCo robot with withheld effects as the plant of a closed loop, at a shorter time step than its model's."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plants.mujoco_robot.simulation.simulator import CorrectedMujoco
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.models.logged_laws import at_values
from residual_mpc.models.settings import Settings, Values, assemble

TOOL = ("tool.x", "tool.y", "tool.z")
FINER = 4  # steps of the plant in one step of the model
Reading = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class MujocoPlant:
    """See plants.simulator.Simulator. robot: with the shorter step; withheld: one row; period: s between commands."""

    robot: CompiledRobot
    withheld: Settings
    period: float

    @property
    def name(self) -> str:
        return self.robot.name

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.robot.actuators

    @property
    def channels(self) -> tuple[str, ...]:
        return (*self.robot.channels, *TOOL)

    def start(self, rng: np.random.Generator, at: Reading) -> "MovingRobot":
        """The robot at rest at these channels; nothing is random."""
        return MovingRobot(self, at)


class MovingRobot:
    """A running MuJoCo simulation. The tool position is that of the nominal link lengths."""

    def __init__(self, plant: MujocoPlant, at: Reading) -> None:
        import mujoco

        self._plant = plant
        self._simulator = CorrectedMujoco(plant.robot, plant.withheld, 1, plant.period)
        known = {c: float(x) for c, x in at.items() if c in plant.robot.channels}
        self._seen = self._simulator.reset(known)
        self._steps = 0
        self._data = mujoco.MjData(plant.robot.model)

    @property
    def time(self) -> float:
        return self._steps * self._plant.period

    def measure(self) -> Reading:
        return {**{c: float(x[0]) for c, x in self._seen.items()}, **self._tool()}

    def truth(self) -> Reading:
        q, v = self._simulator.state()
        robot = self._simulator.robot
        found = {f"position.{j}": float(q[p]) for j, p in zip(robot.joints, robot.places, strict=True)}
        found |= {f"velocity.{j}": float(v[d]) for j, d in zip(robot.joints, robot.dofs, strict=True)}
        return {**found, **self._tool()}

    def step(self, command: np.ndarray, dt: float) -> None:
        """Hold command (nu,) for dt s, which must be the plant's period."""
        if abs(dt - self._plant.period) > 1e-9:
            raise ValueError(f"this plant is stepped by {self._plant.period} s, got {dt} s")
        self._seen = self._simulator.step(command)
        self._steps += 1

    def close(self) -> None:
        """Nothing to release."""

    def _tool(self) -> dict[str, float]:
        import mujoco

        robot, moving = self._plant.robot, self._simulator.robot
        q, _ = self._simulator.state()
        self._data.qpos[robot.places] = q[moving.places]
        mujoco.mj_kinematics(robot.model, self._data)
        body, place = robot.payload
        at = self._data.xpos[body] + self._data.xmat[body].reshape(3, 3) @ place
        return dict(zip(TOOL, at.tolist(), strict=True))


def mujoco_plant(robot: CompiledRobot, withheld: Values, period: float, finer: int = FINER) -> MujocoPlant:
    """The robot with effects that its model lacks, simulated at 1/`finer` of the model's time step."""
    model = copy.copy(robot.model)
    model.opt.timestep = robot.model.opt.timestep / finer
    spec = None if robot.spec is None else robot.spec.copy()
    if spec is not None:
        spec.option.timestep = model.opt.timestep
    own = replace(robot, model=model, spec=spec)
    withheld = at_values(withheld)
    return MujocoPlant(own, assemble([withheld], {k.effect: robot.slots(k.effect) for k in withheld}), period)


def joint_points(robot: CompiledRobot, columns: Mapping[str, np.ndarray], stride: int) -> np.ndarray:
    """(frames, joints + 1, 3) positions of the anchors of the measured joints and of the tool at every stride-th row of
    a run, m; other joints, such as held fingers, rest."""
    import mujoco

    data, (body, place) = mujoco.MjData(robot.model), robot.payload
    there = [k for k, j in enumerate(robot.joints) if f"position.{j}" in columns]
    positions = np.stack([columns[f"position.{robot.joints[k]}"] for k in there], axis=-1)[::stride]
    places, numbers = robot.places[there], robot.numbers[there]
    out = []
    for q in positions:
        data.qpos[places] = q
        mujoco.mj_kinematics(robot.model, data)
        tool = data.xpos[body] + data.xmat[body].reshape(3, 3) @ place
        out.append(np.vstack([data.xanchor[numbers], tool]))
    return np.array(out)
