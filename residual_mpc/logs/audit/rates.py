"""Velocities against the positions they are the rates of, and sensors slower than their log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.follow import Follow, align, clipped_deviations, follow, on_grid, position_on_grid
from residual_mpc.logs.columns import group, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import fresh_samples, noise_sigma

REACH = 0.3  # s
SHORT = 0.1  # s: a shift that a sensor or its filter may well have
SURE = 0.9
OFF = 0.15  # deviation of a slope from one that is worth a word
DEGREES = 180.0 / np.pi
STEPS = 1.5  # samples of the slower sensor: a smaller shift may come from how differences are centred
GAIN = 1.5  # times less that a shift leaves unexplained, from which it is one
SLOWER = 0.7  # share of fresh samples below which a sensor is slower than its log


def check_rates(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Each logged velocity against its differentiated position; the true rate of each sensor."""
    dt = float(np.median([run.period for run in runs]))
    findings: list[Finding] = []
    names = dict.fromkeys(name for run in runs for name in run.measured if name in robot.channels)
    for name in names:
        findings += _slow_sensor(name, [run for run in runs if name in run.measured])
        if group(name) in ("velocity", "twist"):
            rate_of = f"{'position' if group(name) == 'velocity' else 'pose'}.{member(name)}"
            both = [r for r in runs if name in r.measured and rate_of in r.measured]
            findings += _rate(name, rate_of, both, dt) if both else []
    return findings


def _rate(name: str, rate_of: str, runs: Sequence[Run], dt: float) -> list[Finding]:
    moving = [run for run in runs if np.nanstd(run.columns[name]) > 3.0 * noise_sigma(run.t, run.columns[name])]
    if not moving:
        return []
    # both through the same filter, so that differentiated rounding does not drown the motion
    rates = clipped_deviations(
        [_smooth(np.gradient(position_on_grid(run, rate_of, dt), dt)) for run in moving], each=False
    )
    velocities = clipped_deviations([_smooth(on_grid(run, run.columns[name], dt)) for run in moving], each=False)
    seen = follow(rates, velocities, dt, REACH)
    if seen is None:
        return []
    k = _likeliest(seen)
    strength, slope = float(seen.correlation[k]), float(seen.slope[k])
    if abs(strength) < SURE:
        return []
    if strength < 0.0:
        return [
            Finding(
                "error",
                "sign",
                "",
                name,
                None,
                f"{name} has the opposite sign to the derivative of {rate_of}",
                f"multiply {name} by -1",
            )
        ]
    for column, factor in ((name, slope / DEGREES), (rate_of, 1.0 / (slope * DEGREES))):
        if 0.8 < factor < 1.25:
            return [
                Finding(
                    "error",
                    "degrees",
                    "",
                    column,
                    None,
                    f"{name} is {slope:.4g} times the derivative of {rate_of}: {column} is in degrees",
                    f"multiply {column} by pi / 180",
                )
            ]
    findings = []
    if abs(slope - 1.0) > OFF:
        findings.append(
            Finding(
                "warning",
                "velocity scale",
                "",
                name,
                None,
                f"{name} is {slope:.3g} times the derivative of {rate_of} (correlation {strength:.2f})",
                "check the units of both, and the gear ratio between their sensors",
            )
        )
    coarsest = max(_fresh_period(run, column) for run in moving for column in (name, rate_of))
    return findings + _out_of_step(name, rate_of, rates, velocities, dt, STEPS * max(dt, coarsest))


def _likeliest(seen: Follow) -> int:
    """The index of the shift at which a velocity is most like a rate, or its negative: a short one if it will do, since
    a gait is like its negative half a period later."""
    size = np.abs(seen.correlation)
    short = np.where(np.abs(seen.lags) <= SHORT, size, 0.0)
    return int(np.argmax(short if short.max() >= SURE else size))


def _out_of_step(
    name: str, rate_of: str, rates: Sequence[FloatArray], velocities: Sequence[FloatArray], dt: float, least: float
) -> list[Finding]:
    """A shift of more than `least` s that explains clearly more of the velocities than no shift does."""
    seen = align(rates, velocities, dt, REACH)
    if seen is None or seen.lag is None or abs(seen.lag) <= least or seen.gain < GAIN:
        return []
    word = "behind" if seen.lag > 0.0 else "ahead of"
    message = f"{name} is {abs(seen.lag) * 1e3:.0f} ms {word} the derivative of {rate_of}"
    remedy = "this may be a filter in the sensor, or two unsynchronised clocks"
    return [Finding("info", "channels out of step", "", name, None, message, remedy)]


def _fresh_period(run: Run, name: str) -> float:
    """The mean time between new values of a channel, s."""
    return float(run.t[-1] - run.t[0]) / max(1, int(fresh_samples(run.columns[name]).sum()) - 1)


def _smooth(x: np.ndarray) -> np.ndarray:
    return np.convolve(x, np.ones(5) / 5.0, mode="same")


def _slow_sensor(name: str, runs: Sequence[Run]) -> list[Finding]:
    fresh = sum(int(fresh_samples(run.columns[name]).sum()) for run in runs)
    present = sum(int(np.isfinite(run.columns[name]).sum()) for run in runs)
    total = sum(len(run.sampled) for run in runs)
    if fresh > SLOWER * total:
        return []
    rate = 1.0 / float(np.median([run.period for run in runs]))
    how = "is missing" if fresh > SLOWER * present else "repeats its value"
    message = f"{name} updates at about {rate * fresh / total:.3g} Hz and {how} in between; the log has {rate:.3g} Hz"
    remedy = "" if how == "is missing" else "fits of positions leave the repeats out"
    return [Finding("info", "slow sensor", "", name, None, message, remedy)]
