"""Changes of a robot on two wheels, and of what an actuator makes of its command."""

from __future__ import annotations

import numpy as np

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.clock import DRIVES
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target, factor, refuse
from residual_mpc.blind.recorded.log import FloatArray, Log
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.command import DEAD_ZONE
from residual_mpc.effects.contact import TRACK_WIDTH, WHEEL_RADIUS, WHEEL_RADIUS_MISMATCH

RIGHT = ("command.right", "velocity.right")


def _radius_targets(half: Half) -> tuple[Target, ...]:
    return _stated(half, WHEEL_RADIUS.name, "wheel_radius")


def _track_targets(half: Half) -> tuple[Target, ...]:
    return _stated(half, TRACK_WIDTH.name, "track_width")


def _stated(half: Half, effect: str, parameter: str) -> tuple[Target, ...]:
    if half.plant != DRIVES or any(parameter not in s.parameters for s in half.settings):
        raise refuse(effect, f"the robot file states no {parameter} of a {DRIVES}")
    return (None,)


def _radius(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"scale": factor(0.01, 0.25, strength, rng)}


def _track(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"scale": factor(0.02, 0.7, strength, rng)}


def _change_radius(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    return half.with_parameters(lambda p: {**p, "wheel_radius": p["wheel_radius"] / sizes["scale"]})


def _change_track(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    return half.with_parameters(lambda p: {**p, "track_width": p["track_width"] / sizes["scale"]})


def _mismatch_targets(half: Half) -> tuple[Target, ...]:
    if half.plant != DRIVES:
        raise refuse(WHEEL_RADIUS_MISMATCH.name, f"the plant is not {DRIVES}")
    if any("velocity.right" not in log.driving for log in half.logs):
        raise refuse(
            WHEEL_RADIUS_MISMATCH.name,
            "the right wheel's motor would have to answer at other speeds, with a limit of its own",
            "it needs runs in which the wheels' measured speeds drive the model",
        )
    return (None,)


def _mismatch(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"ratio": factor(0.005, 0.15, strength, rng)}


def _change_right(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def slower(log: Log) -> Log:
        return log.with_values([c for c in RIGHT if c in log.columns], lambda w: w / sizes["ratio"])

    return half.with_logs(slower)


def _gain_targets(half: Half) -> tuple[Target, ...]:
    if half.plant != DRIVES:
        raise refuse(ACTUATOR_GAIN.name, f"the plant is not {DRIVES}")
    if not half.actuators:
        raise refuse(ACTUATOR_GAIN.name, "no command was sent in them, measured columns drive the model")
    return (None, *half.actuators)


def _gain(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"gain": factor(0.015, 0.7, strength, rng)}


def _change_gain(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    sent = [f"command.{a}" for a in half.actuators if target in (None, a)]
    return half.with_logs(lambda log: log.with_values(sent, lambda u: u / sizes["gain"]))


def _zone(half: Half, actuator: str) -> float:
    """The least command that is not zero over all runs, if at least a twentieth of the commands are zero; else 0."""
    u = np.abs(np.concatenate([log.columns[f"command.{actuator}"].values for log in half.logs]))
    u = u[np.isfinite(u)]
    moving = u[u > 0]
    return float(moving.min()) if len(moving) and np.mean(u == 0.0) >= 0.05 else 0.0


def _zone_targets(half: Half) -> tuple[Target, ...]:
    if half.plant != DRIVES:
        raise refuse(DEAD_ZONE.name, "at a servo it acts on the error and not on the command; elsewhere it is unknown")
    # a zone under a hundredth of the commands' spread is within the noise of any controller
    found = tuple(a for a in half.actuators if _zone(half, a) > 0.01 * half.spread(f"command.{a}"))
    if not found:
        raise refuse(DEAD_ZONE.name, "commands lie within the added zone, and none of them rest at zero")
    return found


def _widen(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"width": _zone(half, str(target)) * (0.3 + 0.7 * strength)}


def _fill_zone(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def filled(u: FloatArray) -> FloatArray:
        resting = u == 0.0
        return np.where(resting, rng.uniform(-1.0, 1.0, len(u)) * sizes["width"], u)

    return half.with_logs(lambda log: log.with_values([f"command.{target}"], filled))


RADIUS = Kind(
    WHEEL_RADIUS.name, "model",
    "The model is given wheels that are smaller by the scale, so the same robot has wheels larger by it.",
    "wheels", _radius_targets, _radius, _change_radius, factor=True,
)  # fmt: skip
TRACK = Kind(
    TRACK_WIDTH.name, "model",
    "The model is given a track that is narrower by the scale, so the same robot has one wider by it.",
    "wheels", _track_targets, _track, _change_track, factor=True,
)  # fmt: skip
MISMATCH = Kind(
    WHEEL_RADIUS_MISMATCH.name, "log",
    "A right wheel larger by the ratio covers the logged ground at a speed smaller by it. The measured speeds drive "
    "the model, so no motor has to answer differently.",
    "wheels", _mismatch_targets, _mismatch, _change_right, factor=True,
)  # fmt: skip
WHEEL_GAIN = Kind(
    ACTUATOR_GAIN.name, "log",
    "The wheel answered the logged command. Where a command smaller by the gain stands in the log, the wheel gives the "
    "gain more for it, up to the same limit of speed.",
    "gain", _gain_targets, _gain, _change_gain, factor=True,
)  # fmt: skip
ZONE = Kind(
    DEAD_ZONE.name, "log",
    "The robot rests where its command is zero. With a command inside the zone in its place, the answer to it is the "
    "answer to zero; the commands beyond the zone keep theirs.",
    "zone", _zone_targets, _widen, _fill_zone,
)  # fmt: skip
