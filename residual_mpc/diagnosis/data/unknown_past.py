"""Runs whose log begins in mid-motion or under load: what was sent before still acts, and is unknown."""

import numpy as np

from residual_mpc.diagnosis.data.before_the_log import held_before
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.local_fit import REACH
from residual_mpc.diagnosis.data.settings import UnknownPastSettings
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.effects.library import BY_NAME
from residual_mpc.logs.signals import noise_sigma
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings

# where effects act whose memory the plant or the readings keep: integrals, springs, delays and low-passes
REMEMBERING = frozenset({"servo", "spring", "delay", "filter"})


def has_memory(settings: Settings) -> bool:
    """Whether what was sent or happened before a window acts in it, by any of these effects. If none has a memory, the
    start state is all that the past leaves."""
    return any(BY_NAME[name].remembers or BY_NAME[name].place in REMEMBERING for name in settings.effects)


def runs_with_unknown_past(data: Dataset, settings: UnknownPastSettings) -> np.ndarray:
    """(R,) bool: whether a run begins while the robot moves, or while motors give torques that no command tells. A
    robot that stands still holds the setpoints that it has reached. A robot may move if its sensor is too slow to tell
    whether it sets off from rest."""
    out = np.zeros(len(data.runs), dtype=bool)
    for block in data.blocks:
        mine = [int(i) for i in np.unique(data.run[block.where])]
        variants = None if block.drive.setting is None else _variants(data, block.where, block.drive.setting, mine)
        held = held_before(block.robot, [data.runs[i] for i in mine], mine, data.signals, variants)
        for i, before in zip(mine, held, strict=True):
            kinds = zip(block.robot.command_kinds, before, strict=True)
            out[i] = any(k == "torque" and x is None for k, x in kinds) or _moves(block.robot, i, data, settings)
    return out


def after_unknown_past(
    data: Dataset, free: np.ndarray, unknown: np.ndarray, settings: UnknownPastSettings
) -> np.ndarray:
    """(W,) bool: of the windows `free` (W,) those that begin long enough after the first stamp of their run, where
    unknown (R,) says that it matters; all of them where more than a small share would be lost."""
    early = soon_after_unknown_past(data, unknown, settings)
    few = early[free].mean() <= settings.most if free.any() else False
    return free & ~early if few else free


def soon_after_unknown_past(data: Dataset, unknown: np.ndarray, settings: UnknownPastSettings) -> np.ndarray:
    """(W,) bool: the windows that begin soon after the first stamp of a run with an unknown past; unknown (R,)."""
    begin = np.array([run.t[0] for run in data.runs])
    return unknown[data.run] & (data.start < begin[data.run] + settings.forgotten - 1e-6)


def _variants(data: Dataset, where: slice, setting: np.ndarray, mine: list[int]) -> list[int]:
    return [int(setting[data.run[where] == i][0]) for i in mine]


def _moves(robot: Robot, i: int, data: Dataset, settings: UnknownPastSettings) -> bool:
    """Whether any measured position changes at the first stamp, beyond its noise."""
    signals = (data.signals.get((i, s.position)) for s in robot.states)
    return any(_rises(s, float(data.runs[i].t[0]), settings) for s in signals if s is not None)


def _rises(signal: Signal, begin: float, settings: UnknownPastSettings) -> bool:
    """Whether the cubic through the first samples has a slope at the first stamp that noise does not explain: what sets
    off from rest has none. Too few samples do not tell that from motion; of a sensor so slow that the start state rests
    on at most two readings, the second has to differ from the first."""
    near = int(np.searchsorted(signal.t, begin + settings.seconds + 1e-9))
    t, y = signal.t[:near] - begin, signal.y[:near]
    if len(t) < settings.samples:
        few = np.searchsorted(signal.t, begin + REACH + 1e-9) <= 2 < len(signal.t)
        slow = few and float(np.median(np.diff(signal.t))) > REACH / 3.0  # and no dropout of a faster one
        step = abs(signal.y[1] - signal.y[0]) if slow else 0.0
        return bool(step > settings.certain * np.sqrt(2.0) * noise_sigma(signal.t, signal.y))
    if np.ptp(y) == 0.0:
        return False
    design = np.stack([t**n for n in range(4)], axis=-1)
    slope = np.linalg.pinv(design)[1]  # (n,) 1/s
    sigma = noise_sigma(signal.t, signal.y) * float(np.linalg.norm(slope))
    return bool(abs(slope @ y) > settings.certain * sigma)
