"""The residual network of a robot, learned from runs with a Kalman filter."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.display import brief, page
from residual_mpc.api.gap_figures import kept_back_of
from residual_mpc.api.given import check_given, check_not_over, check_seconds
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs
from residual_mpc.api.written import Source, placed, written
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically, write_json
from residual_mpc.learning.batch import checkpoint
from residual_mpc.learning.batch.training import Report, Task, TrainingResult, train
from residual_mpc.learning.batch.turned_over import turned_over
from residual_mpc.learning.batch.window_updates import LearnSettings
from residual_mpc.learning.cases import CASES, FIRST_CASE
from residual_mpc.learning.forms.registry import check_form
from residual_mpc.learning.network.residual import KEY, to_json
from residual_mpc.learning.network.written import kept_nothing, residual_in
from residual_mpc.models import optional
from residual_mpc.models.fits import fitting
from residual_mpc.models.model_file import MODEL_SCHEMA, Written, model_content
from residual_mpc.models.nominal_numbers import KEY as NOMINAL
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.models.settings import Values
from residual_mpc.report.learned import learned_page
from residual_mpc.report.words.learned import learned_lines

if TYPE_CHECKING:
    from pandas import DataFrame

CURVE = 200  # points of the learning's course that are kept
NOTE = (
    "A memoryless network cannot learn effects that depend on more than the current motion and command: dead time, "
    "backlash, slow drift and sensor effects."
)
BELOW = " A diagnosis identifies these: learn on top of it."


@dataclass(frozen=True, eq=False)
class LearnedModel:
    """document: what `learn --json` prints; model: the content of model.json, but for the robot file's place."""

    robot: NominalRobot
    document: dict[str, Any]
    model: dict[str, Any]

    @property
    def gap(self) -> dict[str, Any]:
        """Before and after, on the held-out runs or blocks; on the training runs where none were held out."""
        return dict(self.document["gap"])

    @property
    def h2_norm(self) -> dict[str, Any]:
        """The paper's norm of reference minus prediction: first and last, and on the held-out data."""
        return dict(self.document["h2_norm"])

    def to_frame(self) -> "DataFrame":
        """One row a channel: its gap before and after."""
        import pandas as pd

        rows = [(c, g["before"], g["after"]) for c, g in self.gap["channels"].items()]
        return pd.DataFrame(rows, columns=["channel", "before", "after"])

    def save(self, folder: str | Path) -> Path:
        """Write model.json, learn.json and report.html."""
        out = Path(folder)
        model = placed(self.model, self.robot, out)
        write_atomically(out / "model.json", json.dumps(model, allow_nan=False) + "\n")
        write_json(out / "learn.json", self.document)
        write_atomically(out / "report.html", learned_page(self.document, self.robot.name))
        return out

    def as_written(self) -> Written:
        return Written(self.model, "the learned model")

    def lines(self) -> list[str]:
        """What was learned, in words."""
        return learned_lines(self.document)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def learn(
    robot: NominalRobot,
    runs: Runs,
    *,
    on: Source | None = None,
    case: str = "real-to-dyn",
    warm_start: Source | None = None,
    form: str | None = None,
    hidden: Sequence[int] = (10, 10),
    method: str = "auto",
    passes: int = 5,
    step: float | None = None,
    weights: Mapping[str, float] | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    report: Report = lambda update, of, seconds, h2: None,
) -> LearnedModel:
    """Train the residual network on runs, and measure it on held-out runs.

    Args:
        on: a diagnosis, or its file, whose effects the network comes on top of.
        case: which model learns from which, see `CASES`.
        warm_start: the result of the previous case, or its file; None for the first case.
        form: "body", "paper" or "joint": which velocities are corrected, from what; None for the robot's usual one.
        hidden: nodes of the hidden layers.
        method: "ukf", "ekf" or "auto".
        passes: times through the data.
        step: of the residual, s; None for the form's own.
        weights: how much a channel's errors count, the paper's costs.
        out: folder for a checkpoint while it learns, from which the same call goes on, and for the result.
        report: told of every update.

    Raises:
        BadInput: runs with too little to learn from, a diagnosis or residual of another robot, a model to learn on that
            has a network already, a warm start of the first case, or a form that the robot cannot have.
    """
    check_given(robot, runs)
    folder = None if out is None else Path(out)
    for source in (on, warm_start):
        if isinstance(source, str | Path):
            check_not_over(source, folder)
    if step is not None:
        check_seconds(step, "`step`")
    if passes < 1 or not hidden or min(hidden) < 1:
        raise BadInput(
            f"passes and the nodes of each hidden layer must be 1 or more, got {passes} and {tuple(hidden)}", "learn",
            "passes=5 and hidden=(10, 10) are usual",
        )  # fmt: skip
    task = _task(robot, runs, case, on, warm_start, form)
    settings = LearnSettings(
        hidden=tuple(hidden), passes=passes, step=step, method=method, costs=tuple((weights or {}).items())
    )
    history: list[tuple[float, float]] = []

    def heard(update: int, of: int, seconds: float, h2: float) -> None:
        history.append((seconds, h2))
        report(update, of, seconds, h2)

    made = train(task, settings, np.random.default_rng(seed), heard, folder)
    # on effects that were fitted to an earlier nominal model, the network does not change what they belong to
    stated = {} if on is None else {NOMINAL: model_content(written(on)).get(NOMINAL)}
    document = _document(made, task, history, on is not None)
    learned = LearnedModel(robot, document, {**_model(made, task, robot.name), **stated})
    if folder is not None:
        learned.save(folder)
        checkpoint.clear(folder / checkpoint.FILE)
    return learned


def _task(
    robot: NominalRobot, runs: Runs, case: str, on: Source | None, warm_start: Source | None, form: str | None
) -> Task:
    if case not in CASES:
        raise BadInput(f"unknown case {case!r}", "`case`", f"give one of {', '.join(CASES)}")
    if case == FIRST_CASE and warm_start is not None:
        raise BadInput(
            f"the case {case!r} starts without an earlier residual and takes no `warm_start`", "`case`",
            "leave `warm_start` out, or give a later case than that of the residual: real-to-dyn or real-to-sim",
        )  # fmt: skip
    if form is not None:
        check_form(form, runs.models[0])
    values: Values = {}
    leaves_out, held = False, None
    if on is not None:
        below = written(on)
        if residual_in(below) is not None:
            raise BadInput(
                "the model already contains a learned network; a new one would replace it", below.where,
                "give the diagnosis that it was learned on as `on`, and this file as `warm_start` to go on from it",
            )  # fmt: skip
        values, leaves_out = fitting(below, runs.models[0])
        warn_of_differences(model_content(below), robot.model, below.where)
        held = kept_back_of(below, set(runs.names))
    earlier, earlier_file = None, ""
    if warm_start is not None:
        before = written(warm_start)
        earlier, earlier_file = residual_in(before, last=case == "real-to-sim"), before.where
        if earlier is None and not kept_nothing(before):
            raise BadInput("it contains no learned residual", before.where, "give a model.json written by learn")
    return Task(runs.runs, runs.models, runs.noise, case, values, leaves_out, held, earlier, earlier_file, form)


def _document(
    made: TrainingResult, task: Task, history: Sequence[tuple[float, float]], diagnosed: bool
) -> dict[str, Any]:
    """The `learn` object of the contract and more. history: (s of data, H2 norm) of every update of this call.
    diagnosed: whether it was learned on a diagnosis."""
    ms = made.update_ms
    floor = made.noise_floor
    figures = zip(made.channels, made.before.channels, made.after.channels, floor.channels, strict=True)
    channels = {
        c: {"before": float(b), "after": float(a), "noise_floor": float(f) if np.isfinite(f) else None}
        for c, b, a, f in figures
        if np.isfinite(b)
    }
    condition = made.condition
    return {
        "case": task.case,
        "updates": made.updates,
        "parameters": made.learned.net.size,
        "h2_norm": {
            "first": made.h2.first,
            "last": made.h2.last,
            "held_out_before": made.held_out_h2[0],
            "held_out_after": made.held_out_h2[1],
        },
        "converged_after": made.h2.converged_after,
        "update_ms": {"median": float(np.median(ms)), "p99": float(np.quantile(ms, 0.99))},
        "gap": {
            "before": made.before.total,
            "after": made.after.total,
            "noise_floor": floor.total,
            "at_noise_floor": {"before": made.at_noise_floor(made.before), "after": made.at_noise_floor(made.after)},
            "on": "held_out" if made.kept else "training",
            "channels": channels,
            "without_spikes": None
            if made.without_spikes is None
            else {"before": made.without_spikes[0], "after": made.without_spikes[1]},
        },
        "held_out": [k.document() for k in made.kept],
        "form": made.learned.form,
        "step": made.learned.step,
        "inputs": list(made.learned.inputs),
        "outputs": list(made.learned.outputs),
        "kept": made.learned.acts,
        "chosen_pass": made.chosen_pass,
        "left_alone": list(made.left_alone),
        "worse_on_held_out": list(made.worse_held_out),
        "condition": None
        if condition is None
        else {
            "without": condition.without,
            "with_earlier": condition.with_earlier,
            "holds": condition.holds,
            "kept": made.kept_earlier,
        },
        "nothing_earlier": task.earlier is None and bool(task.earlier_file),
        "turned_over": turned_over(task.runs, made.learned.inputs, optional.sliding(task.robots[0])),
        "seconds": made.seconds,
        "history": [[float(f"{x:.4g}") for x in history[k]] for k in _few(len(history))],
        "note": NOTE if diagnosed else NOTE + BELOW,
    }


def _few(count: int) -> list[int]:
    """At most CURVE of so many indices, the last among them."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, CURVE)).tolist()})


def _model(made: TrainingResult, task: Task, name: str) -> dict[str, Any]:
    return {
        "schema": MODEL_SCHEMA,
        "robot": name,
        "values": [{**k._asdict(), "value": v} for k, v in task.values.items()],
        "leaves_out_outliers": task.leaves_out_outliers,
        "held_out": [k.document() for k in made.kept],
        KEY: to_json(made.whole) if made.whole.acts else None,
        f"last_{KEY}": to_json(made.learned) if made.learned.acts else None,
        "case": task.case,
    }
