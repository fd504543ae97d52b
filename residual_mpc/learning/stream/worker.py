"""Updates in a process of their own beside a robot's loop: samples in, the newest weights out, and nobody waits.

    with Worker(learning, settings) as worker:       # `learning` from streaming.begin, on a few seconds of data
        while driving:
            worker.push(samples)                      # a copy into shared memory
            residual = worker.newest()                # a copy out of it

All is shared memory with one writer each and no lock, so that a process that dies leaves nothing held. Samples lie in
a ring; the worker takes the newest window and counts those that it had no time for. Belief and weights lie in two slots
that are written in turn, the number of the newest behind them: a worker that dies in the middle of a write costs one
update, and the next one begins from the last whole belief. The process is spawned: a program that starts a worker needs
its `if __name__ == "__main__":`.
"""

import os
import time
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from multiprocessing.sharedctypes import RawArray
from threading import Event, Thread
from types import TracebackType
from typing import Any

import numpy as np

from residual_mpc.learning.filter.kalman import Belief
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import Samples, initial_memory
from residual_mpc.learning.stream.settings import StreamSettings
from residual_mpc.learning.stream.updates import LearnerState, step

WINDOWS = 16  # that the ring holds
FRUITLESS = 5  # deaths in a row without an update, after which no other worker is begun
POLL = 0.002  # s that an idle worker sleeps
SPAWN = get_context("spawn")  # a fork would copy threads and locks of the robot's process in whatever state they are


@dataclass(frozen=True)
class Shared:
    """ring (rows * width) of t, z, model, reference; slots (2 * (1 + 1 + L + L * L)) of check sum, its update's number,
    mean and covariance; counts: samples pushed, newest slot, updates, windows dropped."""

    ring: Any
    slots: Any
    counts: Any
    rows: int


@dataclass(frozen=True)
class WorkerStatus:
    """updates made, windows that the worker had no time for, times that it was begun again, whether it runs now (False
    for good after FRUITLESS deaths in a row: something else is wrong)."""

    updates: int
    dropped: int
    restarts: int
    alive: bool


class Worker:
    """A leaf that owns the process. All methods return at once."""

    def __init__(self, learning: LearnerState, settings: StreamSettings, nice: int = 5, seed: int = 0) -> None:
        """nice: how much the loop goes before the worker where they share a core."""
        net = learning.residual.net
        width = 1 + net.inputs + 2 * net.outputs
        rows = WINDOWS * settings.horizon
        length = 2 + net.size + net.size**2
        self._shared = Shared(RawArray("d", rows * width), RawArray("d", 2 * length), RawArray("q", 4), rows)
        self._learning, self._settings = learning, settings
        self._ring = _matrix(self._shared.ring, width)
        self._slots, self._counts = _matrix(self._shared.slots, length), _vector(self._shared.counts)
        _write(self._slots[0], 0, learning.belief)
        self._pushed = 0
        self._closing, self._restarts = Event(), 0
        self._arguments = (self._shared, replace(learning, past=()), settings, nice, seed)
        self._process = self._begun()
        self._watch = Thread(target=self._guard, daemon=True)
        self._watch.start()

    def push(self, samples: Samples) -> None:
        """New samples, after those that were pushed before."""
        for t, z, model, reference in zip(samples.t, samples.z, samples.model, samples.reference, strict=True):
            self._ring[self._pushed % self._shared.rows] = np.concatenate([[t], z, model, reference])
            self._pushed += 1
            self._counts[0] = self._pushed

    def newest(self) -> Residual:
        """The residual with the newest weights that are whole."""
        mean = _mean(self._slots, int(self._counts[1]), len(self._learning.belief.mean))
        return self._learning.residual if mean is None else self._learning.residual.with_theta(mean)

    @property
    def tally(self) -> WorkerStatus:
        return WorkerStatus(int(self._counts[2]), int(self._counts[3]), self._restarts, self._process.is_alive())

    @property
    def pid(self) -> int:
        """Of the process at work."""
        return int(self._process.pid or 0)

    def close(self) -> None:
        """End the worker; its weights stay."""
        self._closing.set()
        self._process.terminate()
        self._watch.join()

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _begun(self) -> Any:
        process = SPAWN.Process(target=_work, args=self._arguments, daemon=True)
        process.start()
        return process

    def _guard(self) -> None:
        """In a thread of its own: wait for the worker to die, and begin another."""
        fruitless, updates = 0, 0
        while fruitless < FRUITLESS:
            self._process.join()
            if self._closing.wait(0.05):
                self._process.join()
                return
            fruitless = fruitless + 1 if self.tally.updates == updates else 0
            updates = self.tally.updates
            self._restarts += 1
            self._process = self._begun()


def _work(shared: Shared, learning: LearnerState, settings: StreamSettings, nice: int, seed: int) -> None:
    """The process: take the newest window, update, write; until the parent is gone."""
    if hasattr(os, "nice"):
        os.nice(nice)
    from threadpoolctl import threadpool_limits

    size = len(learning.belief.mean)
    o, i = learning.residual.net.outputs, learning.residual.net.inputs
    ring = _matrix(shared.ring, 1 + i + 2 * o)
    slots, counts = _matrix(shared.slots, 2 + size + size**2), _vector(shared.counts)
    belief = _belief(slots, int(counts[1]), size)
    if belief is not None:
        learning = replace(learning, belief=belief, residual=learning.residual.with_theta(belief.mean))
    parent, rng = parent_process(), np.random.default_rng((seed, int(counts[2])))
    at, n = int(counts[0]), settings.new
    with threadpool_limits(1):
        while parent is None or parent.is_alive():
            ready = (int(counts[0]) - at) // n
            if not ready:
                time.sleep(POLL)
                continue
            first = at + (ready - 1) * n
            rows = ring[np.arange(first, first + n) % shared.rows]
            at = first + n
            counts[3] += ready - 1
            if int(counts[0]) - first > shared.rows:  # written over while it was read
                counts[3] += 1
                continue
            new = Samples(rows[:, 0], rows[:, 1 : 1 + i], rows[:, 1 + i : 1 + i + o], rows[:, 1 + i + o :],
                          learning.tail.step, learning.tail.fed_back)  # fmt: skip
            if ready > 1:  # what lies between is not known: begin the prediction anew
                learning = replace(learning, tail=learning.tail.take(slice(0, 0)), memory=initial_memory(new))
            learning, done = step(settings, learning, new, rng)
            if done.info is not None:
                slot = 1 - int(counts[1])
                _write(slots[slot], int(counts[2]) + 1, learning.belief)
                counts[1] = slot
                counts[2] += 1


def _matrix(raw: Any, width: int) -> np.ndarray:
    return np.frombuffer(raw, dtype=np.float64).reshape(-1, width)


def _vector(raw: Any) -> np.ndarray:
    return np.frombuffer(raw, dtype=np.int64)


def _write(slot: np.ndarray, number: int, belief: Belief) -> None:
    """The check sum is wrong until all is written."""
    slot[0] = np.nan
    size = len(belief.mean)
    slot[1], slot[2 : 2 + size], slot[2 + size :] = number, belief.mean, belief.covariance.reshape(-1)
    slot[0] = belief.mean.sum()


def _mean(slots: np.ndarray, newest: int, size: int) -> np.ndarray | None:
    """(L,) of the newest slot that is whole, else of the other one."""
    for slot in (slots[newest], slots[1 - newest]):
        mean = slot[2 : 2 + size].copy()
        if slot[0] == mean.sum():
            return mean
    return None


def _belief(slots: np.ndarray, newest: int, size: int) -> Belief | None:
    """For a worker that begins: nobody writes now."""
    for slot in (slots[newest], slots[1 - newest]):
        mean = slot[2 : 2 + size].copy()
        if slot[0] == mean.sum():
            return Belief(mean, slot[2 + size :].reshape(size, size).copy())
    return None
