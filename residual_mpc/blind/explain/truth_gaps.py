"""The gaps that the planted effects leave, with the values that were drawn and with the library's closest ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from residual_mpc.blind.records import Answer, Planted
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.model_file import MODEL_SCHEMA, Written, read_written

if TYPE_CHECKING:
    from residual_mpc.models.protocol import Robot

_TIMES_THE_FLOOR, _SMALL = 2.0, 0.05  # a gap that is as good as the sensors can tell: the rule of the verdict `effects`

_HORIZON = 1.0  # s, of the headline


@dataclass(frozen=True)
class GapOverHorizons:
    """total: of the headline's horizon; by_horizon: (gap, noise floor) of each, by its seconds, the headline first."""

    total: float
    by_horizon: Mapping[float, tuple[float, float]]

    @property
    def noise_floor(self) -> float:
        """Of the headline's horizon."""
        return next(iter(self.by_horizon.values()))[1]

    @property
    def large(self) -> bool:
        """Whether more is left than the sensors' noise explains, at some horizon."""
        return any(gap > max(_TIMES_THE_FLOOR * floor, _SMALL) for gap, floor in self.by_horizon.values())

    def worse_than(self, other: GapOverHorizons, margin: float) -> bool:
        """Whether it is larger by the share ``margin`` at a horizon that both have."""
        both = self.by_horizon.keys() & other.by_horizon.keys()
        return any(self.by_horizon[h][0] > (1 + margin) * other.by_horizon[h][0] for h in both)


def measure_truth_gaps(case: Path, answer: Answer, said: Path | None, only: Path) -> dict[str, GapOverHorizons]:
    """Of the models "said" and "only" (diagnoses), "nominal", "drawn", "best fit" and "with background", on the
    windows that ``only`` kept back."""
    from residual_mpc.api.gap_figures import gap_figures
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs, usable

    robot = load_robot(case / "robot.toml")
    paths = sorted(str(p) for p in case.iterdir() if p.suffix in (".csv", ".parquet"))
    runs = usable(read_runs(robot, paths))
    kept = read_written(only)
    fitted: Mapping[str, float] = answer.notes.get("best_fit", {})
    among: Mapping[str, float] = answer.notes.get("best_fit_among_background", fitted)
    planted = {p.effect for p in answer.effects}
    whole = (*answer.effects, *(p for p in answer.background if p.effect not in planted))
    models = {"only": kept, "drawn": _model(answer.effects, {}, robot.model)}
    if said is not None and "model" in (first := read_written(said)).content:
        models["said"] = first
    if fitted:
        models["best fit"] = _model(answer.effects, fitted, robot.model)
    if answer.background:
        models["with background"] = _model(whole, among, robot.model)
    found = {
        name: gap_figures(runs.runs, runs.models, robot.file, _HORIZON, model, kept, seed=0)
        for name, model in models.items()
    }
    # what a model lacks may pass for coloured noise, so the model with the lowest floor has the most of the truth
    floors: dict[float, float] = {}
    for look in (look for document in found.values() for look in document["horizons"]):
        h = float(look["horizon"])
        floors[h] = min(float(look["noise_floor"]), floors.get(h, math.inf))

    def over_horizons(document: Mapping[str, Any], which: str) -> GapOverHorizons:
        looks = {h: (float(look[which]), floors[h]) for look in document["horizons"] if (h := float(look["horizon"]))}
        return GapOverHorizons(float(document[which]), looks)

    return {
        "nominal": over_horizons(found["only"], "nominal"),
        **{name: over_horizons(document, "model") for name, document in found.items()},
    }


def _model(effects: Sequence[Planted], values: Mapping[str, float], robot: Robot) -> Written:
    """The model with ``effects``: ``values`` by "effect.parameter", else as drawn. Flagged samples have no value."""
    flagged = SENSOR_OUTLIERS.name
    rows = [
        {
            "effect": p.effect,
            "target": _target(p, robot),
            "parameter": parameter,
            "value": float(values.get(f"{p.effect}.{parameter}", drawn)),
        }
        for p in effects
        if p.effect != flagged
        for parameter, drawn in p.parameters.items()
    ]
    leaves_out = any(p.effect == flagged for p in effects)
    content = {"schema": MODEL_SCHEMA, "robot": robot.name, "values": rows, "leaves_out_outliers": leaves_out}
    return Written(content, "the planted effects")


def _target(planted: Planted, robot: Robot) -> str | None:
    """As the library has it: a sensor of a joint goes by the joint's name, and all of a robot's targets are none."""
    slots = robot.slots(planted.effect)
    named = (planted.target, planted.target.split(".")[-1]) if planted.target else ()
    return next((n for n in named if n in slots), None)
