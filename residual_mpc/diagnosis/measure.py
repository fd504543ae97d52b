"""The gap of the nominal model and of a diagnosed one on the same runs: what `residual-mpc gap` prints."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.diagnosis.dataset import build_dataset
from residual_mpc.diagnosis.document import read_json, read_model, read_residual
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import gap_of, measure_scales
from residual_mpc.diagnosis.hold_out import KeptBack, held_out_mask
from residual_mpc.diagnosis.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.spikes import find_outliers
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.fits import check_fits
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, noise_over
from residual_mpc.models.settings import Values, assemble
from residual_mpc.residual.robot import with_residual


def measure(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    robot_file: RobotFile,
    horizon: float,
    model: Path | None,
    held_out_of: Path | None,
    seed: int,
) -> dict[str, Any]:
    """The gap object of the contract. Raises BadInput for a model of another robot, or held-out runs that are not
    there.
    """
    values: Values = {}
    leaves_out = False
    if model is not None:
        of, values, leaves_out = read_model(model)
        check_fits(values, robots[0], of, str(model))
    residual = None if model is None else read_residual(model)
    if residual is not None and residual.robot != robots[0].name:
        raise BadInput(
            f"its residual was learned on {residual.robot}, and this is {robots[0].name}",
            str(model),
            "give the robot file that it was learned with",
        )
    data = build_dataset(runs, robots, noise_over(robot_file, [run.name for run in runs]), horizon)
    scales = measure_scales(data)
    if held_out_of is not None:
        data = data.take(held_out_mask_of(held_out_of, data))
    nominal = data.y - predict(data, assemble([{}], {}))[0]
    seen = with_outliers_removed(data, find_outliers(data).flagged) if leaves_out else data
    if residual is not None:
        blocks = with_residual([b.robot for b in seen.blocks], residual, str(model))
        seen = replace(seen, blocks=tuple(replace(b, robot=r) for b, r in zip(seen.blocks, blocks, strict=True)))
    settings = assemble([values], {e.name: robots[0].slots(e.name) for e in LIBRARY})
    other = seen.y - predict(seen, settings)[0] if model is not None else None
    floors = noise_errors(seen, settings, np.random.default_rng(seed))
    g = gap_of(data, scales, nominal)
    m = None if other is None else gap_of(seen, scales, other)
    f = [gap_of(seen, scales, e) for e in floors]
    floor_channels = np.sqrt(np.mean([x.channels**2 for x in f], axis=0))
    return {
        "nominal": g.total,
        "model": None if m is None else m.total,
        "noise_floor": float(np.sqrt(np.mean([x.total**2 for x in f]))),
        "horizon": horizon,
        "windows": data.count,
        "skipped": data.skipped,
        "still": [c for c, s, k in zip(data.channels, scales.still, scales.compared, strict=True) if s and k],
        "channels": {
            c: {
                "nominal": float(g.channels[k]),
                "model": None if m is None else float(m.channels[k]),
                "noise_floor": float(floor_channels[k]),
            }
            for k, c in enumerate(data.channels)
            if not scales.still[k]
        },
    }


def held_out_mask_of(path: Path, data: Any) -> np.ndarray:
    """(W,) the windows that a diagnosis kept back; all of them where only its held-out runs are given."""
    kept = _kept(path)
    if not kept:
        raise BadInput("the diagnosis kept nothing back", str(path), "leave --held-out-of away")
    names = {r.name for r in data.runs}
    if {k.run for k in kept} >= names and all(k.start is None for k in kept):
        return np.ones(data.count, dtype=bool)
    return held_out_mask(data, kept)


def kept_back_of(path: Path, names: set[str]) -> tuple[KeptBack, ...] | None:
    """What a diagnosis kept back of the runs `names`; None where it kept back none of them, or all."""
    kept = tuple(k for k in _kept(path) if k.run in names)
    whole = {k.run for k in kept if k.start is None}
    return None if not kept or whole >= names else kept


def _kept(path: Path) -> list[KeptBack]:
    held_out = read_json(path).get("held_out", [])
    if not isinstance(held_out, list):
        raise BadInput(f"held_out is {held_out!r}", str(path), "wanted a list, as diagnose writes it")
    return [_kept_back(item, path) for item in held_out]


def _kept_back(item: Any, path: Path) -> KeptBack:
    if isinstance(item, str):
        return KeptBack(item)
    try:
        return KeptBack(str(item["run"]), float(item["from"]), float(item["to"]))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(
            f"held_out holds {item!r}", str(path), 'wanted a run\'s name or {"run", "from", "to"}'
        ) from error
