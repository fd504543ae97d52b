"""Figures of one episode: how far off the path, at what effort, how well its model predicted."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.closed_loop.episode import Episode

MEAN_OVER = 10.0  # s, of the H2 norm's mean (contract, section 3)
CLOSE = 0.1  # share of the final value within which a mean has converged

TURNS = ("turn.x", "turn.y", "turn.z")  # how far a hand is turned: angles, not lengths


@dataclass(frozen=True)
class Figures:
    """tracking_rmse, tracking_max: m, of the position (of all poses where the robot has no plane). heading_rmse: rad,
    of the heading or a hand's turn, NaN without either. effort: RMS of the commands; violations: samples beyond a soft
    limit; failures: samples without a solution; late: samples whose controller took longer than they last. solve:
    (median, 99th percentile) ms. h2: mean H2 norm; h2_first, h2_last: over the first and the last 10 s;
    converged_after: s, None where it did not fall.
    """

    tracking_rmse: float
    tracking_max: float
    heading_rmse: float
    effort: float
    violations: int
    failures: int
    late: int
    solve: tuple[float, float]
    h2: float
    h2_first: float
    h2_last: float
    converged_after: float | None


def h2_norm(episode: Episode) -> np.ndarray:
    """(n - 1,) Euclidean norm of what happened minus what was predicted, over the pose rates, at each step.

    The paper's figure; not the norm of a system, which is infinite for anything that integrates.
    """
    off = (episode.happened - episode.predicted)[:-1]
    if set(TURNS) <= set(episode.poses):
        off = off[:, _places(episode)]
    return np.asarray(np.linalg.norm(off, axis=1))


def h2_over_time(episode: Episode) -> tuple[np.ndarray, np.ndarray]:
    """(m,) s and (m,): the mean of the H2 norm over the 10 s before (or as much as there is)."""
    values, dt = h2_norm(episode), float(episode.t[1] - episode.t[0])
    total = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - max(1, round(MEAN_OVER / dt)), 0)
    return episode.t[1:], (total[last] - total[first]) / (last - first)


def converged_after(t: np.ndarray, mean: np.ndarray) -> float | None:
    """s after which `mean` stays within 10 % of its final value; None where it did not fall."""
    span = min(len(mean), int(np.searchsorted(t, MEAN_OVER)) + 1)
    start = mean[span - 1]  # the mean over the first 10 s
    if not mean[-1] < (1.0 - CLOSE) * start:
        return None
    away = np.flatnonzero(np.abs(mean - mean[-1]) > CLOSE * mean[-1])
    return float(t[min(away[-1] + 1, len(t) - 1)]) if len(away) else 0.0


def path_error(episode: Episode) -> np.ndarray:
    """(n,) m: distance from where the robot should be at that moment."""
    return np.asarray(np.linalg.norm((episode.truth - episode.reference)[:, _places(episode)], axis=1))


def _places(episode: Episode) -> list[int]:
    """Which of what is tracked are lengths."""
    return [i for i, c in enumerate(episode.poses) if c != "pose.theta" and c not in TURNS]


def figures(episode: Episode, limits: tuple[tuple[str, float, float], ...] = (), settle: float = 0.0) -> Figures:
    """limits: soft ones, (channel, lower, upper). settle: s at the start that tracking leaves out."""
    keep = episode.t >= settle
    error = path_error(episode)[keep]
    heading = float("nan")
    if "pose.theta" in episode.poses:
        i = episode.poses.index("pose.theta")
        off = (episode.truth - episode.reference)[keep, i]
        heading = float(np.sqrt(np.mean((np.remainder(off + np.pi, 2 * np.pi) - np.pi) ** 2)))
    elif set(TURNS) <= set(episode.poses):
        turned = (episode.truth - episode.reference)[keep][:, [episode.poses.index(c) for c in TURNS]]
        heading = float(np.sqrt(np.mean(np.sum(turned**2, axis=1))))
    beyond = np.zeros(len(episode.t), dtype=bool)
    for channel, lower, upper in limits:
        known = channel in episode.poses
        value = episode.truth[:, episode.poses.index(channel)] if known else episode.measured[channel]
        beyond |= (value < lower) | (value > upper)
    t, mean = h2_over_time(episode)
    ms = 1e3 * episode.seconds
    span = min(len(mean), int(np.searchsorted(t, MEAN_OVER)) + 1)
    return Figures(
        tracking_rmse=float(np.sqrt(np.mean(error**2))),
        tracking_max=float(error.max()),
        heading_rmse=heading,
        effort=float(np.sqrt(np.mean(episode.command**2))),
        violations=int(beyond.sum()),
        failures=sum(o not in ("solved", "inaccurate") for o in episode.outcomes),
        late=int((episode.seconds > episode.t[1] - episode.t[0]).sum()),
        solve=(float(np.median(ms)), float(np.quantile(ms, 0.99))),
        h2=float(h2_norm(episode).mean()),
        h2_first=float(mean[span - 1]),
        h2_last=float(mean[-1]),
        converged_after=converged_after(t, mean),
    )
