"""The rollout of an arm's rows in machine code, where its model allows it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from plants.mujoco_robot.native.arm import Field, chain_of, numbers_of
from plants.mujoco_robot.native.changing import Changing
from plants.mujoco_robot.native.compiled import Compiled, Rollout, compiled
from plants.mujoco_robot.native.eligible import FIXED, agrees, eligible
from plants.mujoco_robot.native.program import LANES
from plants.mujoco_robot.native.running import Running, in_blocks, whole_blocks
from plants.mujoco_robot.native.step import Chain, sizes

if TYPE_CHECKING:
    import mujoco

Nodes = tuple[np.ndarray, np.ndarray]


class NativeArm:
    """The programs of a model: with and without dry friction and joint limits, and with what changes between steps."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._chains: dict[tuple[bool, bool], Chain] = {}
        self._plain: dict[tuple[bool, bool], Compiled | None] = {}

    def rollout(
        self, batch: Any, controls: np.ndarray, cuts: Sequence[int], each: int, between: Callable[[int], None]
    ) -> Nodes | None:
        """Positions and velocities (B, K + 1, n) of a batch from its present state on, under controls (B, K, nu) that
        are held for `each` steps of the model; `between` is called before the steps in `cuts` and may write to the
        batch. None, and the batch in its state of before, where MuJoCo has to do it."""
        if batch.bind("qfrc_applied").any() or not self._knows(batch):
            return None
        on = self._begun(batch, controls, np.zeros((len(controls), 0)))
        q, v, rows = batch.bind("qpos"), batch.bind("qvel"), len(controls)
        field = fields_of(batch, self._model)
        begun = q.copy(), v.copy()
        for k, end in zip(cuts, [*cuts[1:], controls.shape[1]], strict=True):
            q[:], v[:] = on.positions[:rows, k], on.velocities[:rows, k]
            between(k)
            program = self._program(field)
            if program is None:
                break
            on.numbers[:] = in_blocks(numbers_of(self._model, field, rows))
            program(on, k, end, each)
        if program is None or on.failed.any():
            q[:], v[:] = begun
            return None
        return on.positions[:rows], on.velocities[:rows]

    def changing_rollout(
        self, batch: Any, controls: np.ndarray, each: int, changing: Changing, numbers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Positions and velocities as in `rollout` and the actuators' forces (B, K + 1, nu), where things change from
        step to step; numbers (B, changing.count). controls (B, K, nu), or (B, K, 2 nu) with what is switched on."""
        field, rows = fields_of(batch, self._model), len(controls)
        program = self._program(field, changing) if self._knows(batch) else None
        if program is None:
            return None
        on = self._begun(batch, controls, numbers)
        on.numbers[:, : self._size] = in_blocks(numbers_of(self._model, field, rows))
        program(on, 0, controls.shape[1], each)
        if on.failed.any():
            return None
        if changing.records:
            on.outputs[:, -1] = on.outputs[:, -2]
        return on.positions[:rows], on.velocities[:rows], on.outputs[:rows]

    def running(
        self, batch: Any, steps: int, each: int, changing: Changing | None, numbers: np.ndarray | None
    ) -> Running | None:
        """The batch's rows, to go on by so many steps at a time; see `changing_rollout`. None where MuJoCo has to."""
        field, rows = fields_of(batch, self._model), batch.nsim
        program = self._program(field, changing) if self._knows(batch) else None
        if program is None:
            return None
        more = np.zeros((rows, 0)) if numbers is None else numbers
        on = self._begun(batch, np.zeros((rows, steps, self._model.nu)), more)
        on.numbers[:, : self._size] = in_blocks(numbers_of(self._model, field, rows))
        return Running(program, on, self._size, changing, each)

    def _knows(self, batch: Any) -> bool:
        """Whether the batch's rows differ in nothing that a program takes from the model."""
        return all(batch.expanded(name) is None for name in FIXED)

    def _begun(self, batch: Any, controls: np.ndarray, more: np.ndarray) -> Rollout:
        """At the batch's present state; its own numbers are still to be written before `more` (B, k)."""
        (rows, steps, _), n, nu = controls.shape, self._model.nv, self._model.nu
        whole = -(-rows // LANES) * LANES
        q, v = batch.bind("qpos"), batch.bind("qvel")
        positions, velocities = (np.empty((whole, steps + 1, n)) for _ in range(2))
        positions[:rows, 0], velocities[:rows, 0] = q, v
        room = np.zeros((rows, self._size))
        blocks = whole // LANES
        return Rollout(
            in_blocks(np.concatenate([room, more], axis=1)),
            in_blocks(np.concatenate([q, v, np.zeros_like(v)], axis=1)),
            whole_blocks(np.ascontiguousarray(controls)),
            positions,
            velocities,
            np.empty((whole, steps + 1, nu)),
            np.zeros((blocks, nu, LANES)),
            np.zeros((blocks, 1, LANES)),
        )

    @cached_property
    def _size(self) -> int:
        return sizes(chain_of(self._model, False, False))

    def _program(self, field: Field, changing: Changing | None = None) -> Compiled | None:
        rubs = changing is not None and changing.level >= 0
        kind = rubs or bool((field("dof_frictionloss") > 0.0).any()), bool(field("jnt_limited").any())
        if kind not in self._plain:
            chain = self._chains[kind] = chain_of(self._model, *kind)
            plain = compiled(chain)
            self._plain[kind] = plain if agrees(self._model, plain, *kind) else None
        program = self._plain[kind]
        if changing is None or program is None:
            return program
        return compiled(self._chains[kind], changing)


_ARMS: WeakKeyDictionary[Any, NativeArm | None] = WeakKeyDictionary()


def native_arm(model: mujoco.MjModel) -> NativeArm | None:
    """The programs of a model, made at first use; None of a model that MuJoCo alone can step."""
    if model not in _ARMS:
        _ARMS[model] = NativeArm(model) if _compiles() and eligible(model) else None
    return _ARMS[model]


@cache
def _compiles() -> bool:
    return find_spec("llvmlite") is not None


def fields_of(batch: Any, model: mujoco.MjModel) -> Field:
    """A field of the model -> its values in the batch's rows, (B, ...), or (1, ...) where all are alike."""

    def field(name: str) -> np.ndarray:
        rows = batch.expanded(name)
        if rows is not None:
            return np.asarray(rows)
        return np.asarray(getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name))[None]

    return field
