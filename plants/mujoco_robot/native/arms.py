"""The rollout of an arm's rows in machine code, where its model allows it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from plants.mujoco_robot.native.arm import Field, chain_of, field_of, numbers_of
from plants.mujoco_robot.native.chain import Chain, sizes
from plants.mujoco_robot.native.changing import Changing
from plants.mujoco_robot.native.compiled import Compiled, Rollout, compiled
from plants.mujoco_robot.native.eligible import agrees, alike
from plants.mujoco_robot.native.program import LANES, Program
from plants.mujoco_robot.native.running import Running, in_blocks, whole_blocks
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

if TYPE_CHECKING:
    import mujoco

LOG = logging.getLogger(__name__)
Kind = tuple[bool, bool, tuple[int, ...]]  # what rows have: dry friction, limits, and tendons with dry friction


@dataclass(frozen=True, eq=False)
class Rolled:
    """Positions and velocities (B, K + 1, n), and the actuators' forces in the step from a node on (B, K + 1, nu),
    valid only where they were requested; exact (B,) bool: rows whose every step is the same as MuJoCo's."""

    positions: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    exact: np.ndarray


class NativeArm:
    """The programs of a model: with and without dry friction and joint limits, and with what changes between steps."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._chains: dict[Kind, Chain] = {}
        self._plain: dict[Kind, Compiled | None] = {}

    def rollout(
        self, batch: Any, controls: np.ndarray, cuts: Sequence[int], each: int, between: Callable[[int], None]
    ) -> Rolled | None:
        """A batch from its present state on, in which it is left, under controls (B, K, nu) that are held for `each`
        steps of the model; `between` is called before the steps in `cuts` and may write to the batch. None where
        MuJoCo has to do it."""
        on = self._begun(batch, controls, np.zeros((len(controls), 0)))
        q, v, rows = batch.bind("qpos"), batch.bind("qvel"), len(controls)
        begun = q.copy(), v.copy()
        known = True
        for k, end in zip(cuts, [*cuts[1:], controls.shape[1]], strict=True):
            q[:], v[:] = on.positions[:rows, k], on.velocities[:rows, k]
            between(k)
            program = self._program(batch)
            if program is None:
                known = False
                break
            on.numbers[:] = in_blocks(self._numbers(batch))
            program(on, k, end, each)
        q[:], v[:] = begun
        return _rolled(on, rows) if known else None

    def changing_rollout(
        self, batch: Any, controls: np.ndarray, each: int, changing: Changing, numbers: np.ndarray
    ) -> Rolled | None:
        """As `rollout`, where things change from step to step; numbers (B, changing.count). controls (B, K, nu), or
        (B, K, 2 nu) with what is switched on."""
        program = self._program(batch, changing)
        if program is None:
            return None
        on = self._begun(batch, controls, numbers)
        on.numbers[:, : self._size] = in_blocks(self._numbers(batch))
        program(on, 0, controls.shape[1], each)
        if changing.records and controls.shape[1]:
            on.outputs[:, -1] = on.outputs[:, -2]
        return _rolled(on, len(controls))

    def running(
        self, batch: Any, steps: int, each: int, changing: Changing | None, numbers: np.ndarray | None
    ) -> Running | None:
        """The batch's rows, to go on by so many steps at a time; see `changing_rollout`. None where MuJoCo has to do
        it."""
        program, rows = self._program(batch, changing), batch.nsim
        if program is None:
            return None
        more = np.zeros((rows, 0)) if numbers is None else numbers
        on = self._begun(batch, np.zeros((rows, steps, self._model.nu)), more)
        on.numbers[:, : self._size] = in_blocks(self._numbers(batch))
        return Running(program, on, self._size, changing, each)

    def _numbers(self, batch: Any) -> np.ndarray:
        return numbers_of(self._model, _fields_of(batch, self._model), batch.bind("qfrc_applied"))

    def _begun(self, batch: Any, controls: np.ndarray, more: np.ndarray) -> Rollout:
        """At the batch's present state; its own numbers are still to be written before `more` (B, k)."""
        (rows, steps, _), n, nu = controls.shape, self._model.nv, self._model.nu
        whole = -(-rows // LANES) * LANES
        q, v = batch.bind("qpos"), batch.bind("qvel")
        positions, velocities = (np.empty((whole, steps + 1, n)) for _ in range(2))
        positions[:rows, 0], velocities[:rows, 0] = q, v
        blocks = whole // LANES
        return Rollout(
            in_blocks(np.concatenate([np.zeros((rows, self._size)), more], axis=1)),
            in_blocks(np.concatenate([q, v, np.zeros_like(v)], axis=1)),
            whole_blocks(np.ascontiguousarray(controls, dtype=np.float64)),
            positions,
            velocities,
            np.empty((whole, steps + 1, nu)),
            np.zeros((blocks, nu, LANES)),
            np.zeros((blocks, 1, LANES)),
        )

    @cached_property
    def _size(self) -> int:
        return sizes(chain_of(self._model, False, False))

    def _program(self, batch: Any, changing: Changing | None = None) -> Compiled | None:
        field = _fields_of(batch, self._model)
        rubs = changing is not None and changing.level >= 0
        rubs = rubs or bool((field("dof_frictionloss") > 0.0).any())
        rubbing = tuple(np.flatnonzero((field("tendon_frictionloss") > 0.0).any(axis=0)).tolist())
        kind = rubs, bool(field("jnt_limited").any()), rubbing
        if kind not in self._plain:
            chain = self._chains[kind] = chain_of(self._model, *kind)
            plain = compiled(chain)
            self._plain[kind] = plain if agrees(self._model, plain, *kind) else None
        program = self._plain[kind]
        if changing is None or program is None:
            return program
        return compiled(self._chains[kind], changing)


_ARMS: WeakKeyDictionary[CompiledRobot, NativeArm | None] = WeakKeyDictionary()


def native_arm(robot: CompiledRobot) -> NativeArm | None:
    """The programs of a robot, made at first use; None of one that MuJoCo alone can step."""
    if robot not in _ARMS:
        models = [part.model for part in robot.settings] or [robot.model]
        _ARMS[robot] = NativeArm(robot.model) if _compiles() and alike(models, robot.differing) else None
    return _ARMS[robot]


@cache
def _compiles() -> bool:
    """Whether there is a compiler; its absence is no error."""
    from plants.mujoco_robot.native.compiled import engine_of

    try:
        engine_of(Program().text("nothing", []), 0, "nothing")
    except (ImportError, OSError, RuntimeError) as error:
        LOG.info("arms are replayed by MuJoCo, many times more slowly: %s", error)
        return False
    return True


def _fields_of(batch: Any, model: mujoco.MjModel) -> Field:
    """A field of the model -> its values in the batch's rows, (B, ...), or (1, ...) where all are alike."""

    def field(name: str) -> np.ndarray:
        rows = batch.expanded(name)
        return field_of(model, name) if rows is None else np.asarray(rows)

    return field


def _rolled(on: Rollout, rows: int) -> Rolled:
    exact = on.failed.transpose(0, 2, 1).reshape(-1)[:rows] == 0.0
    return Rolled(on.positions[:rows], on.velocities[:rows], on.outputs[:rows], exact)
