"""Commands against the joints they drive: units, signs, swapped columns, delays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import ActuatorFacts, RobotFacts
from residual_mpc.logs.audit.follow import (
    Follow,
    command_on_grid,
    enabled_on_grid,
    follow,
    on_grid,
    position_on_grid,
    tame,
)
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import noise_sigma

REACH = 0.5  # s: the latest answer that is looked for
DEGREES = 180.0 / np.pi
SURE, CLEAR, WEAK = 0.9, 0.7, 0.5  # correlations


def check_pairing(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """How each joint follows its own command, and whether it follows another's."""
    dt = float(np.median([run.period for run in runs]))
    pairs = [(a, name) for a in robot.actuators if (name := _answering(a, runs, robot)) is not None]
    answers = {a.name: _answers(a, name, runs, dt) for a, name in pairs}
    sources = {a.name: _sources(a, runs, dt) for a, _ in pairs}
    own = {a.name: follow(sources[a.name], answers[a.name], dt, REACH) for a, _ in pairs}
    findings, swapped = _swaps(pairs, sources, answers, own, dt)
    for actuator, name in pairs:
        seen = own[actuator.name]
        if seen is None or actuator.name in swapped:
            continue
        # a wrong unit or sign explains the rest, so that the first of these checks to speak is the last
        findings += (
            _units(actuator, name, seen) or _sign(actuator, name, seen) or _delay(actuator, name, seen, dt)
        )
    return findings


def _answering(actuator: ActuatorFacts, runs: Sequence[Run], robot: RobotFacts) -> str | None:
    """The measured column that ought to follow the actuator's command, None where none does."""
    kinds = {"position": ("position",), "velocity": ("velocity", "position"), "torque": ()}[actuator.kind]
    for kind in kinds:
        name = f"{kind}.{actuator.joint}"
        if name in robot.channels and any(name in r.measured and actuator.name in r.actuators for r in runs):
            return name
    return None


def _usable(actuator: ActuatorFacts, name: str, run: Run) -> bool:
    return name in run.measured and actuator.name in run.actuators


def _answers(actuator: ActuatorFacts, name: str, runs: Sequence[Run], dt: float) -> list[FloatArray]:
    signals = []
    for run in runs:
        on = enabled_on_grid(run, actuator.name, dt)
        if not _usable(actuator, name, run):
            signals.append(np.zeros(len(on)))
            continue
        moves = np.nanstd(run.columns[name]) > 3.0 * noise_sigma(run.t, run.columns[name])
        if name.startswith("velocity"):
            y = on_grid(run, run.columns[name], dt)
        else:
            y = position_on_grid(run, name, dt)
            y = np.gradient(y, dt) if actuator.kind == "velocity" else y
        signals.append(tame(y, on) if moves else np.zeros(len(on)))
    return signals


def _sources(actuator: ActuatorFacts, runs: Sequence[Run], dt: float) -> list[FloatArray]:
    signals = []
    for run in runs:
        on = enabled_on_grid(run, actuator.name, dt)
        driven = actuator.name in run.actuators
        signals.append(tame(command_on_grid(run, f"command.{actuator.name}", dt), on) if driven else 0.0 * on)
    return signals


def _swaps(
    pairs: Sequence[tuple[ActuatorFacts, str]], sources: dict[str, list[FloatArray]],
    answers: dict[str, list[FloatArray]], own: dict[str, Follow | None], dt: float,
) -> tuple[list[Finding], set[str]]:
    """Two joints of which each follows the other's command, and neither its own."""
    findings: list[Finding] = []
    swapped: set[str] = set()
    best = {name: seen.correlation.max() if seen else 1.0 for name, seen in own.items()}
    doubtful = [(a, name) for a, name in pairs if best[a.name] < WEAK]
    for k, (a, a_column) in enumerate(doubtful):
        for b, b_column in doubtful[k + 1 :]:
            crossed = ((a.name, b.name), (b.name, a.name))
            across = [follow(sources[x], answers[y], dt, REACH) for x, y in crossed]
            strength = min(f.correlation.max() if f else 0.0 for f in across)
            if a.kind != b.kind or strength < SURE:
                continue
            swapped |= {a.name, b.name}
            findings.append(Finding(
                "error" if strength > 0.98 and max(best[a.name], best[b.name]) < 0.3 else "warning",
                "swapped channels", "", a_column, None,
                f"{a_column} follows command.{b.name} and {b_column} follows command.{a.name} (correlation"
                f" {strength:.2f}), neither its own ({max(best[a.name], best[b.name]):.2f}): swapped columns",
                f'in [log] of the robot file: "{a_column}" = "{b_column}" and "{b_column}" = "{a_column}"',
            ))
    return findings, swapped


def _units(actuator: ActuatorFacts, name: str, seen: Follow) -> list[Finding]:
    """A ratio near 57.3 between an answer and its command: one of the two is in degrees."""
    k = int(np.argmax(np.abs(seen.correlation)))
    ratio = abs(float(seen.slope[k]))
    if abs(seen.correlation[k]) < SURE:
        return []
    for column, factor in ((name, ratio / DEGREES), (f"command.{actuator.name}", 1.0 / (ratio * DEGREES))):
        if 0.6 < factor < 1.6:
            return [Finding(
                "error", "degrees", "", column, None,
                f"{name} is {ratio:.4g} times command.{actuator.name}, which it follows closely"
                f" (correlation {abs(seen.correlation[k]):.2f}): {column} is in degrees",
                f"multiply {column} by pi / 180",
            )]
    return []


def _sign(actuator: ActuatorFacts, name: str, seen: Follow) -> list[Finding]:
    """An answer that follows the command's negative, at no delay the command itself."""
    after = seen.lags >= 0.0
    least, most = float(seen.correlation[after].min()), float(seen.correlation[after].max())
    if least > -CLEAR or most > WEAK:
        return []
    slope = float(seen.slope[after][int(np.argmin(seen.correlation[after]))])
    sure = least < -0.95 and -2.0 < slope < -0.5 and most < 0.3
    return [Finding(
        "error" if sure else "warning", "sign", "", name, None,
        f"{name} moves against command.{actuator.name} (correlation {least:.2f}): a sign is flipped",
        "write one of the two with the other sign, or turn the joint's axis in the model",
    )]


def _delay(actuator: ActuatorFacts, name: str, seen: Follow, dt: float) -> list[Finding]:
    k, lag = seen.best(), seen.lag
    if seen.correlation[k] < CLEAR or k in (0, len(seen.lags) - 1):
        return []
    if lag < -1.5 * dt and seen.correlation[k] > SURE:
        return [Finding(
            "warning", "answer before command", "", name, None,
            f"{name} moves {-lag * 1e3:.0f} ms before command.{actuator.name}",
            "check the two clocks, and that the command column is what was sent, not what was measured",
        )]
    if lag > 2.0 * dt:
        return [Finding(
            "info", "late answer", "", name, None,
            f"{name} follows command.{actuator.name} about {lag * 1e3:.0f} ms later"
            " (delay, lag and inertia together)",
        )]
    return []
