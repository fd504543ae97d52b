"""The rollout of an arm's rows in machine code, where its model allows it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from plants.mujoco_robot.native.arm import Field, chain_of, numbers_of
from plants.mujoco_robot.native.compiled import Compiled, Rollout
from plants.mujoco_robot.native.eligible import FIXED, agrees, eligible
from plants.mujoco_robot.native.lanes import LANES

if TYPE_CHECKING:
    import mujoco

Nodes = tuple[np.ndarray, np.ndarray]


class NativeArm:
    """The programs of a model: with and without dry friction, with and without joint limits."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._compiled: dict[tuple[bool, bool], Compiled | None] = {}

    def rollout(
        self, batch: Any, controls: np.ndarray, cuts: Sequence[int], each: int, between: Callable[[int], None]
    ) -> Nodes | None:
        """Positions and velocities (B, K + 1, n) of a batch from its present state on, under controls (B, K, nu) that
        are held for `each` steps of the model; `between` is called before the steps in `cuts` and may write to the
        batch. None, and the batch in its state of before, where MuJoCo has to do it."""
        if batch.bind("qfrc_applied").any() or any(batch.expanded(name) is not None for name in FIXED):
            return None
        (rows, steps, nu), n = controls.shape, self._model.nv
        blocks = -(-rows // LANES)
        q, v = batch.bind("qpos"), batch.bind("qvel")
        positions, velocities = (np.empty((blocks * LANES, steps + 1, n)) for _ in range(2))
        positions[:rows, 0], velocities[:rows, 0] = q, v
        sent = _whole(np.ascontiguousarray(controls), blocks)
        state = _in_blocks(np.concatenate([q, v, np.zeros_like(v)], axis=1), blocks)
        forces, failed = np.zeros((blocks, nu, LANES)), np.zeros((blocks, 1, LANES))
        field = fields_of(batch, self._model)
        for k, end in zip(cuts, [*cuts[1:], steps], strict=True):
            q[:], v[:] = positions[:rows, k], velocities[:rows, k]
            between(k)
            program = self._program(field)
            if program is None:
                break
            numbers = _in_blocks(numbers_of(self._model, field, rows), blocks)
            program(Rollout(numbers, state, sent, positions, velocities, forces, failed), k, end, each)
        if program is None or failed.any():
            q[:], v[:] = positions[:rows, 0], velocities[:rows, 0]
            return None
        return positions[:rows], velocities[:rows]

    def advance(self, batch: Any, controls: np.ndarray, each: int, rows: np.ndarray) -> bool:
        """Move some rows (m,) of a batch to where the controls (B, K, nu) lead; False, and nothing moved, where MuJoCo
        has to do it."""
        q, v = batch.bind("qpos"), batch.bind("qvel")
        kept = q.copy(), v.copy()
        nodes = self.rollout(batch, controls, (0,), each, lambda k: None)
        if nodes is None:
            return False
        q[:], v[:] = kept
        q[rows], v[rows] = (x[rows, -1] for x in nodes)
        return True

    def _program(self, field: Field) -> Compiled | None:
        rubs, stops = bool((field("dof_frictionloss") > 0.0).any()), bool(field("jnt_limited").any())
        if (rubs, stops) not in self._compiled:
            program = Compiled(chain_of(self._model, rubs, stops))
            self._compiled[rubs, stops] = program if agrees(self._model, program, rubs, stops) else None
        return self._compiled[rubs, stops]


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


def _whole(x: np.ndarray, blocks: int) -> np.ndarray:
    """Rows for whole blocks, the last repeated."""
    missing = blocks * LANES - len(x)
    return np.concatenate([x, np.repeat(x[-1:], missing, axis=0)]) if missing else x


def _in_blocks(x: np.ndarray, blocks: int) -> np.ndarray:
    """(B, k) -> (blocks, k, LANES)"""
    return np.ascontiguousarray(_whole(x, blocks).reshape(blocks, LANES, -1).transpose(0, 2, 1))
