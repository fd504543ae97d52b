"""What drives the joints of a model that does not say, such as a URDF: the kind of command, and the gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, JointDrive, Roles
from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.signals import SignalMatch
from residual_mpc.init.columns.words import Quantity
from residual_mpc.logs.run import FloatArray
from residual_mpc.models.actuators import Actuator

MOST = 1200  # samples that the gains are fitted to
SMOOTH = 0.12  # s of the polynomial that velocities and accelerations are taken from
DELAYS = np.arange(0.0, 0.161, 0.02)  # s that a command may be late
EXPLAINED = 0.6  # share of the torque from which a fitted gain counts
SERVO_LAG = 0.5, 0.02  # share of the observed lag that is a servo's damping, the rest being delay; and s at least
STOPS_SHORT = 0.05  # rad or m: where nothing can be fitted, a servo that gives the joint's largest effort there
STIFF = 0.005  # rad or m: the same with the largest torque of the motion, which is less
NEAR_ONE = 0.5  # of a gear's logarithm: nearer to 1 N m per unit, it is taken to be that


@dataclass(frozen=True)
class Gains:
    """The actuators of the robot file by joint, and how they were guessed."""

    actuators: Mapping[str, Actuator]
    guesses: tuple[Guess, ...]


def find_kinds(case: ColumnEvidence, roles: Roles) -> tuple[dict[str, Quantity], tuple[Guess, ...]]:
    """By actuator that has a command: what the command is, "position", "velocity" or "effort"."""
    kinds: dict[str, Quantity] = {}
    guesses = []
    commands = roles.of("command")
    for d in case.driven:
        if d.name not in commands:
            continue
        if d.kind is not None:
            kinds[d.name] = d.kind
            continue
        kind, why, sure = _kind(case, roles, commands[d.name], d)
        kinds[d.name] = kind
        guesses.append(Guess(f"actuator.{d.name}.kind", _word(kind), why, sure))
    return kinds, tuple(guesses)


def _word(kind: Quantity) -> str:
    return "motor" if kind == "effort" else str(kind)


def _kind(case: ColumnEvidence, roles: Roles, column: str, driven: JointDrive) -> tuple[Quantity, str, float]:
    odds: dict[Quantity, float] = {"position": 0.5, "velocity": 0.0, "effort": 0.0}
    words = case.words[column]
    reasons: dict[Quantity, list[str]] = {kind: [] for kind in odds}
    if words.quantity in odds:
        odds[words.quantity] += 4.0
        reasons[words.quantity].append(f"the name {column} says so")
    position, velocity = (roles.of(g).get(driven.joint) for g in ("position", "velocity"))
    s = case.signals
    seen: list[tuple[Quantity, str, SignalMatch]] = []
    if position and position != column:
        seen.append(("position", position, s.follows(column, position)))
        rate = s.follows(column, position, answer_rate=True, levels=True)
        seen.append(("velocity", f"the derivative of {position}", rate))
    if velocity and velocity != column:
        seen.append(("velocity", velocity, s.follows(column, velocity, levels=True)))
    best: dict[Quantity, float] = {}
    for kind, name, of in seen:
        # an answer comes after its command, and the sooner the likelier: a swing is like its own rate, later
        worth = 6.0 * of.correlation**2 - 3.0 * max(0.0, of.lag) if of.lag > -2.0 * s.dt else 0.0
        if worth > best.get(kind, 1.0):
            best[kind] = worth
            reasons[kind].append(f"{name} {of.words(column)}")
    for kind, worth in best.items():
        odds[kind] += worth
    if best and max(best.values()) < 3.0 or not best:
        odds["effort"] += 1.5
        reasons["effort"].append(f"neither the position nor the velocity follows {column} closely")
    kind = max(odds, key=lambda k: odds[k])
    sure = 1.0 / sum(exp(o - odds[kind]) for o in odds.values())
    return kind, ", ".join(reasons[kind]) or "the most common kind", round(min(0.99, sure), 2)


def find_gains(
    case: ColumnEvidence,
    places: Mapping[str, FloatArray],
    sent: Mapping[str, FloatArray],
    kinds: Mapping[str, Quantity],
) -> Gains:
    """Gains by least squares on the model's inverse dynamics, the command a little late, with friction and a rotor's
    inertia beside them.

    places: by joint, (n,) rad or m on the grid, NaN where missing. sent: by actuator, (n,), in its unit.
    """
    actuators: dict[str, Actuator] = {}
    guesses: list[Guess] = []
    motion = motion_of(case, places)
    for d in case.driven:
        if d.name not in kinds:
            continue
        joint = next(j for j in case.structure.joints if j.name == d.joint)
        fit = None
        if motion is not None and d.joint in places:
            fit = fit_gain(case, motion, d, sent[d.name], kinds[d.name])
        lag = _lag(case, places.get(d.joint), sent[d.name]) if kinds[d.name] == "position" else 0.0
        own = 0.0 if motion is None else float(np.abs(motion.torque[:, case.structure.joints.index(joint)]).max())
        actuator, guess = _actuator(d, joint.slides, joint.effort, kinds[d.name], fit, own, lag)
        actuators[d.joint] = actuator
        guesses += guess
    return Gains(actuators, tuple(guesses))


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Samples of a motion: rows (m,) of the grid; q, v, torque (m, joints) with what the model needs for it."""

    rows: np.ndarray
    q: FloatArray
    v: FloatArray
    a: FloatArray
    torque: FloatArray


@dataclass(frozen=True)
class GainFit:
    """gain: on what the command asks beyond what is there. damping: kv of a position servo. explained: share of the
    torque's variance."""

    gain: float
    damping: float
    explained: float


def motion_of(case: ColumnEvidence, places: Mapping[str, FloatArray]) -> JointMotion | None:
    """The motion of the joints that are measured, the others at 0; None where the model has no torques for it.

    places: by joint, (n,) rad or m on the grid.
    """
    if case.structure.torque is None or not places:
        return None
    zero = np.zeros(len(case.signals.run))
    states = [
        np.stack([_smooth(case, places.get(j.name, zero), order) for j in case.structure.joints], axis=1)
        for order in range(3)
    ]
    rows = np.flatnonzero(np.all([np.isfinite(x).all(axis=1) for x in states], axis=0))
    if len(rows) < 50:
        return None
    rows = rows[np.linspace(0, len(rows) - 1, min(MOST, len(rows))).astype(int)]
    q, v, a = (x[rows] for x in states)
    return JointMotion(rows, q, v, a, case.structure.torque(q, v, a))


def _smooth(case: ColumnEvidence, x: FloatArray, order: int) -> FloatArray:
    """(n,) a signal or its derivative of an order, from local polynomials."""
    from scipy.signal import savgol_filter

    width = max(5, round(SMOOTH / case.signals.dt) | 1)
    return np.asarray(savgol_filter(x, width, 3, deriv=order, delta=case.signals.dt, mode="nearest"))


def fit_gain(
    case: ColumnEvidence, motion: JointMotion, driven: JointDrive, sent: FloatArray, kind: Quantity
) -> GainFit | None:
    """Gain and damping by least squares, with friction and a rotor beside them, all not negative.

    sent: (n,) on the grid.
    """
    from scipy.optimize import nnls

    k = [j.name for j in case.structure.joints].index(driven.joint)
    q, v, a, torque = motion.q[:, k], motion.v[:, k], motion.a[:, k], motion.torque[:, k]
    power = float(torque @ torque)
    if power <= 0.0:
        return None
    fastest = float(np.quantile(np.abs(v), 0.95)) or 1.0
    sent = _smooth(case, sent, 0)  # as the motion, so that steps are as blunt here as there
    own = [-np.tanh(v / (0.02 * fastest)), -a]  # dry friction, and the inertia of a rotor
    best: GainFit | None = None
    for delay in DELAYS if kind != "effort" else DELAYS[:1]:
        rows = np.maximum(motion.rows - round(delay / case.signals.dt), 0)
        u = sent[rows]
        there = np.isfinite(u) & (case.signals.run[rows] == case.signals.run[motion.rows])
        asked = {"position": [u - q, -v], "velocity": [u - v], "effort": [u]}[str(kind)]
        x = np.stack([*asked, *own], axis=1)[there]
        if len(x) < 50 or not np.abs(x[:, 0]).max() > 0.0:
            continue
        scale = np.sqrt((x * x).mean(axis=0)) + 1e-300
        theta, error = nnls(x / scale, torque[there])
        theta = theta / scale
        explained = 1.0 - error**2 / float(torque[there] @ torque[there])
        if best is None or explained > best.explained + 0.005:
            best = GainFit(float(theta[0]), float(theta[1]) if kind == "position" else 0.0, explained)
    return best


def _actuator(
    driven: JointDrive,
    slides: bool,
    effort: float | None,
    kind: Quantity,
    fit: GainFit | None,
    own: float,
    lag: float,
) -> tuple[Actuator, Sequence[Guess]]:
    where = f"actuator.{driven.name}"
    unit = "N/m" if slides else "N m/rad"
    good = fit is not None and fit.gain > 0.0 and fit.explained > EXPLAINED
    said = (
        f"least-squares fit to the model's torques, {max(0.0, fit.explained):.0%} of whose square it explains"
        if fit
        else ""
    )
    sure = round(min(0.8, 0.2 + 0.6 * fit.explained), 2) if fit is not None and good else 0.1
    if kind == "effort":
        if fit is None or not good or abs(log(fit.gain)) < NEAR_ONE:
            why = "a command of 1 is assumed to be 1 N m" + (f"; {said}, gives {fit.gain:.3g}" if fit and good else "")
            return Actuator("motor"), [Guess(f"{where}.gear", "1", why, 0.8 if good else 0.3)]
        gear = _round(fit.gain)
        return Actuator("motor", gear=gear), [Guess(f"{where}.gear", f"{gear:g}", f"N m per unit: {said}", sure)]
    name = "kp" if kind == "position" else "kv"
    if kind == "velocity":
        unit = "N s/m" if slides else "N m s/rad"
    if fit is None or not good:
        offset = STIFF if own > 0.0 else STOPS_SHORT
        largest = own or effort or 1.0
        gain = _round(largest / offset)
        why = f"no fit possible; chosen to give {largest:.3g} {'N' if slides else 'N m'} at an offset of {offset:g}"
        guesses = [Guess(f"{where}.{name}", f"{gain:g} {unit}", why, 0.1)]
        if kind == "velocity":
            return Actuator("velocity", kv=gain), guesses
        damping = _round(gain * max(SERVO_LAG[0] * lag, SERVO_LAG[1]))
        why = f"a position servo without damping would oscillate; chosen for a lag of {damping / gain:.2g} s"
        guesses.append(Guess(f"{where}.kv", f"{damping:g} {'N s/m' if slides else 'N m s/rad'}", why, 0.1))
        return Actuator("position", kp=gain, kv=damping), guesses
    gain, damping = _round(fit.gain), _round(fit.damping)
    guesses = [Guess(f"{where}.{name}", f"{gain:g} {unit}", said, sure)]
    if kind == "velocity":
        return Actuator("velocity", kv=gain), guesses
    if damping > 0.0:
        rate = "N s/m" if slides else "N m s/rad"
        guesses.append(Guess(f"{where}.kv", f"{damping:g} {rate}", said, round(sure / 2, 2)))
    return Actuator("position", kp=gain, kv=damping), guesses


def _lag(case: ColumnEvidence, place: FloatArray | None, sent: FloatArray) -> float:
    """s by which the position follows its command: the delay at which the two differ least."""
    if place is None:
        return 0.0
    run, best = case.signals.run, (np.inf, 0.0)
    for delay in np.arange(0.0, 0.3, max(case.signals.dt, 0.01)):
        k = round(delay / case.signals.dt)
        apart = place[k:] - sent[: len(sent) - k]
        apart = apart[(run[k:] == run[: len(run) - k]) & np.isfinite(apart)]
        if len(apart):
            best = min(best, (float(np.var(apart)), float(delay)))
    return best[1]


def _round(x: float) -> float:
    """To three digits."""
    return float(f"{x:.3g}")
