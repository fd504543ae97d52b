"""The angle of each wheel at the windows' starts, counted from where its radius is the largest.

No log says how a wheel stands when a run begins. What a wheel has turned since then follows from its encoder, else from
its command; where on that turn its radius is the largest follows from the readings around a window. A radius of
r (1 + a cos(q + s)) makes the way along the rim r (q + a sin(q + s)), so that the readings, less a parabola over a
couple of seconds, are regressed on the sine and the cosine of the angle q turned. A window's own readings are left out:
what is compared with the model's prediction must not have told where its ripple lies.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.settings import WheelAngleSettings
from residual_mpc.effects.contact import WHEEL_ECCENTRICITY
from residual_mpc.logs.run import Run, held
from residual_mpc.models import optional
from residual_mpc.models.protocol import Inverting, Robot

Samples = Mapping[str, tuple[np.ndarray, np.ndarray]]  # channel -> stamps (n,) s, values (n,)


@dataclass(frozen=True, eq=False)
class Regression:
    """Normal equations of C stretches of a run: from, to (C,) s; gram (C, 2, 2) and score (C, 2) of the ripple on the
    sine and the cosine of the angle turned."""

    begin: np.ndarray
    end: np.ndarray
    gram: np.ndarray
    score: np.ndarray


def has_round_wheels(robot: Robot) -> bool:
    """Whether the robot has wheels that may be out of round."""
    return isinstance(robot, Inverting) and bool(robot.slots(WHEEL_ECCENTRICITY.name))


def wheel_angles(
    robot: Robot, run: Run, starts: np.ndarray, horizon: float, samples: Samples, settings: WheelAngleSettings
) -> np.ndarray:
    """(W, nu) rad at starts (W,) s: what each wheel has turned since the run's start, and the angle of its largest
    radius then as the readings around the window show it."""
    assert isinstance(robot, Inverting)
    pose = {s.position: samples[s.position] for s in robot.states}
    t = min((t for t, _ in pose.values()), key=len)
    rims = _rims(robot, pose, t) if len(t) > settings.fewest else {}
    out = np.zeros((len(starts), len(robot.actuators)))
    for k, (a, joint) in enumerate(zip(robot.actuators, optional.actuator_joints(robot), strict=True)):
        at, turned = _turned(run, a, samples.get(f"velocity.{joint}"))
        out[:, k] = np.interp(starts, at, turned)
        if a in rims:
            angle = np.interp(t, at, turned)
            found = _regression(t, rims[a] - angle, angle, settings)
            out[:, k] += _largest(found, starts, horizon, settings)
    return out


def _turned(run: Run, actuator: str, encoder: tuple[np.ndarray, np.ndarray] | None) -> tuple[np.ndarray, np.ndarray]:
    """(stamps (n,) s, rad (n,) turned since the run's start), by the encoder where there is one, else as commanded."""
    if encoder is not None and len(encoder[0]) > 1:
        t, w = encoder
        steps = 0.5 * (w[1:] + w[:-1])
    else:
        t, w = run.t, np.nan_to_num(held(run, f"command.{actuator}"))
        steps = w[:-1]
    return t, np.concatenate([[0.0], np.cumsum(steps * np.diff(t))])


def _rims(robot: Inverting, pose: Samples, t: np.ndarray) -> dict[str, np.ndarray]:
    """Actuator -> (n,) rad by which the wheel must have turned to move the pose as it was read."""
    read = {c: np.interp(t, *signal) for c, signal in pose.items()}
    step = np.diff(t)
    middle = {c: 0.5 * (y[1:] + y[:-1]) for c, y in read.items()}
    rate = {c: np.diff(y) / step for c, y in read.items()}
    speeds = robot.outputs_from(middle, rate)  # type: ignore[arg-type]  # of arrays as of numbers
    return {a: np.concatenate([[0.0], np.cumsum(np.asarray(w) * step)]) for a, w in speeds.items()}


def _regression(t: np.ndarray, e: np.ndarray, angle: np.ndarray, settings: WheelAngleSettings) -> Regression:
    """The ripple e (n,) rad at stamps t (n,) s on the angle (n,), stretch by stretch, each weighed by what its fit
    leaves: one with an outlier says little."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1], settings.stretch))
    begin, end, grams, scores, left = [], [], [], [], []
    for a, b in zip(edges, [*edges[1:], len(t)], strict=True):
        if b - a < settings.fewest:
            continue
        s = (t[a:b] - t[a]) / settings.stretch
        smooth, _ = np.linalg.qr(np.stack([np.ones_like(s), s, s * s], axis=1))
        x = np.stack([np.sin(angle[a:b]), np.cos(angle[a:b]), e[a:b]], axis=1)
        x = x - smooth @ (smooth.T @ x)
        moments = x.T @ x
        rest = moments[2, 2] - moments[2, :2] @ np.linalg.lstsq(moments[:2, :2], moments[:2, 2], rcond=1e-6)[0]
        begin.append(t[a])
        end.append(t[b - 1])
        grams.append(moments[:2, :2])
        scores.append(moments[:2, 2])
        left.append(max(float(rest), 0.0) / (b - a - 3))
    if not left:
        return Regression(np.zeros(0), np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 2)))
    weight = 1.0 / np.maximum(np.array(left), np.median(left) + 1e-18)
    return Regression(
        np.array(begin), np.array(end), np.array(grams) * weight[:, None, None], np.array(scores) * weight[:, None]
    )


def _largest(found: Regression, starts: np.ndarray, horizon: float, settings: WheelAngleSettings) -> np.ndarray:
    """(W,) rad: the phase of the radius, from the stretches around each window."""
    if not len(found.begin):
        return np.zeros(len(starts))
    ends = starts + horizon
    away = np.maximum(found.begin[None, :] - ends[:, None], starts[:, None] - found.end[None, :])  # (W, C) s
    use = ((away > 0.0) & (away <= settings.reach)).astype(float)
    few = use.sum(axis=1) < settings.stretches
    use[few] = (np.abs(away[few]) <= settings.reach) | (away[few] <= 0.0)  # better told by its own than not at all
    gram = np.einsum("wc,cij->wij", use, found.gram)
    gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
    b = np.linalg.solve(gram, np.einsum("wc,ci->wi", use, found.score)[:, :, None])[:, :, 0]
    return np.asarray(np.arctan2(b[:, 1], b[:, 0]))
