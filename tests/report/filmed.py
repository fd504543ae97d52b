"""A diagnosis as far as its pictures need it: a run cut into windows, and the errors of two models on them."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.effects.library import LIBRARY
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Values, assemble


def filmed(run: Run, robot: Robot, values: Values, horizons: tuple[float, ...] = (1.0,)) -> DiagnosisResult:
    """`values`: those of the corrected model; empty where nothing is named; horizons: s, over which a gap is known."""
    data = build_dataset([run], [robot], {}, 1.0)
    slots = {e.name: robot.slots(e.name) for e in LIBRARY}
    before = data.y - predict(data, Settings(1))[0]
    after = data.y - predict(data, assemble([values], slots))[0] if values else before
    looks = tuple(SimpleNamespace(horizon=h, held_out=h == 1.0) for h in horizons)
    gap = SimpleNamespace(horizons=looks)
    diagnosis: Any = SimpleNamespace(causes=tuple(values), values=values, gap=gap, groups_of_windows=())
    held = np.zeros(data.count, dtype=bool)
    held[data.count // 2 :] = True
    return DiagnosisResult(diagnosis, data, measure_scales(data), before, after, held, {})
