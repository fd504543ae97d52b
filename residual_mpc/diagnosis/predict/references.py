"""Typical sizes on the runs at hand, in whose units effects are probed and bounded."""

from collections.abc import Collection, Mapping

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.effects.drive import TURN_LIMIT
from residual_mpc.errors import BadInput
from residual_mpc.models import optional
from residual_mpc.models.settings import Settings

HIGHEST, LOWEST = "highest", "lowest"  # position of a joint in the runs
GIVEN = "given"  # torque of a joint's actuators at what was measured
RUN = ("1/run", "")  # 1/s, one over the longest run
BETWEEN = ("between commands", "")  # s between logged commands that follow a smooth curve, 0 where they jump
SMOOTH = 0.5  # of the rows in which a command moves on, from which it may have been sent more often than it was logged
OVER = 0.05  # s, over which a joint's largest speed is measured
ENDS = (0.002, 0.998)  # quantiles: a stop is where a joint often ends, an outlier is beyond


def longest_run(data: Dataset) -> float:
    """s, of the runs."""
    return max(float(r.t[-1] - r.t[0]) for r in data.runs)


def turned_of(references: Mapping[tuple[str, str], float], joint: str) -> float:
    """rad through which a joint turns in the runs; 0 where it is not measured."""
    return references.get((HIGHEST, joint), 0.0) - references.get((LOWEST, joint), 0.0)


def middle_of(references: Mapping[tuple[str, str], float], joint: str) -> float:
    """rad, halfway between the ends of a joint's motion; 0 where it is not measured."""
    return 0.5 * (references.get((HIGHEST, joint), 0.0) + references.get((LOWEST, joint), 0.0))


def measure_references(data: Dataset) -> dict[tuple[str, str], float]:
    """Typical sizes on these runs: commands (a servo's position error), actuator outputs, torques and speeds of
    the joints.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for block in data.blocks:
        robot, n = block.robot, block.where.stop - block.where.start
        pick = np.unique(np.linspace(0, n - 1, min(n, 60)).astype(int)) + block.where.start
        few = data.take(np.isin(np.arange(data.count), pick))
        outputs = _nominal_outputs(few)
        joints, all_joints = optional.actuator_joints(robot), optional.joints(robot)
        drive = block.drive.command[:, block.drive.lead :]
        for k, a in enumerate(robot.actuators):
            u = np.abs(drive[..., k])
            if robot.command_kinds[k] == "position":
                u = _servo_error(few, a, joints[k])
            found.setdefault(("command", a), []).append(float(np.quantile(u, 0.98)))
            found.setdefault(("command/time", a), []).append(float(np.ptp(np.quantile(drive[..., k], (0.02, 0.98)))))
            found.setdefault(("output", a), []).append(float(np.max(np.abs(outputs[a]))))
        for base in robot.slots(TURN_LIMIT.name):
            left, right = (outputs[a] for a in robot.actuators)
            found.setdefault(("output", base), []).append(float(np.max(np.abs([left, right]))))
            found.setdefault(("turn", base), []).append(float(0.5 * np.max(np.abs(right - left))))
            sent_left, sent_right = drive[..., 0], drive[..., 1]
            for kind, sent in (("forward/time", sent_left + sent_right), ("turn/time", sent_right - sent_left)):
                found.setdefault((kind, base), []).append(float(0.5 * np.ptp(np.quantile(sent, (0.02, 0.98)))))
        rms = dict.fromkeys(all_joints, 0.0)
        for k, a in enumerate(robot.actuators):
            rms[joints[k]] = float(np.sqrt(np.mean(outputs[a] ** 2)))
        typical = float(np.median([x for x in rms.values() if x > 0] or [1.0]))
        for k, a in enumerate(robot.actuators):  # at the measured states from which the windows start
            found.setdefault((GIVEN, joints[k]), []).append(float(np.median(np.abs(outputs[a][:, 0]))))
        for j in all_joints:
            torque = rms[j] or typical
            speeds = [s.y for (_, c), s in data.signals.items() if c == f"velocity.{j}"]
            moves = [np.diff(s.y) / np.diff(s.t) for (_, c), s in data.signals.items() if c == f"position.{j}"]
            speed = float(np.sqrt(np.mean(np.concatenate(speeds or moves or [np.ones(1)]) ** 2)))
            found.setdefault(("torque", j), []).append(torque)
            found.setdefault(("torque/speed", j), []).append(torque / max(speed, 0.05))
            size, fastest = _motion(data, j)
            found.setdefault(("torque/motion", j), []).append(torque / max(size, 0.02))
            for k in (k for k, driven in enumerate(joints) if driven == j):
                found.setdefault(("speed", robot.actuators[k]), []).append(fastest)
    sizes = {key: max(float(np.max(v)), 1e-6) for key, v in found.items()}
    sizes[RUN] = 1.0 / max(longest_run(data), 1e-3)
    sizes[BETWEEN] = _between_commands(data)
    return sizes | ends_of(data)


def _between_commands(data: Dataset) -> float:
    """The time between logged commands, s, where these may be every so many of those that were sent: they change from
    most rows to the next while they move, as those of a trajectory do. 0 where they are held for longer."""
    spacings, changing = list[float](), list[float]()
    for run in data.runs:
        for name in (f"command.{a}" for a in run.actuators):
            good = np.isfinite(run.columns[name])
            t, u = run.t[good], run.columns[name][good]
            if len(t) < 3 or not np.ptp(u) > 0.0:
                continue
            moves = np.abs(np.diff(u)) > 1e-9 * np.ptp(u)
            again = moves[1:][moves[:-1]]  # whether it moves on, of the rows after it has moved
            spacings.append(float(np.median(np.diff(t))))
            changing.append(float(again.mean()) if len(again) else 0.0)
    return float(np.median(spacings)) if changing and np.median(changing) > SMOOTH else 0.0


def _motion(data: Dataset, joint: str) -> tuple[float, float]:
    """Root mean square of a joint's position about its mean, rad (m), and its largest speed (the 0.995 quantile over
    50 ms), rad/s (m/s); ones where it is not measured."""
    measured = [s for (_, c), s in data.signals.items() if c == f"position.{joint}" and len(s.t) > 2]
    if not measured:
        return 1.0, 1.0
    size = float(np.sqrt(np.mean([np.var(s.y) for s in measured])))
    rates = []
    for s in measured:
        t = np.arange(s.t[0], s.t[-1], OVER)
        rates.append(np.abs(np.diff(np.interp(t, s.t, s.y))) / OVER if len(t) > 1 else np.ones(1))
    return size, float(np.quantile(np.concatenate(rates), 0.995))


def ends_of(data: Dataset, runs: Collection[int] | None = None) -> dict[tuple[str, str], float]:
    """The highest and the lowest position of every measured joint, rad (m), in these runs (default: in all)."""
    found: dict[tuple[str, str], float] = {}
    for j in optional.joints(data.blocks[0].robot):
        measured = [
            s.y
            for (i, c), s in data.signals.items()
            if c == f"position.{j}" and len(s.y) and (runs is None or i in runs)
        ]
        if measured:
            low, high = np.quantile(np.concatenate(measured), ENDS)
            found |= {(HIGHEST, j): float(high), (LOWEST, j): float(low)}
    return found


def _nominal_outputs(data: Dataset) -> dict[str, np.ndarray]:
    """Actuator outputs of the nominal model on these windows: actuator -> (W, K + 1)."""
    from residual_mpc.diagnosis.predict.replay import start_states

    block = data.blocks[0]
    n = block.where.stop - block.where.start
    start = {k: v[0] for k, v in start_states(data, block, Settings(1)).items()}
    wanted = tuple(f"output.{a}" for a in block.robot.actuators)
    try:
        out = block.robot.replay(start, block.drive, Settings(n), wanted)
        return {a: np.nan_to_num(out[f"output.{a}"]) for a in block.robot.actuators}
    except KeyError as missing:
        if str(missing.args[0]) not in wanted:
            raise
        raise BadInput(
            f"the robot's `replay` must also give {', '.join(wanted)} where `wanted` names them, got no {missing}",
            block.robot.name,
            "return what each actuator puts out on the nodes of the grid, (B, K + 1): its force, torque or wheel speed",
        ) from missing


def _servo_error(data: Dataset, actuator: str, joint: str) -> np.ndarray:
    """|command - measured position| of a position servo at the samples; ones where the joint is not measured."""
    block = data.blocks[0]
    k = block.robot.actuators.index(actuator)
    channel = f"position.{joint}"
    if channel not in data.channels:
        return np.ones(1)
    t = np.nan_to_num(data.t[block.where])
    at = np.clip((t / block.drive.dt).astype(int), 0, block.drive.steps - 1)
    sent = np.take_along_axis(block.drive.command[:, block.drive.lead :, k], at, axis=1)
    error = np.abs(sent - data.y[block.where, :, data.channels.index(channel)])
    error = error[np.isfinite(error)]
    return error if len(error) else np.ones(1)
