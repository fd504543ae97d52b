"""Several controllers on equal terms: the same plants, seeds and reference, and how much of the loss each recovers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import Filter
from residual_mpc.closed_loop.loop import Learner, LoopSettings, run_closed_loop
from residual_mpc.closed_loop.metrics import Figures, figures
from residual_mpc.closed_loop.protocols import Controller, Reading, Reference, Simulator

DISTINCT = 0.05  # nominal and oracle that differ by less say nothing about what was recovered
RESAMPLES = 2000
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class ControlStack:
    """A controller and its estimator, both on the same model. learner makes a fresh online learner for an episode."""

    estimator: Filter
    controller: Controller
    learner: Callable[[], Learner] | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """figures and episodes by controller, one a seed, in the order of the seeds."""

    figures: Mapping[str, tuple[Figures, ...]]
    episodes: Mapping[str, tuple[Episode, ...]]

    def errors(self, name: str) -> np.ndarray:
        """(seeds,) m."""
        return np.array([f.tracking_rmse for f in self.figures[name]])


def compare(
    simulator: Simulator,
    controllers: Mapping[str, ControlStack],
    reference: Reference,
    settings: LoopSettings,
    seeds: Sequence[int],
    limits: tuple[tuple[str, float, float], ...] = (),
    progress: Progress = lambda stage, done: None,
    at: Reading | None = None,
) -> Comparison:
    """Every controller drives every seed; a seed gives each of them the same plant and the same noise. at: where they
    begin, see `run_closed_loop`.
    """
    out: dict[str, list[Episode]] = {name: [] for name in controllers}
    for i, seed in enumerate(seeds):
        for j, (name, c) in enumerate(controllers.items()):
            progress(f"driving: {name}", (i + j / len(controllers)) / len(seeds))
            learner = None if c.learner is None else c.learner()
            rng = np.random.default_rng(seed)
            label = f"{name}_{seed}"
            episode = run_closed_loop(
                simulator, c.estimator, c.controller, reference, settings, rng, label, learner, at
            )
            out[name].append(episode)
    return Comparison(
        {name: tuple(figures(e, limits) for e in es) for name, es in out.items()},
        {name: tuple(es) for name, es in out.items()},
    )


def recovered(
    nominal: np.ndarray, mine: np.ndarray, oracle: np.ndarray, rng: np.random.Generator
) -> dict[str, Any] | None:
    """(mean nominal - mean mine) / (mean nominal - mean oracle), with a paired-bootstrap interval; each (seeds,).

    None where nominal and oracle differ by less than 5 %.
    """
    loss = nominal.mean() - oracle.mean()
    if abs(loss) < DISTINCT * nominal.mean():
        return None
    pick = rng.integers(0, len(nominal), (RESAMPLES, len(nominal)))
    below = nominal[pick].mean(axis=1) - oracle[pick].mean(axis=1)
    share = (nominal[pick].mean(axis=1) - mine[pick].mean(axis=1)) / np.where(below == 0.0, np.nan, below)
    low, high = np.nanquantile(share, [0.025, 0.975])
    return {"value": float((nominal.mean() - mine.mean()) / loss), "ci95": [float(low), float(high)]}


def document(comparison: Comparison, scenario: str, plant: str, rng: np.random.Generator) -> dict[str, Any]:
    """The `run` object of the contract."""
    controllers: dict[str, Any] = {}
    for name, fs in comparison.figures.items():
        controllers[name] = {
            "tracking_rmse": _mean(f.tracking_rmse for f in fs),
            "tracking_max": max(f.tracking_max for f in fs),
            "heading_rmse": _mean(f.heading_rmse for f in fs),
            "effort": _mean(f.effort for f in fs),
            "h2_norm": {"first": _mean(f.h2_first for f in fs), "last": _mean(f.h2_last for f in fs)}
            if name == "online"
            else _mean(f.h2 for f in fs),
            "solve_ms": {"median": _mean(f.solve[0] for f in fs), "p99": max(f.solve[1] for f in fs)},
            "failures": sum(f.failures for f in fs),
            "late": sum(f.late for f in fs),
            "violations": sum(f.violations for f in fs),
        }
        if name == "online":
            times = [f.converged_after for f in fs if f.converged_after is not None]
            controllers[name]["converged_after"] = _mean(times) if times else None
    shares: dict[str, Any] = {}
    if {"nominal", "oracle"} <= set(comparison.figures):
        others = [n for n in comparison.figures if n not in ("nominal", "oracle")]
        nominal, oracle = comparison.errors("nominal"), comparison.errors("oracle")
        shares = {n: recovered(nominal, comparison.errors(n), oracle, rng) for n in others}
    seeds = len(next(iter(comparison.figures.values())))
    return {"scenario": scenario, "plant": plant, "seeds": seeds, "controllers": controllers, "recovered": shares}


def _mean(values: Any) -> float | None:
    """The mean, or None where it is no number (a robot without a heading, a model that diverged)."""
    mean = float(np.mean(list(values)))
    return mean if np.isfinite(mean) else None
