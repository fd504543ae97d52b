"""What an experiment came to: the contract's `learn` object, over all seeds, and more."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from residual_mpc.learning.h2 import H2, SPAN, summary
from residual_mpc.learning.stream.samples import reference_outliers
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.setting import SeedResult


def document(experiment: Experiment, done: Mapping[str, Sequence[SeedResult]]) -> dict[str, Any]:
    """H2 norms are means over the seeds at each instant, so that `converged_after` tells of the learning and not of one
    robot's slips; `converged_each` has it seed by seed. A jump of the localisation, found from the reference alone, is
    no measurement of the robot; `with_spikes` counts it all the same."""
    first, *others = experiment.forms
    return {
        "scenario": experiment.name,
        "plant": experiment.plant,
        "case": experiment.case,
        **of_form(done[first], experiment.jumps),
        "minutes_in_paper": experiment.minutes,
        "low_pass": experiment.settings.low_pass,
        "beside": {form: of_form(done[form], experiment.jumps) for form in others},
    }


def of_form(results: Sequence[SeedResult], jumps: bool) -> dict[str, Any]:
    """What one form of the residual came to."""
    step = results[0].setting.samples.step
    norms = [x.streamed.h2 for x in results]
    jump = [reference_outliers(x.setting.samples)[: len(n)] & jumps for x, n in zip(results, norms, strict=True)]
    seen = [np.where(j, np.nan, n) for j, n in zip(jump, norms, strict=True)]
    h2, literal = (summary(mean_over_seeds(n), step) for n in (seen, norms))
    ms = np.concatenate([x.streamed.update_ms for x in results])
    held = [x.condition.holds for x in results if x.condition is not None]
    return {
        "form": results[0].setting.form,
        "seeds": len(results),
        "updates": results[0].streamed.updates,
        "parameters": results[0].streamed.residual.net.size,
        "h2_norm": {
            "first": h2.first,
            "last": h2.last,
            "held_out_before": float(np.mean([x.before for x in results])),
            "held_out_after": float(np.mean([x.after for x in results])),
        },
        "converged_after": h2.converged_after,
        "converged_each": [summary(n, step).converged_after for n in seen],
        "spikes": int(sum(j.sum() for j in jump)),
        "with_spikes": _h2(literal),
        "components": _components(results),
        "update_ms": {"median": float(np.median(ms)), "p99": float(np.quantile(ms, 0.99))},
        "seconds": float(step * len(results[0].setting.samples)),
        "earlier_kept": None if not held else int(sum(held)),
    }


def mean_over_seeds(norms: Sequence[np.ndarray]) -> np.ndarray:
    """(n,) mean of norms (n,) at each instant over the seeds that saw anything then; NaN where none did."""
    stacked = np.array(norms)
    seen = np.isfinite(stacked)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(seen, stacked, 0.0).sum(axis=0) / seen.sum(axis=0))


def _h2(h2: H2) -> dict[str, Any]:
    return {"first": h2.first, "last": h2.last, "converged_after": h2.converged_after}


def _components(results: Sequence[SeedResult]) -> dict[str, Any]:
    """Mean absolute error of each component over the first and the last 10 s."""
    n = round(SPAN / results[0].setting.samples.step)
    off = np.nanmean(
        [np.abs(x.setting.samples.reference[: len(x.streamed.velocity)] - x.streamed.velocity) for x in results], axis=0
    )
    return {
        name: {"first": float(np.nanmean(off[:n, k])), "last": float(np.nanmean(off[-n:, k]))}
        for k, name in enumerate(results[0].setting.names[1])
    }
