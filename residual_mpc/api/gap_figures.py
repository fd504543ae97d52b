"""The gap of the nominal model and of a diagnosed one on the same runs: what `residual-mpc gap` prints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.constant_velocity import constant_velocity
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, measure_scales, per_window, still_channels
from residual_mpc.diagnosis.data.hold_out import KeptBack, held_out_mask
from residual_mpc.diagnosis.data.left_out import telling
from residual_mpc.diagnosis.data.noise_model import ChannelNoise
from residual_mpc.diagnosis.data.outliers import find_outliers, with_outliers_removed
from residual_mpc.diagnosis.data.stale import any_slow, without_repeats
from residual_mpc.diagnosis.fit.noise_left import noise_left
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.horizons import FORETOLD, full_windows, longer_horizons
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.noise_floor import floor_from
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.diagnosis.results.quantiles import quantiles
from residual_mpc.errors import BadInput
from residual_mpc.learning.forms.residual_robot import with_residual
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.network.written import residual_for
from residual_mpc.logs.run import Run
from residual_mpc.models.fits import fitting
from residual_mpc.models.model_file import Written
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, noise_over
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.models.targets import Targets


def gap_figures(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    robot_file: RobotFile,
    horizon: float,
    model: Written | None,
    held_out_of: Written | None,
    seed: int,
    tuning: FitSettings = FitSettings(),
) -> dict[str, Any]:
    """The gap object of the contract. Raises BadInput for a model of another robot, or held-out runs that are not
    there.
    """
    model_of = explaining(model, robots[0])
    noise = noise_over(robot_file, [run.name for run in runs])
    kept = None if held_out_of is None else _kept(held_out_of)
    first = build_dataset(runs, robots, noise, horizon, settings=tuning.data)
    mask = None if held_out_of is None else held_out_mask_of(held_out_of, first)
    longer = [
        h
        for h in longer_horizons(first.runs, horizon, settings=tuning.predict)
        if kept is None or all(k.start is None for k in kept)
    ]
    wholes = [build_dataset(runs, robots, noise, h, full_windows(first.runs, h), settings=tuning.data) for h in longer]
    coloured = _noise_of(wholes[0] if wholes else first, first, model_of, tuning)
    headline = _figures(replace(first, noise=coloured), measure_scales(first), mask, model_of, seed, tuning)
    more = []
    for data in wholes:
        scales = measure_scales(data)
        try:
            of_runs = None if held_out_of is None else held_out_mask_of(held_out_of, data)
        except BadInput:  # what was held out is shorter than this horizon
            continue
        found = _figures(replace(data, noise=coloured), scales, of_runs, model_of, seed, tuning)
        if found["noise_floor"] < FORETOLD:
            more.append(found)
    g = {k: v for k, v in headline.items() if k != "channels"}
    found = {**g, "skipped": first.skipped, "channels": headline["channels"], "horizons": [headline, *more]}
    found["noise_stated"] = set(headline["channels"]) <= set(first.stated)
    clean: dict[str, Any] = finite(found)
    return clean


@dataclass(frozen=True)
class Explaining:
    """A model beside the nominal one: its effects' values, whether samples that jump away are among them, and what was
    learned, with its file. given: whether there is such a model at all."""

    values: Values
    leaves_out: bool
    residual: tuple[Residual, str] | None
    given: bool


def explaining(model: Written | None, robot: Robot) -> Explaining:
    """What a diagnosis or a learned model says of this robot; of none, the nominal model. Raises BadInput for a model
    of another robot."""
    if model is None:
        return Explaining({}, False, None, False)
    values, leaves_out = fitting(model, robot)
    residual = residual_for(model, robot.name)
    return Explaining(values, leaves_out, None if residual is None else (residual, model.where), True)


def _noise_of(data: Dataset, headline: Dataset, model: Explaining, tuning: FitSettings) -> tuple[ChannelNoise, ...]:
    """The noise that the model leaves, no more than there is at the headline's horizon."""
    seen, settings = as_seen(data, model, tuning)
    return noise_left(
        (as_seen(headline, model, tuning)[0], measure_scales(headline)),
        (seen, measure_scales(data)),
        build_space(data, ()),
        settings,
        settings=tuning,
    )


def as_seen(data: Dataset, model: Explaining, tuning: FitSettings) -> tuple[Dataset, Settings]:
    """The data as the model sees them, and its settings."""
    seen = with_outliers_removed(data, find_outliers(data, settings=tuning.data).flagged) if model.leaves_out else data
    if model.residual is not None:
        blocks = with_residual([b.robot for b in seen.blocks], *model.residual)
        seen = replace(seen, blocks=tuple(replace(b, robot=r) for b, r in zip(seen.blocks, blocks, strict=True)))
    robot = data.blocks[0].robot
    return seen, assemble([model.values], Targets(robot))


def _figures(
    data: Dataset, scales: Scales, mask: np.ndarray | None, model: Explaining, seed: int, tuning: FitSettings
) -> dict[str, Any]:
    """The gap object of one horizon, with the figures of the new readings where a sensor is slow."""
    data = data if mask is None else data.take(mask)
    new = _plain_figures(without_repeats(data), scales, model, seed, tuning) if any_slow(data) else None
    fresh = None if new is None else {k: new[k] for k in ("nominal", "model", "noise_floor")}
    return {**_plain_figures(data, scales, model, seed, tuning), "new_readings": fresh}


def _plain_figures(data: Dataset, scales: Scales, model: Explaining, seed: int, tuning: FitSettings) -> dict[str, Any]:
    seen, settings = as_seen(data, model, tuning)
    nominal = data.y - predict(data, Settings(1))[0]
    other = seen.y - predict(seen, settings)[0] if model.given else None
    g = gap_of(data, scales, nominal)
    m = None if other is None else gap_of(seen, scales, other)
    drawn = noise_errors(seen, settings, np.random.default_rng(seed), tuning.predict.floor.figure_draws)
    floor = floor_from([gap_of(seen, scales, e) for e in drawn], seen.count, settings=tuning.predict)
    steady = gap_of(data, scales, data.y - constant_velocity(data)).total
    windows = {"nominal": quantiles(per_window(data, scales, nominal), data)}
    if other is not None:
        windows["model"] = quantiles(per_window(seen, scales, other), seen)
    kept = telling(data)
    clear = [None if e is None else gap_of(of, scales, e, kept).total for of, e in ((data, nominal), (seen, other))]
    return {
        "nominal": g.total,
        "model": None if m is None else m.total,
        "noise_floor": floor.total,
        "constant_velocity": steady,
        "horizon": data.horizon,
        "windows": data.count,
        "still": list(still_channels(data, scales)),
        "window_gaps": windows,
        "left_out_of_fits": {"windows": int((~kept).sum()), "nominal_without": clear[0], "model_without": clear[1]},
        "channels": {
            c: {
                "nominal": float(g.channels[k]),
                "model": None if m is None else float(m.channels[k]),
                "noise_floor": float(floor.channels[k]),
            }
            for k, c in enumerate(data.channels)
            if not scales.still[k]
        },
    }


def held_out_mask_of(written: Written, data: Any) -> np.ndarray:
    """(W,) the windows that a diagnosis kept back; all of them where only its held-out runs are given."""
    kept = _kept(written)
    if not kept:
        raise BadInput("the diagnosis held nothing out", written.where, "leave out `held_out_of`")
    names = {data.runs[i].name for i in np.unique(data.run)}
    if {k.run for k in kept} >= names and all(k.start is None for k in kept):
        return np.ones(data.count, dtype=bool)
    return held_out_mask(data, kept)


def kept_back_of(written: Written, names: set[str]) -> tuple[KeptBack, ...] | None:
    """What a diagnosis kept back of the runs `names`; None where it kept back none of them, or all."""
    kept = tuple(k for k in _kept(written) if k.run in names)
    whole = {k.run for k in kept if k.start is None}
    return None if not kept or whole >= names else kept


def _kept(written: Written) -> list[KeptBack]:
    held_out = written.content.get("held_out", [])
    if not isinstance(held_out, list):
        raise BadInput(f"held_out must be a list, got {held_out!r}", written.where)
    return [_kept_back(item, written.where) for item in held_out]


def _kept_back(item: Any, where: str) -> KeptBack:
    if isinstance(item, str):
        return KeptBack(item)
    try:
        return KeptBack(str(item["run"]), float(item["from"]), float(item["to"]))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(
            f'items of held_out must be run names or {{"run", "from", "to"}}, got {item!r}', where
        ) from error
