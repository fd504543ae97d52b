"""The servo in truth, drawn anew for every seed, and what it is made to do: simulated apart from MuJoCo.

A leapfrog at 0.1 ms with set-valued Coulomb friction (Moreau's time stepping: within a step the friction
stops the joint or acts in full); the models replay with MuJoCo's integrators and its soft friction.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sin

import numpy as np

GRAVITY = 9.81  # m/s^2
STEP = 1e-4  # s, of the truth
PERIOD = 0.01  # s, of the log
DURATION = 8.0  # s, of a run
NOISE = 5e-4  # rad, 1 sigma of the encoder
KP = 30.0  # N m/rad, known to everyone
LINK_MASS, LINK_COM, LINK_INERTIA = 0.2, 0.1, 7e-4  # kg, m, kg m^2 about the centre of mass; known to everyone
TOOL = 0.2  # m from the joint: where a payload sits
MOTIONS = ("chirp", "multisine", "steps", "slow_sine")  # what both tools are given
FRESH = ("multisine", "steps")  # what neither has seen


@dataclass(frozen=True)
class Servo:
    """armature kg m^2, damping N m s/rad, friction N m: what both tools may retune. delay s, payload kg: hidden."""

    armature: float = 0.03
    damping: float = 0.6
    friction: float = 0.05
    delay: float = 0.0
    payload: float = 0.0


TUNED = ("armature", "damping", "friction")
SPREAD = {"armature": 1.5, "damping": 1.5, "friction": 2.0}  # a drawn servo lies within this factor, either way
CASES: Mapping[str, Servo] = {  # the middle of what is drawn
    "nothing": Servo(),
    "delay": Servo(delay=0.010),
    "payload": Servo(payload=0.15),
    "step": Servo(),  # nothing is hidden, but the model takes coarse steps
}


@dataclass(frozen=True)
class Log:
    """One run: t (N,) s, command (N,) rad held until the next, position (N,) rad as the encoder gives it."""

    name: str
    t: np.ndarray
    command: np.ndarray
    position: np.ndarray


def record(servo: Servo, motion: str, name: str, rng: np.random.Generator) -> Log:
    """A run from rest at the lower standstill."""
    t = np.arange(round(DURATION / PERIOD)) * PERIOD
    u = command(motion, t, rng)
    return Log(name, t, u, simulate(servo, t, u) + NOISE * rng.standard_normal(len(t)))


def command(motion: str, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions (N,) rad that begin at 0. Raises ValueError for a motion that nobody named."""
    if motion == "chirp":
        low, high = 0.2, 4.0  # Hz
        return np.asarray(0.4 * np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * DURATION))))
    if motion == "multisine":
        phases = rng.uniform(0.0, 2 * np.pi, 5)
        tones = np.array([0.3, 0.7, 1.1, 1.9, 2.7])  # Hz
        waves = np.sin(2 * np.pi * tones * t[:, None] + phases) - np.sin(phases)
        return np.asarray(0.15 * waves.sum(axis=1))
    if motion == "steps":
        held = 0.7  # s
        levels = np.concatenate(([0.0], rng.uniform(-0.6, 0.6, int(DURATION / held) + 1)))
        return np.asarray(levels[(t / held).astype(int)])
    if motion == "slow_sine":
        return np.asarray(0.6 * np.sin(2 * np.pi * 0.2 * t))
    raise ValueError(f"motion {motion!r} came, one of {', '.join(MOTIONS)} was wanted")


def simulate(servo: Servo, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Positions (N,) rad at the stamps t (N,) s, a whole number of steps apart."""
    inertia = servo.armature + LINK_INERTIA + LINK_MASS * LINK_COM**2 + servo.payload * TOOL**2
    weight = GRAVITY * (LINK_MASS * LINK_COM + servo.payload * TOOL)  # N m, level
    every = round((t[1] - t[0]) / STEP)
    times = np.arange((len(t) - 1) * every) * STEP
    seen = np.searchsorted(t, times - servo.delay + 0.5 * STEP, side="right") - 1
    applied = np.where(seen < 0, 0.0, u[np.maximum(seen, 0)])  # before the run the servo stood at 0
    drag = 0.5 * STEP * servo.damping / inertia  # the midpoint rule in the damping keeps the second order
    stop = STEP * servo.friction / inertia / (1.0 + drag)  # rad/s that friction takes in a step
    q = w = 0.0
    out = [q]
    for k, target in enumerate(applied.tolist(), start=1):
        q += 0.5 * STEP * w
        free = (w * (1.0 - drag) + STEP * (KP * (target - q) - weight * sin(q)) / inertia) / (1.0 + drag)
        w = free - stop if free > stop else free + stop if free < -stop else 0.0
        q += 0.5 * STEP * w
        if k % every == 0:
            out.append(q)
    return np.array(out)


def draw(case: str, rng: np.random.Generator) -> Servo:
    """A servo with what the case hides; what may be retuned is drawn within SPREAD, even in the logarithm."""
    middle = CASES[case]
    values = {name: getattr(middle, name) * float(SPREAD[name] ** rng.uniform(-1.0, 1.0)) for name in TUNED}
    return replace(middle, **values)


def guess(servo: Servo, rng: np.random.Generator) -> Servo:
    """What both tools start from: nothing hidden, and the rest wrong by up to a factor of two either way."""
    factors = 2.0 ** rng.uniform(-1.0, 1.0, len(TUNED))
    wrong = {name: getattr(servo, name) * f for name, f in zip(TUNED, factors.tolist(), strict=True)}
    return replace(servo, delay=0.0, payload=0.0, **wrong)
