"""Speeds of wheels from the angles of their encoders, where the model predicts the speeds alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.columns import group, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import fresh_samples, unwrap_with_gaps

FEWEST = 3  # samples
MARGIN = 1e-3  # rad, of angles that were rounded
WRAPS = 0.9  # of the range of the readings: a step that a wheel cannot make between two of them


def with_speeds_of_angles(
    runs: Sequence[Run], channels: Sequence[Sequence[str]]
) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """The runs with `velocity.*` (rad/s) in place of `position.*` (rad), where a robot's model predicts only the former
    and the run has only the latter.

    Args:
        channels: of each run, those that its model predicts.
    """
    angles = [_angles(run, of) for run, of in zip(runs, channels, strict=True)]
    out = tuple(_converted(run, names) if names else run for run, names in zip(runs, angles, strict=True))
    findings = []
    for name in dict.fromkeys(name for names in angles for name in names):
        where = [run.name for run, names in zip(runs, angles, strict=True) if name in names]
        one = where[0] if len(where) == 1 else ""
        text = f"{name} is an angle whose speed the model predicts; it is compared as velocity.{member(name)}"
        findings.append(Finding("info", "speeds of angles", one, name, None, text))
    return out, tuple(findings)


def _angles(run: Run, channels: Sequence[str]) -> tuple[str, ...]:
    """The columns to convert."""
    return tuple(
        name
        for name in run.measured
        if group(name) == "position"
        and name not in channels
        and (speed := f"velocity.{member(name)}") in channels
        and not np.isfinite(run.columns.get(speed, np.nan)).any()
        and speed not in run.served_as_command
        and int(fresh_samples(run.columns[name]).sum()) >= FEWEST
    )


def _converted(run: Run, names: Sequence[str]) -> Run:
    columns = {
        f"velocity.{member(name)}" if name in names else name: _speeds(run.t, values) if name in names else values
        for name, values in run.columns.items()
        if name not in {f"velocity.{member(n)}" for n in names}
    }
    return replace(run, columns=columns)


def _speeds(t: FloatArray, angle: FloatArray) -> FloatArray:
    """(n,) rad/s: at each sample the slope there of the parabola through it and its neighbours, so that it is neither
    early nor late; NaN at the first, the last and between the samples of a slower encoder."""
    fresh = np.flatnonzero(fresh_samples(angle))
    at, y = t[fresh], angle[fresh]
    if np.ptp(y) <= 2.0 * np.pi + MARGIN:  # may come round after a turn
        y = unwrap_with_gaps(y)
    elif (np.abs(np.diff(y)) > WRAPS * np.ptp(y)).any():  # a counter that starts again
        y = np.unwrap(y, period=float(np.ptp(y)))
    speed = np.full(len(t), np.nan)
    speed[fresh[1:-1]] = np.gradient(y, at)[1:-1]
    return speed
