"""Commands against the joints they drive: units, signs, swapped columns, delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.audit.facts import ActuatorFacts, CommandKind, RobotFacts
from residual_mpc.logs.audit.follow import (
    Follow,
    clipped_deviations,
    command_on_grid,
    enabled_on_grid,
    follow,
    on_grid,
    position_on_grid,
)
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import noise_sigma

REACH = 0.5  # s: the latest answer that is looked for
SOON = 0.15  # s: within which a joint answers where its kind is in doubt; later, a sine's speed looks like its angle
APART = 20.0  # ratio of an answer to its command, from which their units differ
DEGREES, RPM = 180.0 / np.pi, 30.0 / np.pi
SURE, CLEAR, MODERATE, WEAK, FAINT = 0.9, 0.7, 0.5, 0.5, 0.25  # correlations


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
            _kind(actuator, runs, robot, seen, dt)
            or _units(actuator, name, seen)
            or _sign(actuator, name, seen)
            or _delay(actuator, name, seen, dt)
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
        y = run.columns.get(name, np.full(len(run.t), np.nan))
        moves = _usable(actuator, name, run) and np.nanstd(y) > 3.0 * noise_sigma(run.t, y)
        if name.startswith("position"):
            y = position_on_grid(run, name, dt) if moves else on_grid(run, np.full(len(run.t), np.nan), dt)
            y = np.gradient(y, dt) if actuator.kind == "velocity" else y
        else:
            y = on_grid(run, y, dt)
        signals.append(y)
    return clipped_deviations(signals, _on(actuator, runs, dt), each=actuator.kind == "position")


def _sources(actuator: ActuatorFacts, runs: Sequence[Run], dt: float) -> list[FloatArray]:
    """The commands as the joint would follow them, whatever gear lies between."""
    column = f"command.{actuator.name}"
    signals = [
        command_on_grid(run, column, dt) if column in run.columns else on_grid(run, np.full(len(run.t), np.nan), dt)
        for run in runs
    ]
    at_joint = [x / actuator.gear for x in signals]
    return clipped_deviations(at_joint, _on(actuator, runs, dt), each=actuator.kind == "position")


def _on(actuator: ActuatorFacts, runs: Sequence[Run], dt: float) -> list[FloatArray]:
    return [enabled_on_grid(run, actuator.name, dt) for run in runs]


def _swaps(
    pairs: Sequence[tuple[ActuatorFacts, str]],
    sources: dict[str, list[FloatArray]],
    answers: dict[str, list[FloatArray]],
    own: dict[str, Follow | None],
    dt: float,
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
            neither = max(best[a.name], best[b.name])
            if a.kind != b.kind or strength < (SURE if neither > FAINT else MODERATE):
                continue
            swapped |= {a.name, b.name}
            findings.append(
                Finding(
                    "error" if strength > 0.98 and neither < FAINT else "warning",
                    "swapped channels",
                    "",
                    a_column,
                    None,
                    f"{a_column} follows command.{b.name} and {b_column} follows command.{a.name} (correlation"
                    f" {strength:.2f}), and neither follows its own ({neither:.2f}): the columns are swapped",
                    "swap their source columns under [log] in the robot file, or add "
                    f'"{a_column}" = "{b_column}" and "{b_column}" = "{a_column}" if it names none',
                )
            )
    return findings, swapped


def _kind(actuator: ActuatorFacts, runs: Sequence[Run], robot: RobotFacts, seen: Follow, dt: float) -> list[Finding]:
    """A joint whose speed follows the command of its position servo, or whose position that of its velocity drive."""
    other: CommandKind = "velocity" if actuator.kind == "position" else "position"
    meant = replace(actuator, kind=other)
    name = _answering(meant, runs, robot)
    as_it_is = float(np.abs(seen.correlation[np.abs(seen.lags) <= SOON]).max())
    if as_it_is >= WEAK or name is None:
        return []
    as_meant = follow(_sources(meant, runs, dt), _answers(meant, name, runs, dt), dt, REACH)
    if as_meant is None:
        return []
    strength = float(as_meant.correlation[(as_meant.lags >= -dt) & (as_meant.lags <= SOON)].max())
    if strength < SURE:
        return []
    command = f"command.{actuator.name}"
    follows, not_ = ("speed", "position") if other == "velocity" else ("position", "speed")
    message = (
        f"the {follows} of {actuator.joint} follows {command} (correlation {strength:.2f}), its {not_} does not "
        f"({as_it_is:.2f}), and the model drives it by a <{actuator.kind}> actuator"
    )
    remedy = f'make it a <{other}> actuator in the model file, or kind = "{other}" in the robot file'
    return [Finding("warning", "kind of drive", "", command, None, message, remedy)]


def _units(actuator: ActuatorFacts, name: str, seen: Follow) -> list[Finding]:
    """A ratio near 57.3 (degrees) or 9.55 (revolutions per minute) between an answer and its command."""
    k = int(np.argmax(np.abs(seen.correlation)))
    ratio, strength = abs(float(seen.slope[k])), abs(float(seen.correlation[k]))
    if strength < SURE:
        return []
    for column, factor in ((name, ratio), (f"command.{actuator.name}", 1.0 / ratio)):
        sent = f"command.{actuator.name}" if actuator.gear == 1.0 else f"command.{actuator.name} / {actuator.gear:g}"
        said = f"{name} is {ratio:.4g} times {sent} (correlation {strength:.2f})"
        if 0.6 < factor / DEGREES < 1.6:
            remedy = f"multiply {column} by pi / 180"
            return [Finding("error", "degrees", "", column, None, f"{said}: {column} appears to be in degrees", remedy)]
        if actuator.kind == "velocity" and 0.85 < factor / RPM < 1.15:
            what = f"{said}: {column} may be in revolutions per minute"
            return [Finding("warning", "rpm", "", column, None, what, f"multiply {column} by pi / 30")]
    if not 1.0 / APART < ratio < APART:
        what = f"{said}: their units differ"
        remedy = "write both in rad or rad/s (m or m/s); a count of an encoder is 2 pi / (counts of one turn) rad"
        return [Finding("warning", "unit", "", name, None, what, remedy)]
    return []


def _sign(actuator: ActuatorFacts, name: str, seen: Follow) -> list[Finding]:
    """An answer that follows the command's negative, at no delay the command itself."""
    after = seen.lags >= 0.0
    least, most = float(seen.correlation[after].min()), float(seen.correlation[after].max())
    against = least < -CLEAR and most < WEAK
    # speeds keep their sign at every shift, so that less will do
    if not against and not (actuator.kind == "velocity" and least < -0.4 and most < 0.0):
        return []
    slope = float(seen.slope[after][int(np.argmin(seen.correlation[after]))])
    sure = least < -0.95 and -2.0 < slope < -0.5 and most < 0.3
    return [
        Finding(
            "error" if sure else "warning",
            "sign",
            "",
            name,
            None,
            f"{name} moves opposite to command.{actuator.name} (correlation {least:.2f}): a sign is flipped",
            "flip the sign of one of the two, or reverse the joint's axis in the model",
        )
    ]


def _delay(actuator: ActuatorFacts, name: str, seen: Follow, dt: float) -> list[Finding]:
    k, lag = seen.best(), seen.lag
    if seen.correlation[k] < CLEAR or k in (0, len(seen.lags) - 1):
        return []
    if lag < -1.5 * dt and seen.correlation[k] > SURE:
        return [
            Finding(
                "warning",
                "answer before command",
                "",
                name,
                None,
                f"{name} moves {-lag * 1e3:.0f} ms before command.{actuator.name}",
                "check both clocks, and that the command column holds what was sent rather than what was measured",
            )
        ]
    if lag > 2.0 * dt:
        return [
            Finding(
                "info",
                "late answer",
                "",
                name,
                None,
                f"{name} lags command.{actuator.name} by about {lag * 1e3:.0f} ms ({_made_of(actuator)})",
            )
        ]
    return []


def _made_of(actuator: ActuatorFacts) -> str:
    """What the delay between a command and its response consists of, or should be compared with."""
    if actuator.lag is None:
        return "delay, lag and inertia combined"
    return f"the modelled servo alone lags by {actuator.lag * 1e3:.0f} ms in steady motion"
