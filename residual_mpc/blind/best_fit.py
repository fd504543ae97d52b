"""What an interval should cover where the truth follows another law than the library.

A motor of second order has no first-order time constant. Its closest one is found by fitting the planted
effects, under the library's law, to the noise-free truth: what a faint background adds to a parameter is
then part of its true value. A diagnosis may name part of the background as well; its numbers then lie between
that fit and one that has the background too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.blind.records import Answer, Planted
from residual_mpc.effects.sensor import SENSOR_OUTLIERS

if TYPE_CHECKING:
    from residual_mpc.diagnosis.data.dataset import Dataset

_FLAGGED = SENSOR_OUTLIERS.name  # counted, not fitted
_FIT_STEPS = 40_000  # simulation steps that one hypothesis may cost


def with_best_fit(answer: Answer, clean: Path, case: Path) -> Answer:
    """``answer`` with ``notes["best_fit"]``, values by "effect.parameter", and where it has a background
    ``notes["best_fit_among_background"]``; as it was if nothing is fitted."""
    if not clean.is_dir() or not any(p.effect != _FLAGGED for p in answer.effects):
        return answer
    notes = {**answer.notes, "best_fit": best_fit(answer.effects, clean, case)}
    if answer.background:
        planted = {p.effect for p in answer.effects}
        every = (*answer.effects, *(p for p in answer.background if p.effect not in planted and p.parameters))
        whole = best_fit(every, clean, case)
        notes["best_fit_among_background"] = {k: v for k, v in whole.items() if k in notes["best_fit"]}
    return replace(answer, notes=notes)


def best_fit(effects: Sequence[Planted], clean: Path, case: Path) -> dict[str, float]:
    """Least squares from the drawn values, over all windows of the runs in ``clean``, each channel weighed by its
    noise in ``case``: without noise of its own, a channel would outweigh all others."""
    from residual_mpc.diagnosis.data.subsampling import thin
    from residual_mpc.diagnosis.fit.least_squares import fit_all
    from residual_mpc.diagnosis.predict.candidates import build_space
    from residual_mpc.diagnosis.predict.problem import build_problem
    from residual_mpc.models.settings import Knob

    fitted = [p for p in effects if p.effect != _FLAGGED]
    noisy = _windows(case)
    sigma = dict(zip(noisy.channels, noisy.sigma, strict=True))
    whole = _windows(clean)
    data = thin(replace(whole, sigma=np.array([sigma[c] for c in whole.channels])), _FIT_STEPS)
    space = build_space(data, (), tuple(p.effect for p in fitted))
    known = {(t.effect, t.target) for t in space.candidates}
    start = {}
    for p in fitted:
        # a sensor of a joint goes by the joint's name, and a robot's only target is no target to the library
        names = (p.target, p.target and p.target.split(".")[-1], None)
        target = next(n for n in names if n is None or (p.effect, n) in known)
        for parameter, value in p.parameters.items():
            start[Knob(p.effect, target, parameter)] = float(value)
    fit = fit_all(build_problem(data, space, data.sigma), [start], 24, 1e-6)[0]
    return {f"{knob.effect}.{knob.parameter}": float(value) for knob, value in fit.values.items()}


def _windows(folder: Path) -> Dataset:
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs, usable
    from residual_mpc.diagnosis.data.dataset import build_dataset

    runs = sorted(str(p) for p in folder.iterdir() if p.suffix in (".csv", ".parquet"))
    logged = usable(read_runs(load_robot(folder / "robot.toml"), runs))
    return build_dataset(logged.runs, logged.models, logged.noise, 1.0)
