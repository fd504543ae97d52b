"""Rows of an arm that go on from where they are, a few steps at a time, for a simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plants.mujoco_robot.native.changing import INTEGRAL, Changing
from plants.mujoco_robot.native.compiled import Compiled, Rollout
from plants.mujoco_robot.native.program import LANES


@dataclass(frozen=True, eq=False)
class State:
    """Of the rows: positions, velocities and accelerations that the solver begins with (B, n); the last forces, and
    what the servos' integral parts add (B, nu). The arrays are live: `Running` writes to them."""

    q: np.ndarray
    v: np.ndarray
    begin: np.ndarray
    force: np.ndarray
    added: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Running:
    """on: the rows' memory, of whole blocks. own: how many of a row's numbers are the arm's, before what changes."""

    program: Compiled
    on: Rollout
    own: int
    changing: Changing | None
    each: int

    def __call__(self, state: State, controls: np.ndarray, clock: np.ndarray) -> bool:
        """Go on under controls (B, K, nu) from clock (B,) s since the run began, at the first step's middle; whether
        that is exact. If it is not, the state is as it was."""
        on, rows, n = self.on, len(state.q), state.q.shape[1]
        for k, x in enumerate((state.q, state.v, state.begin)):
            on.state[:, k * n : (k + 1) * n] = in_blocks(x)
        on.controls[:] = whole_blocks(controls)
        on.forces[:] = in_blocks(state.force)
        changing = self.changing
        if changing is not None:
            on.numbers[:, self.own + changing.clock] = in_blocks(clock[:, None])[:, 0]
            if state.added is not None:
                on.numbers[:, self._added] = in_blocks(state.added)
        self.program(on, 0, controls.shape[1], self.each)
        if on.failed.any():
            on.failed[:] = 0.0
            return False
        for k, x in enumerate((state.q, state.v, state.begin)):
            x[:] = _rows(on.state[:, k * n : (k + 1) * n], rows)
        state.force[:] = _rows(on.forces, rows)
        if changing is not None and state.added is not None:
            state.added[:] = _rows(on.numbers[:, self._added], rows)
        return True

    @property
    def _added(self) -> slice:
        """Where what the integral parts add is."""
        assert self.changing is not None
        first = self.own + self.changing.added
        return slice(first, first + INTEGRAL * self.on.forces.shape[1], INTEGRAL)


def whole_blocks(x: np.ndarray) -> np.ndarray:
    """(B, ...) with the last row repeated, for whole blocks of rows."""
    missing = -len(x) % LANES
    return np.concatenate([x, np.repeat(x[-1:], missing, axis=0)]) if missing else x


def in_blocks(x: np.ndarray) -> np.ndarray:
    """(B, k) -> (blocks, k, LANES)"""
    whole = whole_blocks(x)
    return np.ascontiguousarray(whole.reshape(len(whole) // LANES, LANES, x.shape[1]).transpose(0, 2, 1))


def _rows(x: np.ndarray, rows: int) -> np.ndarray:
    """(blocks, k, LANES) -> (B, k)"""
    return np.asarray(x.transpose(0, 2, 1).reshape(-1, x.shape[1])[:rows])
