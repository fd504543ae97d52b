"""What a residual is judged on: the windows of the gap, which of them choose, and which outputs do harm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Gap, Scales, gap_of, measure_scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.data.left_out import unfit, without
from residual_mpc.diagnosis.data.outliers import find_outliers, with_outliers_removed
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.forms.residual_robot import with_residual
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The windows of the gap, and how a residual does on them."""

    data: Dataset
    scales: Scales
    settings: Settings

    def error(self, residual: Residual | None) -> np.ndarray:
        """(W, M, C) measured - predicted."""
        data = with_learned(self.data, residual)
        return np.asarray(data.y - predict(data, self.settings)[0])

    def gap(self, residual: Residual | None, windows: np.ndarray) -> Gap:
        return gap_of(self.data, self.scales, self.error(residual), windows)


def with_learned(data: Dataset, residual: Residual | None) -> Dataset:
    """The data with the residual in the models, where it acts."""
    if residual is None or not residual.acts:
        return data
    made = with_residual([b.robot for b in data.blocks], residual)
    return replace(data, blocks=tuple(replace(b, robot=m) for b, m in zip(data.blocks, made, strict=True)))


def build_evaluation(
    runs: Sequence[Run], robots: Sequence[Robot], noise: Mapping[str, float], horizon: float, effects: Settings,
    flagged: bool, cleaned: bool,
) -> Evaluation:  # fmt: skip
    """On the windows that are not across a gap or an incident of the log. flagged: without the samples that a
    diagnosis leaves out; cleaned: without all that a jump spoils."""
    logged = build_dataset(runs, robots, noise, horizon)
    raw = without(logged, unfit(logged))
    seen = (
        with_outliers_removed(raw, find_outliers(raw).flagged) if flagged else without_outliers(raw) if cleaned else raw
    )
    return Evaluation(seen, measure_scales(logged), effects)


def overlapping(data: Dataset, kept: Sequence[KeptBack]) -> np.ndarray:
    """(W,) bool: windows that share any moment with what is kept back."""
    names = [r.name for r in data.runs]
    mask = np.zeros(data.count, dtype=bool)
    for k in kept:
        mine = data.run == names.index(k.run)
        if k.start is not None and k.end is not None:
            mine &= (data.start < k.end - 1e-9) & (data.start + data.horizon > k.start + 1e-9)
        mask |= mine
    return mask


def without_outliers(data: Dataset) -> Dataset:
    """Without the samples that jump away; a localisation jumps as a whole, its velocities with it."""
    found = find_outliers(data)
    if not found.count:
        return data
    flagged = dict(found.flagged)
    for (row, channel), signal in data.signals.items():
        kind = channel.partition(".")[0]
        if kind in ("pose", "twist"):
            stamps = [
                data.signals[r, c].t[mask]
                for (r, c), mask in found.flagged.items()
                if r == row and c.startswith("pose.") and mask.any()
            ]
            if stamps:
                flagged[row, channel] = np.isin(np.round(signal.t, 9), np.round(np.concatenate(stamps), 9))
    return with_outliers_removed(data, flagged)


def choose_validation_windows(
    evaluation: Evaluation, error: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, tuple[KeptBack, ...]]:
    """Windows (W,) that choose the pass and the channels; none of them is learned from, none kept back. Where the runs
    are too short for that, the windows that are learned from choose."""
    rest = evaluation.data.take(~held)
    kept = choose_held_out(rest, per_window(rest, evaluation.scales, error[~held]))
    mask = np.zeros(evaluation.data.count, dtype=bool)
    if kept:
        mask = held_out_mask(evaluation.data, kept) & ~held
    return (mask, kept) if mask.any() else (~held, ())


def without_harmful_outputs(
    evaluation: Evaluation, form: Form, learned: Residual, windows: np.ndarray
) -> tuple[Residual, tuple[str, ...]]:
    """The residual with the outputs switched off that make a channel worse on these windows, and those channels. An
    output stays on where its channel would be worse still without it: in a chain, what moves one joint moves the next,
    and the outputs were learned together."""
    base = evaluation.gap(None, windows).channels
    worse: list[str] = []
    for _ in range(len(learned.outputs)):
        if not learned.output_scale.any():
            break
        now = evaluation.gap(learned, windows).channels
        off = [c for k, c in enumerate(evaluation.data.channels) if now[k] > base[k]]
        moving = {o for c in off for o in form.moved_by(evaluation.data.blocks[0].robot, c)}
        moving = {o for o, s in zip(learned.outputs, learned.output_scale, strict=True) if o in moving and s > 0}
        if not moving:
            break
        fewer = learned.without(tuple(moving))
        then = evaluation.gap(fewer, windows).channels
        if all(then[k] >= now[k] for k, c in enumerate(evaluation.data.channels) if c in off):
            break
        worse += [c for c in off if c not in worse]
        learned = fewer
    return learned, tuple(worse)


def switched_off_where_worse(
    evaluations: Sequence[Evaluation], learned: Residual, windows: np.ndarray
) -> tuple[Residual, tuple[str, ...]]:
    """The residual, with all of its outputs switched off if it makes the gap of any evaluation larger on these windows
    (W,); and the channels that it made worse there."""
    for evaluation in evaluations:
        before, after = evaluation.gap(None, windows), evaluation.gap(learned, windows)
        if not after.total <= before.total:  # also where it is not finite
            worse = after.channels > before.channels
            names = evaluation.data.channels
            return learned.switched_off(), tuple(c for c, w in zip(names, worse, strict=True) if w)
    return learned, ()
