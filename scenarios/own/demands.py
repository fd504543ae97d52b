"""What a reference demands of a robot and its controllers, and what the robot cannot do on it."""

from collections.abc import Mapping

import numpy as np

from controllers.settings import MpcSettings
from residual_mpc.closed_loop.compare import Comparison
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.effects.library import BY_NAME
from residual_mpc.export.augmented import Augmented
from residual_mpc.models import optional
from residual_mpc.models.settings import TUNE
from scenarios.own.inverse import closest
from scenarios.own.reference import Waypoints

LOST = 0.5  # share of a channel's samples that are missing, above which the result says so
HELD = 0.05  # share of the samples in which a command is at its limit, above which the result says so
SEEN = 15  # samples of a command's effect that a horizon should hold
LEAST = 1e-3  # of a factor on the speed that is taken as it is
SLACK = 1e-3  # rad or m, by which a reference may leave a joint's range
POINTS, REACHED = 12, 0.003  # of a path of the tool that are tried; m, within which one counts as reached


def fastest_wheel(models: Mapping[str, Augmented], reference: Waypoints, dt: float) -> float | None:
    """rad/s, the fastest wheel that any of the models needs to follow the reference; None for a robot that does not
    drive. models: by controller, "nominal" among them."""
    nominal = models["nominal"]
    inverse = getattr(nominal.robot, "outputs_from", None)
    if inverse is None or nominal.stepped.rates:
        return None
    path = reference.path(np.arange(0.0, reference.seconds + 0.5 * dt, dt))
    names = nominal.stepped.tracked
    value = dict(zip(names, 0.5 * (path[1:] + path[:-1]).T, strict=True))
    rate = dict(zip(names, np.diff(path, axis=0).T / dt, strict=True))
    fastest = float(np.max(np.abs(list(inverse(value, rate).values())), initial=0.0))
    return fastest * max(_times_the_nominal(model) for model in models.values())


def _times_the_nominal(model: Augmented) -> float:
    """How many times as fast as the nominal model's a wheel may have to be commanded: each number that slows the robot
    or its turns counts in full, whichever wheel it is of."""
    times = 1.0
    for n in (n for n in model.stepped.numbers if n.effect != TUNE):
        effect, parameter = BY_NAME[n.effect], BY_NAME[n.effect].parameter(n.parameter)
        factor = effect.place in ("strength", "pair") and parameter.null == 1.0
        factor |= parameter.quantity in ("wheel radius", "right wheel radius")
        ratio = 1.0 / max(n.value, LEAST) if factor else n.value if parameter.quantity == "track width" else 1.0
        times *= max(ratio, 1.0)
    return times


def dead_steps(model: Augmented) -> int:
    """Samples until a command acts, of the actuator on which it takes longest."""
    at = model.stepped
    return max((sum(s.startswith(f"{COMMAND_DELAY.label}.{a}.") for s in at.states) for a in at.commands), default=0)


def notes_of(model: Augmented, reference: Waypoints, settings: MpcSettings, comparison: Comparison) -> list[str]:
    """What a reader of the errors has to know beside them: readings that are missing, commands at their limit, a
    reference beyond the joints' ranges, a horizon shorter than the dead time."""
    return [
        *_beyond(model, reference),
        *_out_of_reach(model, reference),
        *_late(model, settings),
        *_lost(comparison),
        *_held(settings, comparison),
    ]


def joint_ranges(model: Augmented) -> dict[str, tuple[float, float]]:
    """The range of each joint's position that has one, rad or m, by channel."""
    return {f"position.{joint}": span for joint, span in optional.limits(model.robot).items()}


def _beyond(model: Augmented, reference: Waypoints) -> list[str]:
    """Joints whose range the reference leaves."""
    ranges, out = joint_ranges(model), []
    for name, values in zip(reference.names, reference.values.T, strict=True):
        low, high = ranges.get(name, (-np.inf, np.inf))
        past = float(max(low - values.min(), values.max() - high))
        if past > SLACK:
            out.append(f"the reference leaves the range of {name} ({low:.3g} to {high:.3g}) by {past:.2g}")
    return out


def _out_of_reach(model: Augmented, reference: Waypoints) -> list[str]:
    """How far the tool stays away from the reference, where it cannot reach all of it."""
    at = model.stepped
    if not at.outputs:
        return []
    q, far = np.array(model.start()[: len(at.poses)]), 0.0
    for wanted in reference.path(np.linspace(0.0, reference.seconds, POINTS)):
        q, off = closest(model, wanted, q)
        far = max(far, off)
    return [f"the tool comes no closer than {1e3 * far:.0f} mm to parts of the reference"] if far > REACHED else []


def _late(model: Augmented, settings: MpcSettings) -> list[str]:
    """Commands of which a controller sees too little before its horizon ends."""
    dead, dt = dead_steps(model), 1e3 * model.stepped.dt
    beyond = settings.horizon - dead
    if not dead or beyond >= SEEN:
        return []
    reaches = f"reaches only {beyond * dt:.0f} ms beyond" if beyond > 0 else "ends before"
    return [
        f"the horizon ({settings.horizon * dt:.0f} ms) {reaches} the model's dead time ({dead * dt:.0f} ms): use a "
        "longer sample time or a longer horizon"
    ]


def _lost(comparison: Comparison) -> list[str]:
    """Channels of which most readings are missing."""
    lost: dict[str, float] = {}
    for episode in (e for es in comparison.episodes.values() for e in es):
        for channel, values in episode.measured.items():
            lost[channel] = max(lost.get(channel, 0.0), float(np.mean(np.isnan(values))))
    return [f"{c} is missing in {share:.0%} of the samples" for c, share in lost.items() if share > LOST]


def _held(settings: MpcSettings, comparison: Comparison) -> list[str]:
    """Controllers whose commands are often at their limit."""
    out = []
    for name, episodes in comparison.episodes.items():
        command = np.concatenate([e.command for e in episodes])
        low, high = settings.limits.box(command.shape[1])
        share = float(np.mean(((command <= low + 1e-9) | (command >= high - 1e-9)).any(axis=1)))
        if share > HELD:
            out.append(f"{name}: a command is at its limit in {share:.0%} of the samples")
    return out
