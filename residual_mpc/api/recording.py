"""Runs and what a model predicts of them, as recordings for Rerun and Foxglove."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from residual_mpc.api.gap_figures import as_seen, explaining, gap_figures
from residual_mpc.api.given import check_given, check_seconds
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs
from residual_mpc.api.watch import diagnosed_runs
from residual_mpc.api.written import Source, written
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.errors import BadInput
from residual_mpc.export.recording.recording import Recording
from residual_mpc.export.recording.trace import replay, traces
from residual_mpc.export.recording.write import SUFFIXES, check_package, file_names, write_recording
from residual_mpc.files import write_json
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.model_file import Written, model_content
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.models.settings import Settings

USUAL_HORIZON = 1.0  # s


def export_runs(
    robot: NominalRobot,
    runs: Runs,
    to: str,
    out: str | Path,
    *,
    model: Source,
    horizon: float | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Write runs with the predictions of the nominal and the corrected model; what `export --json` prints.

    Args:
        to: "rerun" (.rrd) or "mcap".
        out: a folder, in which each run becomes a file beside export.json; for one run also the name of its file.
        model: a diagnosis or a learned model, or its file: the corrected model.
        horizon: length of a window, s; by default the diagnosis', else 1.
        seed: of the draws of the noise floor.

    Raises:
        BadInput: runs that cannot be used, a model of another robot, a package that is missing, or a place that cannot
            be written.
    """
    if to not in SUFFIXES:
        raise BadInput(f"unknown format {to!r}", "to", f"give one of {', '.join(SUFFIXES)}")
    check_package(to)
    places = _places(Path(out), runs.names, to)
    check_given(robot, runs)
    if horizon is not None:
        check_seconds(horizon, "horizon")
    source, tuning = written(model), FitSettings()
    warn_of_differences(model_content(source), robot.model, source.where)
    horizon = _horizon_of(source) if horizon is None else horizon
    figures = gap_figures(runs.runs, runs.models, robot.file, horizon, source, None, seed, tuning)
    data = build_dataset(runs.runs, runs.models, runs.noise, horizon, settings=tuning.data)
    scales = measure_scales(data)
    nominal = replay(data, Settings(1), scales)
    corrected = replay(*as_seen(data, explaining(source, runs.models[0]), tuning), scales)
    found = traces(runs.runs, runs.models, nominal, corrected)
    recording = Recording(robot.name, Path(source.where).name, horizon, figures["noise_floor"], found)
    left_out = write_recording(recording, to, places)
    each = []
    for i, (trace, place) in enumerate(zip(found, places, strict=True)):
        mine = data.run == i
        gaps = {k: r.gap_over(scales, mine) for k, r in (("nominal", nominal), ("corrected", corrected))}
        size = {"seconds": trace.seconds, "windows": int(mine.sum())}
        each.append({"run": trace.run, "file": place.name, **size, **gaps})
    document: dict[str, Any] = finite(
        {
            "to": to, "robot": robot.name, "horizon": horizon, "nominal": figures["nominal"],
            "corrected": figures["model"], "noise_floor": figures["noise_floor"], "runs": each,
            "files": {run["file"]: _described(run) for run in each}, "left_out": left_out,
        }
    )  # fmt: skip
    folder = places[0].parent
    if not _is_file(Path(out), to):
        write_json(folder / "export.json", document)
    return {**document, "folder": str(folder)}


def runs_of(model: Source) -> Sequence[str]:
    """Paths of the runs behind a diagnosis, or behind the diagnosis beside a model. Raises BadInput where they are not
    known or no longer exist."""
    source = written(model)
    paths, described = diagnosed_runs(source)
    if not paths:
        what = f"{described} do not all exist any more" if described else "it names no runs"
        if residual_in(source) is not None and not described:
            what = "a learned model lists no runs, and its folder has no diagnosis"
        raise BadInput(what, source.where, "name runs with `runs`")
    return paths


def _places(out: Path, runs: Sequence[str], to: str) -> list[Path]:
    if not _is_file(out, to):
        return [out / name for name in file_names(runs, to)]
    if len(runs) > 1:
        raise BadInput(
            f"one file cannot hold {len(runs)} runs: each run becomes a file of its own", str(out),
            "name a folder with `out`",
        )  # fmt: skip
    return [out]


def _horizon_of(model: Written) -> float:
    """s"""
    gap = model.content.get("gap")
    stated = gap.get("horizon") if isinstance(gap, dict) else None
    return float(stated) if isinstance(stated, int | float) and 0.0 < stated < float("inf") else USUAL_HORIZON


def _is_file(out: Path, to: str) -> bool:
    return out.suffix.lower() == SUFFIXES[to] and not out.is_dir()


def _described(run: dict[str, Any]) -> str:
    if not run["windows"]:
        return f"{run['seconds']:.3g} s, no prediction, since no window has a measured start"
    return (
        f"{run['seconds']:.3g} s, {run['windows']} windows, gap {run['nominal']:.3g} nominal, "
        f"{run['corrected']:.3g} corrected"
    )
