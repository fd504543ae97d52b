"""Rows stepped by MuJoCo Warp on a graphics processor, in single precision, for models that no program in machine code
replays: contacts, wheels, closed chains."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from copy import copy
from dataclasses import Field, dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra

if TYPE_CHECKING:
    import mujoco

LOG = logging.getLogger(__name__)
DEVICE = "RESIDUAL_MPC_WARP_DEVICE"  # the variable with Warp's name of a device: cuda, cuda:1, cpu
LOG_WARNINGS = 30  # of Warp, which announces itself and each kernel otherwise
CONTROL = 1 << 6  # mjSTATE_CTRL
# fields that `set_const` derives and no step of Warp reads
UNUSED = {"bvh_aabb", "dof_M0", "dof_length", "body_sameframe", "geom_sameframe", "site_sameframe"}
STATE = ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "qacc_warmstart")


def batch_of(model: mujoco.MjModel, rows: int, threads: int) -> Any:
    """A `mujoco.batch.Batch`, or a `WarpBatch` where a device is named and Warp can simulate the model.

    Raises BadInput where Warp is not installed or has no such device.
    """
    from mujoco.batch import Batch

    batch = Batch(model, rows, nthread=threads)
    device = os.environ.get(DEVICE, "")
    on_device = _on_device(model, device) if device else None
    return batch if on_device is None else WarpBatch(batch, on_device)


@dataclass(frozen=True, eq=False)
class OnDevice:
    """device: Warp's name of it; model: Warp's; fields: MuJoCo's names of the model fields that rows may differ in."""

    device: str
    model: Any
    fields: tuple[str, ...]


class WarpBatch:
    """A batch whose rows Warp steps. States and model fields stay in the host's batch and are copied to Warp before
    each call; states are copied back after it. MuJoCo performs calls for a subset of the rows, calls with rows that
    differ in a field that Warp shares, and the rows that exceed Warp's contact buffer."""

    def __init__(self, batch: Any, on: OnDevice) -> None:
        self._batch, self._on = batch, on
        self._by_mujoco = batch.bind("actuator_force")  # filled by MuJoCo's own steps alone
        self._force = np.zeros((batch.nsim, batch.model.nu))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)

    def bind(self, field: str) -> np.ndarray:
        """As `Batch.bind`; of what a step computes, only the actuators' forces are those of Warp's step."""
        return self._force if field == "actuator_force" else np.asarray(self._batch.bind(field))

    def step(self, rows: np.ndarray | None = None, nstep: int = 1) -> None:
        """As `Batch.step`."""
        if rows is not None:
            self._batch.step(rows, nstep=nstep)
            self._force[rows] = self._by_mujoco[rows]
            return
        self.rollout(nstep, np.repeat(self._batch.bind("ctrl")[:, None], nstep, axis=1), CONTROL, ())

    def rollout(
        self, nstep: int, control: np.ndarray, spec: int, record: Sequence[str], rows: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """As `Batch.rollout` under controls (rows, nstep, nu), for records (rows, nstep, n) of the state."""
        if spec != CONTROL or (rows is not None and len(rows) < self._batch.nsim) or self._unknown():
            recorded = dict(self._batch.rollout(nstep, control, spec, record, rows))
            moved = slice(None) if rows is None else rows
            self._force[moved] = self._by_mujoco[moved]
            return recorded
        import mujoco_warp
        import warp

        begun = self._batch.state.copy()
        with warp.ScopedDevice(self._on.device):
            model, data = self._model(), self._data
            for field in STATE:
                _assign(getattr(data, field), self._batch.bind(field))
            data.overflow.zero_()
            sent = np.ascontiguousarray(control.transpose(1, 0, 2), dtype=np.float32)
            held = warp.array(sent) if sent.size else ()
            nodes: dict[str, list[np.ndarray]] = {field: [] for field in record}
            for k in range(nstep):
                if len(held):
                    warp.copy(data.ctrl, held[k])
                mujoco_warp.step(model, data)
                for field, found in nodes.items():
                    found.append(getattr(data, field).numpy().copy())  # of the CPU it is a view
            for field in STATE:
                _fetch(getattr(data, field), self._batch.bind(field))
            _fetch(data.actuator_force, self._force)
            left = np.flatnonzero(data.overflow.numpy())
        out = {field: np.stack(found, axis=1).astype(float) for field, found in nodes.items()}
        if len(left):
            self._batch.state[left] = begun[left]
            for field, exact in self._batch.rollout(nstep, control[left], CONTROL, record, left).items():
                out[field][left] = exact
            self._force[left] = self._by_mujoco[left]
        return out

    @cached_property
    def _data(self) -> Any:
        import mujoco_warp

        return mujoco_warp.make_data(self._batch.model, nworld=self._batch.nsim)

    def _unknown(self) -> bool:
        """Whether the rows differ in a field that Warp's model has for all rows together."""
        from mujoco.batch import MODEL_FIELDS

        shared = MODEL_FIELDS - set(self._on.fields) - UNUSED
        return any(self._batch.expanded(field) is not None for field in shared)

    def _model(self) -> Any:
        """Warp's model with the fields that differ between the host's rows now."""
        import warp

        model = copy(self._on.model)
        model.opt = copy(model.opt)
        for field in self._on.fields:
            values = self._batch.expanded(field)
            if values is None:
                continue
            owner, name = (model.opt, field[4:]) if field.startswith("opt.") else (model, field)
            shared = getattr(owner, name)
            sent = np.asarray(values, dtype=np.float32).reshape(len(values), *shared.numpy().shape[1:])
            setattr(owner, name, warp.array(sent, dtype=shared.dtype))
        return model


def _assign(on_device: Any, values: np.ndarray) -> None:
    if on_device.size:
        on_device.assign(np.ascontiguousarray(values, dtype=np.float32))


def _fetch(on_device: Any, into: np.ndarray) -> None:
    if on_device.size:
        into[:] = on_device.numpy()


_TAKEN: WeakKeyDictionary[Any, dict[str, OnDevice | None]] = WeakKeyDictionary()


def _on_device(model: mujoco.MjModel, device: str) -> OnDevice | None:
    """The model on that device, None where Warp cannot simulate it."""
    taken = _TAKEN.setdefault(model, {})
    if device not in taken:
        taken[device] = _taken(model, device)
    return taken[device]


def _taken(model: mujoco.MjModel, device: str) -> OnDevice | None:
    import mujoco
    from mujoco.batch import MODEL_FIELDS

    with extra("warp"):
        import warp

        warp.config.log_level = LOG_WARNINGS
        import mujoco_warp
    try:
        known = warp.get_device(device)
    except ValueError as wrong:
        there = ", ".join(str(d) for d in warp.get_devices())
        fault = f"{DEVICE} is {device!r}, but the devices of Warp are {there}"
        raise BadInput(fault, "", "set it to one of them, or unset it") from wrong
    given = copy(model)
    given.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # Warp never resets a row that diverges
    with warp.ScopedDevice(known):
        try:
            made = mujoco_warp.put_model(given)
        except NotImplementedError as missing:
            LOG.warning("MuJoCo Warp cannot simulate this model (%s): MuJoCo simulates it", missing)
            return None
    by_row = {f.name for f in fields(made) if _by_row(f)} | {f"opt.{f.name}" for f in fields(made.opt) if _by_row(f)}
    return OnDevice(str(known), made, tuple(sorted(by_row & MODEL_FIELDS)))


def _by_row(field: Field[Any]) -> bool:
    """Whether a field of Warp's model has a first dimension for the rows."""
    return getattr(field.type, "shape", ("",))[:1] == ("*",)
