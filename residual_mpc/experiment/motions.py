"""Motions that have parted effects before: for wheels, and for joints."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.experiment.drive_setup import DriveSetup

EASE = 0.5  # s of rest at both ends
FULL = 0.9  # of the reach
OFF_EVERY, OFF = 5.0, 0.8  # s


@dataclass(frozen=True)
class Motion:
    """t (n,) s; command (n, nu), actuator units; enabled (n, nu) of 0 or 1, None where no motor is switched off."""

    name: str
    t: np.ndarray
    command: np.ndarray
    enabled: np.ndarray | None = None


def motions(setup: DriveSetup, seconds: float, rng: np.random.Generator) -> tuple[Motion, ...]:
    """All motions for this robot, each `seconds` long."""
    t = setup.period * np.arange(round(seconds / setup.period) + 1)
    shapes = _wheels(t, rng) if setup.wheeled else _joints(t, len(setup.actuators), rng)
    calm = np.clip(np.minimum(t, t[-1] - t) / EASE - 0.2, 0.0, 1.0)[:, None]  # at rest at both ends
    made = [Motion(n, t, setup.home + FULL * setup.reach * s * calm) for n, s in shapes.items()]
    if setup.switches and not setup.wheeled:
        off = ((t % OFF_EVERY) > OFF_EVERY - OFF)[:, None] & (t[:, None] < t[-1] - EASE)
        noisy = next(m for m in made if m.name == "multisine")
        on = np.where(off, 0.0, 1.0) * np.ones(noisy.command.shape)
        made.append(Motion("multisine with motors off at times", t, noisy.command, on))
    return tuple(made)


def scaled(motion: Motion, setup: DriveSetup, factor: float) -> Motion:
    """The same motion, smaller about home."""
    return Motion(motion.name, motion.t, setup.home + factor * (motion.command - setup.home), motion.enabled)


def slowed(motion: Motion, most: np.ndarray) -> Motion:
    """The same motion with commands that change by at most `most` (nu,) per second, actuator units, and end where they
    did."""
    if not np.isfinite(most).any():
        return motion
    steps = np.diff(motion.t)[:, None] * most
    forth = _limited(motion.command, steps)
    return Motion(motion.name, motion.t, _limited(forth[::-1], steps[::-1], motion.command[-1])[::-1], motion.enabled)


def _limited(wanted: np.ndarray, steps: np.ndarray, begin: np.ndarray | None = None) -> np.ndarray:
    """What follows `wanted` (n, nu) by at most `steps` (n - 1, nu) from row to row; begin (nu,): in place of its first
    row."""
    out = wanted.copy()
    out[0] = out[0] if begin is None else begin
    for k in range(1, len(out)):
        out[k] = out[k - 1] + np.clip(wanted[k] - out[k - 1], -steps[k - 1], steps[k - 1])
    return out


def _wheels(t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """name -> (n, 2) in [-1, 1]: left, right."""
    way = _square(t, 5.0)
    quarter = np.abs((t % 10.0) - 5.0) < 0.5  # a turn between two headings
    straight = np.where(quarter[:, None], np.stack([-0.5 + 0 * t, 0.5 + 0 * t], 1), np.stack([way, way], 1))
    turn = _multisine(t, 1, rng)[:, 0]
    speed = _square(t, 6.0) * (0.6 + 0.4 * np.sin(0.9 * t))
    slow = np.sin(2 * np.pi * 0.1 * t)
    return {
        "spins to both sides": np.stack([-way, way], 1) * (0.5 + 0.5 * np.abs(np.sin(0.4 * t)))[:, None],
        "straight both ways at two headings": straight,
        "steps of both wheels": _steps(t, 2, rng),
        "multisines of both wheels": _multisine(t, 2, rng),
        "forward and reverse with multisine turning": _fit(np.stack([speed - turn, speed + turn], 1)),
        "arcs at varying speed": np.stack([0.5 + 0.5 * slow, 0.2 + 0.4 * slow], 1),
    }


def _joints(t: np.ndarray, n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """name -> (n, joints) in [-1, 1]."""
    apart = np.linspace(0.0, 1.0, n, endpoint=False)  # so that the joints do not move as one
    slow = np.sin(2 * np.pi * (0.08 * (1 + 0.3 * apart) * t[:, None] + 0.25 * apart))
    rate = 0.1 * (25.0 ** (t / t[-1]))  # Hz, 0.1 to 2.5
    phase = np.cumsum(rate) * (t[1] - t[0])
    chirp = np.sin(2 * np.pi * (phase[:, None] + 0.25 * apart)) * (0.3 / (0.3 + 0.2 * rate))[:, None]
    return {
        "slow sweeps": slow,
        "chirp": chirp,
        "steps": 0.8 * _steps(t, n, rng),
        "multisine": 0.7 * _multisine(t, n, rng),
        "held steps": 0.8 * _steps(t, n, rng, (2.5, 5.0)),
    }


def _square(t: np.ndarray, period: float) -> np.ndarray:
    """A square wave with ramps of 0.3 s."""
    return np.clip(np.sin(2 * np.pi * t / period) * period / (2 * np.pi * 0.3), -1.0, 1.0)


def _steps(
    t: np.ndarray, n: int, rng: np.random.Generator, hold: tuple[float, float] = (0.5, 1.8)
) -> np.ndarray:
    """(len(t), n): levels held for so many seconds, at least and at most, each in its own time."""
    out = np.empty((len(t), n))
    for k in range(n):
        edges = np.cumsum(rng.uniform(*hold, int(t[-1] / hold[0]) + 2))
        out[:, k] = rng.uniform(-1.0, 1.0, len(edges) + 1)[np.searchsorted(edges, t)]
    return out


def _multisine(t: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """(len(t), n): six sines from 0.1 to 3 Hz with random phases."""
    f = 0.1 * 30.0 ** np.linspace(0.0, 1.0, 6)
    size = 1.0 / (1.0 + f)
    phase = rng.uniform(0.0, 2 * np.pi, (n, len(f)))
    return _fit((size * np.sin(2 * np.pi * f * t[:, None, None] + phase)).sum(axis=-1))


def _fit(x: np.ndarray) -> np.ndarray:
    return x / max(float(np.abs(x).max()), 1e-9)
