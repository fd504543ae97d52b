"""A corrected simulator: the MuJoCo model with the diagnosed effects, stepped by whoever wants to drive it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.mujoco_robot.edits.batch import edit_batch
from plants.mujoco_robot.edits.split_gears import by_gears, edit_gears
from plants.mujoco_robot.native.running import State
from plants.mujoco_robot.simulation.between import between_steps, changing
from plants.mujoco_robot.simulation.channels import read_channels, write_start
from plants.mujoco_robot.simulation.compiled_steps import FORCES, RESISTANCES, copied, run_natively
from plants.mujoco_robot.simulation.gear_feedback import feedback
from plants.mujoco_robot.simulation.gear_start import begin
from plants.mujoco_robot.simulation.one_step import OneStep
from plants.mujoco_robot.simulation.servo_integral import begin_integrals
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_timers import stop_mujoco_timers
from residual_mpc.effects.chain import joined, on_command, on_errors
from residual_mpc.effects.library import changes
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.sensing import Late
from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class Saved:
    """The state of every row: of the engine, of the commands' way to the actuators, of the clock and the sensors."""

    engine: dict[str, np.ndarray]
    line: np.ndarray
    memories: tuple[Any, ...]
    force: np.ndarray
    clock: np.ndarray
    steps: int
    late: Any
    integrals: np.ndarray | None


class CorrectedMujoco:
    """See residual_mpc.models.simulating.Simulator. The steps are those of the diagnosis' replay, to the last bit where
    no delay ends between two steps."""

    def __init__(self, robot: CompiledRobot, settings: Settings, rows: int, period: float) -> None:
        from mujoco.batch import Batch

        silence_mujoco()
        stop_mujoco_timers()
        if settings.rows != 1 or rows < 1:
            raise ValueError(f"settings must have one row and rows must be >= 1, got {settings.rows} and {rows}")
        whole = round(period / robot.step)
        if whole < 1 or abs(whole * robot.step - period) > 1e-9 * period + 1e-12:
            raise ValueError(
                f"the period must be a multiple of the model's time step {robot.step:g} s, got {period:g} s"
            )
        self._settings = settings.take(np.zeros(rows, dtype=int))
        self._dt, dt = robot.step, robot.step  # of the robot as it was, where motors and links are told apart
        robot, _ = next(by_gears(robot, self._settings))
        self.robot, self.rows, self.period, self._whole = robot, rows, period, whole
        effects, nu = self._settings.effects, robot.model.nu
        self._batch = Batch(robot.model, rows)
        edit_batch(self._batch, robot, self._settings)
        if robot.gears is not None:
            edit_gears(self._batch, robot, self._settings)
        servos = feedback(self._batch, robot)
        self._clock = np.zeros(rows)
        nothing = np.zeros((rows, 0, nu))
        drive = Drive(dt, 0, nothing, None, self._clock, None)
        base = copied(self._batch, FORCES)
        self._between = between_steps(self._batch, robot, self._settings, drive)
        base |= copied(self._batch, RESISTANCES)
        self._one_by_one = bool(changing(robot, self._settings, ()).any())
        if not self._one_by_one:  # what they write never changes
            for update in self._between:
                update(0, np.zeros((rows, len(robot.joints))), np.zeros((rows, nu)))
        self._drive, self._integrals = drive, begin_integrals(self._batch, robot, self._settings, drive)
        errors = on_errors(effects, robot.servo)
        self._once = OneStep(self._batch, robot, self._between, servos, errors, dt, self._integrals)
        delay = changes(effects, "command delay")
        self._late, self._part = np.divmod(np.zeros((rows, nu)) if delay is None else np.maximum(delay, 0.0) / dt, 1.0)
        self._late, self._delayed = self._late.astype(int), bool(self._late.any() or self._part.any())
        self._line = np.zeros((int(self._late.max()) + 2, rows, nu))  # newest first
        acting = on_command(effects, ~robot.servo)
        self._chain = [(e, p) for e, p in acting if e.trim is None]
        self._ahead = next((k for k, (e, _) in enumerate(acting) if e.trim is not None), 0)  # of the line
        self._memories: tuple[Any, ...] = ()
        self._k = 0
        self._sensors = Late(robot, self._settings, period)
        self._force = np.zeros((rows, nu))  # of the last step: a friction may depend on the load
        changed = base if self._one_by_one else None
        self._running = run_natively(self._batch, robot, self._settings, drive, changed, self._integrals, servos, whole)
        q, v, warm = (self._batch.bind(x) for x in ("qpos", "qvel", "qacc_warmstart"))
        self._state = State(q, v, warm, self._force, None if self._integrals is None else self._integrals.value)
        self._engines_force = self._batch.bind("actuator_force")  # what is bound later is not filled by this step
        self.reset()

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.robot.actuators

    @property
    def channels(self) -> tuple[str, ...]:
        return self.robot.channels

    @property
    def model(self) -> Any:
        """The compiled nominal model, for a viewer; what differs lives in the batch's rows."""
        return self.robot.model

    def state(self, row: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """qpos (nq,) and qvel (nv,) of one row, for a viewer."""
        return self._batch.bind("qpos")[row].copy(), self._batch.bind("qvel")[row].copy()

    def reset(
        self,
        start: Mapping[str, float | np.ndarray] | None = None,
        command: Any = None,
        where: np.ndarray | None = None,
    ) -> Mapping[str, np.ndarray]:
        keep = None if where is None else ~np.broadcast_to(np.asarray(where, dtype=bool), self.rows)
        before = None if keep is None else self.save()
        self._begin(start, command)
        if before is not None and keep is not None:
            self._put_back(before, keep)
        return self._sensors.read()

    def _begin(self, start: Mapping[str, float | np.ndarray] | None, command: Any) -> None:
        robot, b = self.robot, self._batch
        given = {c: np.broadcast_to(np.asarray(x, dtype=float), self.rows) for c, x in (start or {}).items()}
        unknown = sorted(set(given) - set(robot.channels))
        if unknown:
            raise ValueError(
                f"unknown channels in the start: {', '.join(unknown)}; the channels are {', '.join(robot.channels)}"
            )
        b.reset()
        q, v = b.bind("qpos"), b.bind("qvel")
        write_start(robot, q, v, {**self._truth(), **given})
        if command is None:
            length = robot.model.actuator_gear[:, 0] * q[:, robot.places[robot.driven]]
            command = np.where(robot.servo, length, 0.0)
        held = self._commanded(command)
        self._memories, self._line[:], arrived = self._settled(held)
        self._force[:] = 0.0
        self._clock[:] = -self._k * self._dt  # the updates between the steps add the steps since the beginning
        if robot.gears is not None or self._integrals is not None:
            for update in self._between:
                update(self._k, v[:, robot.dofs], self._force)
        settled = begin_integrals(b, robot, self._settings, self._drive)
        if self._integrals is not None and settled is not None:
            self._integrals.value[:] = settled.value
        if robot.gears is not None:
            arrived = arrived if self._integrals is None else arrived + self._integrals.value
            begin(b, robot, self._settings, arrived[:, None], 0, self._once.servos)
        if robot.model.na:
            b.bind("act")[:] = held[:, robot.model.actuator_actadr >= 0]
        self._sensors.begin(self._truth())

    def step(self, command: Any) -> Mapping[str, np.ndarray]:
        held = self._commanded(command)
        u = self._sent(held)
        middle = self._clock + (self._k + 0.5) * self._dt
        if self._running is None or not self._running(self._state, u, middle):
            self._by_mujoco(u)
        self._k += self._whole
        self._sensors.push(self._truth())
        return self._sensors.read()

    def _by_mujoco(self, u: np.ndarray) -> None:
        """The steps under commands (rows, steps, nu) that have gone through the chain."""
        import mujoco

        if self._one_by_one:
            for k in range(self._whole):
                self._once(self._k + k, u[:, k], self._force)
                self._force[:] = self._engines_force
            return
        held = np.repeat(u, self.robot.substeps, axis=1)
        self._batch.rollout(held.shape[1], held, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos",))

    def _sent(self, held: np.ndarray) -> np.ndarray:
        """What the actuators see in the next steps of the model, (rows, steps, nu); their memories go on."""
        u = np.broadcast_to(held[:, None], (self.rows, self._whole, held.shape[1]))
        memories = []
        for n, ((effect, p), memory) in enumerate(zip(self._chain, self._memories, strict=True)):
            assert effect.step is not None
            u, steps = self._delayed_by_line(u) if n == self._ahead else u, []
            for k in range(self._whole):
                now, memory = effect.step(NUMPY, p, memory, u[:, k], self._dt)
                steps.append(now)
            u = np.stack(steps, axis=1)
            memories.append(memory)
        self._memories = tuple(memories)
        return np.asarray(u if self._ahead < len(self._chain) else self._delayed_by_line(u))

    def _delayed_by_line(self, u: np.ndarray) -> np.ndarray:
        """What leaves the line in the next steps while u (rows, steps, nu) enters it."""
        if not self._delayed:
            return u
        sent = np.concatenate([u.transpose(1, 0, 2)[::-1], self._line])  # newest first
        place = np.arange(self._whole)[::-1][None, :, None] + self._late[:, None]
        rows, _, columns = np.ogrid[: self.rows, :1, : place.shape[2]]
        self._line[:] = sent[: len(self._line)]
        part = self._part[:, None]
        return np.asarray((1.0 - part) * sent[place, rows, columns] + part * sent[place + 1, rows, columns])

    def _settled(self, u: np.ndarray) -> tuple[tuple[Any, ...], np.ndarray, np.ndarray]:
        """What the chain remembers of a command (rows, nu) that has been held for ever, what the line holds of it, and
        what arrives."""
        memories, held = [], u
        for n, (effect, p) in enumerate(self._chain):
            assert effect.start is not None and effect.step is not None
            memories.append(effect.start(NUMPY, p, u, self._dt))
            u, _ = effect.step(NUMPY, p, memories[-1], u, self._dt)
            held = u if n < self._ahead else held
        return tuple(memories), np.asarray(held), np.asarray(u)

    def save(self) -> Saved:
        fields = ("qpos", "qvel", "qacc_warmstart", *(("act",) if self.robot.model.na else ()))
        return Saved(
            {f: self._batch.bind(f).copy() for f in fields},
            self._line.copy(),
            self._memories,
            self._force.copy(),
            self._clock.copy(),
            self._k,
            self._sensors.save(),
            None if self._integrals is None else self._integrals.value.copy(),
        )

    def restore(self, saved: Saved) -> None:
        self._k = saved.steps
        self._put_back(saved, np.ones(self.rows, dtype=bool))

    def _put_back(self, saved: Saved, rows: np.ndarray) -> None:
        """rows (rows,) bool: which ones go back to what was saved."""
        for f, value in saved.engine.items():
            self._batch.bind(f)[rows] = value[rows]
        self._line[:, rows] = saved.line[:, rows]
        self._memories = joined(lambda old, new: np.where(rows[:, None], old, new), saved.memories, self._memories)
        self._force[rows], self._clock[rows] = saved.force[rows], saved.clock[rows]
        if self._integrals is not None and saved.integrals is not None:
            self._integrals.value[rows] = saved.integrals[rows]
        self._sensors.restore(saved.late, rows)

    def _commanded(self, command: Any) -> np.ndarray:
        """(rows, nu), finite."""
        given = np.asarray(command, dtype=float)
        nu = self.robot.model.nu
        if given.shape not in ((nu,), (self.rows, nu)):
            raise ValueError(f"a command must have shape ({nu},) or ({self.rows}, {nu}), got {given.shape}")
        if not np.isfinite(given).all():
            raise ValueError("commands must be finite")
        return np.broadcast_to(given, (self.rows, nu))

    def _truth(self) -> dict[str, np.ndarray]:
        """Every channel as it is, (rows,)."""
        robot, b = self.robot, self._batch
        found = read_channels(robot, b.bind("qpos"), b.bind("qvel"), robot.channels)
        return {c: x.copy() for c, x in found.items()}
