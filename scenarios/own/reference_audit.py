"""Whether a reference is plausible: its units, and whether the robot can follow it, before any long computation."""

import numpy as np

from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.models import optional
from scenarios.own.demands import SLACK, fastest_wheel, joint_ranges
from scenarios.own.reference import Waypoints

TURN = 2.0 * np.pi  # rad
OUTSIDE = 0.1  # of a joint's range: a path that exceeds it by more is for another robot, or in other units
SPARSE, LONG, HOURS = 1.0, 600.0, 3600.0  # s: between stamps, and lengths of a path, beyond which t may be in ms
LOOK = 0.2  # s over which speeds are taken: in less, the noise of a recorded path outweighs its motion
FAST, IMPOSSIBLE = 5.0, 50.0  # m/s: few robots on two wheels exceed 3, and none reaches IMPOSSIBLE
SLOW_IN_MM = 20.0  # m/s, over most of a path: a slow robot's speed if x and y are in mm
SPINNING = 20.0  # rad/s, three turns a second
# shares of the motion along the heading, as in the audit of logs: below ALONG, the two contradict each other; above
# THEN with the heading in degrees, that is the reason
ALONG, THEN = 0.7, 0.9
FAR = 0.1  # m, below which a path has no direction of travel


def audit_reference(reference: Waypoints, model: Augmented, dt: float, limit: float | None = None) -> list[str]:
    """What is doubtful about a reference for the channels that the model tracks, one sentence each; dt: s between
    samples; limit: rad/s that a wheel may be commanded, None if not stated.

    Raises BadInput for an implausible reference: stamps in ms, joints far outside their ranges, angles in
    degrees, a path in mm.
    """
    doubts = [*_clock(reference, dt), *_joints(reference, model)]
    if hasattr(model.robot, "outputs_from") and not model.stepped.rates and "pose.theta" in reference.names:
        doubts += [*_heading(reference), *_speeds(reference, model, dt, limit)]
    return doubts


def wheel_limit(model: Augmented) -> float | None:
    """rad/s, the lowest wheel speed limit of the robot or of a parameter of its model; None without a limit."""
    limits = [max(-low, high) for low, high in optional.command_limits(model.robot).values()]
    limits += [n.value for n in model.stepped.numbers if n.effect in BY_NAME and BY_NAME[n.effect].place == "limit"]
    return min((x for x in limits if np.isfinite(x)), default=None)


def _clock(reference: Waypoints, dt: float) -> list[str]:
    """Stamps in units other than seconds. Raises BadInput if they are too far apart over too long a time."""
    apart, seconds = float(np.median(np.diff(reference.t))), reference.seconds
    if apart >= SPARSE and seconds > LONG:
        raise BadInput(
            f"t goes from 0 to {seconds:.6g} s in steps of {apart:.4g} s, {seconds / dt:.0f} samples of {dt:.3g} s: "
            "milliseconds?", reference.where,
            "give t in seconds; if the path does take that long, give waypoints less than 1 s apart",
        )  # fmt: skip
    if seconds > HOURS:
        return [f"it lasts {seconds / HOURS:.1f} h, {seconds / dt:.0f} samples of {dt:.3g} s for each controller"]
    return []


def _joints(reference: Waypoints, model: Augmented) -> list[str]:
    """Joints without a range that make several turns. Raises BadInput for a joint far outside its range."""
    ranges, sliding = joint_ranges(model), {f"position.{j}" for j in optional.sliding(model.robot)}
    doubts = []
    for name, values in zip(reference.names, reference.values.T, strict=True):
        if name not in model.stepped.poses or not name.startswith("position."):
            continue
        low, high = ranges.get(name, (-np.inf, np.inf))
        if max(low - values.min(), values.max() - high) > OUTSIDE * (high - low) > 0.0:
            raise _outside(reference, name, (low, high), name in sliding, ranges)
        farthest = float(np.abs(values).max())
        if name not in ranges and name not in sliding and farthest > 2.0 * TURN:
            doubts.append(f"{name} reaches {farthest:.4g} rad, {farthest / TURN:.2g} turns: it may be in degrees")
    return doubts


def _outside(
    reference: Waypoints, name: str, span: tuple[float, float], slides: bool, ranges: dict[str, tuple[float, float]]
) -> BadInput:
    """The error for a joint outside its range, and what its unit may be."""
    low, high = span
    values = reference.values[:, reference.names.index(name)]
    first = int(np.flatnonzero((values < low - SLACK) | (values > high + SLACK))[0])
    far, unit = float(values[np.abs(values - np.clip(values, low, high)).argmax()]), "m" if slides else "rad"
    said = (
        f"{name} is {values[first]:.4g} {unit} in {reference.row(first)} and reaches {far:.4g} {unit}, outside the "
        f"joint's range of {low:.4g} to {high:.4g} {unit}"
    )
    if slides and abs(far) > 10.0 * max(abs(low), abs(high)) and low <= 1e-3 * far <= high:
        return BadInput(f"{said}: millimetres?", reference.where, "give the positions of sliding joints in m")
    if not slides and abs(far) > TURN and _fit_in_degrees(reference, ranges):
        return BadInput(f"{said}: degrees?", reference.where, "give positions in rad")
    return BadInput(said, reference.where, "keep the path within the range, or correct the range in the robot's model")


def _fit_in_degrees(reference: Waypoints, ranges: dict[str, tuple[float, float]]) -> bool:
    """Whether every joint that turns stays within its range if the reference is in degrees."""
    columns = dict(zip(reference.names, np.radians(reference.values).T, strict=True))
    return all(
        low - SLACK <= columns[name].min() and columns[name].max() <= high + SLACK
        for name, (low, high) in ranges.items()
        if name in columns
    )


def _moving(reference: Waypoints) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(n,) s, (n, 3) pose in the middle and (n, 3) rate of steps of about `LOOK` s, and the step, s."""
    steps = max(5, round(reference.seconds / LOOK))
    t = np.linspace(0.0, reference.seconds, steps + 1)
    columns = [reference.names.index(f"pose.{axis}") for axis in ("x", "y", "theta")]
    path, h = reference.path(t)[:, columns], reference.seconds / steps
    return t[:-1], 0.5 * (path[1:] + path[:-1]), np.diff(path, axis=0) / h, h


def _heading(reference: Waypoints) -> list[str]:
    """A heading that is not the direction of travel, forwards or backwards. Raises BadInput for one in degrees."""
    _, at, rate, h = _moving(reference)
    speed = np.hypot(rate[:, 0], rate[:, 1])
    if h * speed.sum() < FAR:
        return []

    def along(heading: np.ndarray) -> float:
        forward = rate[:, 0] * np.cos(heading) + rate[:, 1] * np.sin(heading)
        return float(forward @ forward / (speed @ speed))

    share, in_degrees = along(at[:, 2]), along(np.radians(at[:, 2]))
    if share >= ALONG:
        return []
    said = f"only {share:.0%} of the path is along pose.theta, and two wheels cannot drive sideways"
    if in_degrees > THEN and np.abs(at[:, 2]).max() > TURN:
        raise BadInput(
            f"{said}; if pose.theta is in degrees, {in_degrees:.0%} is", reference.where, "give pose.theta in rad",
        )  # fmt: skip
    return [f"{said}: pose.theta should be the direction of travel (rad), or its opposite to drive backwards"]


def _speeds(reference: Waypoints, model: Augmented, dt: float, limit: float | None) -> list[str]:
    """Speeds that the robot can hardly reach. Raises BadInput if most of the path is impossible."""
    t, _, rate, _ = _moving(reference)
    speed, turn = np.hypot(rate[:, 0], rate[:, 1]), np.abs(rate[:, 2])
    usual, k = float(np.median(speed[speed > 0.0])) if speed.any() else 0.0, int(speed.argmax())
    wheel = fastest_wheel({"nominal": model}, reference, dt) or 0.0
    if usual > IMPOSSIBLE:
        raise BadInput(
            f"the path needs {usual:.3g} m/s, and wheel speeds up to {wheel:.0f} rad/s: millimetres?", reference.where,
            "give pose.x and pose.y in m",
        )  # fmt: skip
    doubts = []
    if speed[k] > FAST:
        unit = ": pose.x and pose.y may be in mm" if usual > SLOW_IN_MM else ""
        doubts.append(f"the path needs {speed[k]:.3g} m/s at {t[k]:.3g} s, and wheels of {wheel:.0f} rad/s{unit}")
    elif limit is not None and wheel > limit:
        doubts.append(f"the path needs wheel speeds of {wheel:.3g} rad/s, which are limited to {limit:.3g} rad/s")
    k = int(turn.argmax())
    if turn[k] > SPINNING:
        doubts.append(f"pose.theta turns at {turn[k]:.3g} rad/s at {t[k]:.3g} s: it may be in degrees")
    return doubts
