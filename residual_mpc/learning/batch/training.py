"""A whole learning call, in order: what is kept back, the earlier residual, the updates, the choice, the verdict."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import Gap, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.data.left_out import unfit
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, beyond
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.errors import BadInput
from residual_mpc.learning.batch import checkpoint as disk
from residual_mpc.learning.batch.evaluation import (
    Evaluation,
    build_evaluation,
    choose_validation_windows,
    overlapping,
    switched_off_where_worse,
    without_harmful_outputs,
    without_outliers,
)
from residual_mpc.learning.batch.stated_floor import stated_floor
from residual_mpc.learning.batch.training_problem import TrainingProblem
from residual_mpc.learning.batch.window_linearisation import h2_of
from residual_mpc.learning.batch.window_updates import (
    LearnSettings,
    build_training_problem,
    first_error,
    order_of,
    prior_belief,
    step_of,
    update_over_windows,
)
from residual_mpc.learning.cases import Condition, check_compatible, sum_residuals
from residual_mpc.learning.forms.registry import default_form, form_named
from residual_mpc.learning.h2 import H2, mean_of, summary
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values, assemble
from residual_mpc.models.targets import Targets

FEWEST = 4  # windows to learn from
SAVE_EVERY = 20  # updates


@dataclass(frozen=True)
class Task:
    """What is learned on what. robots[i] is the model of runs[i]; values: the effects of a diagnosis, whose flagged
    samples are left out where `leaves_out_outliers`; held_out: what the diagnosis kept back, None to choose; earlier: a
    residual to begin from, and the file that it came from."""

    runs: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: dict[str, float]
    case: str
    values: Values = field(default_factory=dict)
    leaves_out_outliers: bool = False
    held_out: tuple[KeptBack, ...] | None = None
    earlier: Residual | None = None
    earlier_file: str = ""
    form: str | None = None
    gap_horizon: float = 1.0


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """learned: what this call learned; whole: with what it builds on, as one residual; all outputs of either are off
    if nothing of it was kept. condition: of model_constr, None where nothing came before; kept_earlier: whether it
    holds and the gap agrees. h2 over the updates;
    held_out_h2: H2 norms before and after learning on the held-out runs, None without any; gaps on the same runs, and
    their noise floor.
    without_spikes: gaps before and after where the jumps of the localisation, found in the log, are left out; None
    where there are none, or where they are left out of `after` as well. left_alone: channels that got worse on
    windows set aside; worse_held_out: those that got worse on the held-out runs, and were then left alone too.
    chosen_pass: whose weights were taken, 0 for none.
    """

    learned: Residual
    whole: Residual
    condition: Condition | None
    kept_earlier: bool
    h2: H2
    held_out_h2: tuple[float | None, float | None]
    updates: int
    update_ms: np.ndarray
    before: Gap
    after: Gap
    noise_floor: NoiseFloor
    without_spikes: tuple[float, float] | None
    channels: tuple[str, ...]
    kept: tuple[KeptBack, ...]
    left_alone: tuple[str, ...]
    worse_held_out: tuple[str, ...]
    chosen_pass: int
    seconds: float

    def at_noise_floor(self, gap: Gap) -> bool:
        """Whether sensor noise alone explains a gap, overall and in each channel: nothing is left to learn."""
        return not beyond(gap, self.noise_floor, PredictSettings())


Report = Callable[[int, int, float, float], None]  # update, of how many, seconds of data, H2 norm over the last 10 s


def train(
    task: Task,
    settings: LearnSettings,
    rng: np.random.Generator,
    report: Report = lambda update, of, seconds, h2: None,
    folder: Path | None = None,
) -> TrainingResult:
    """Learn; with a folder, checkpoints are kept in it, and one of this very call is taken up again.

    Raises BadInput where the runs hold too little to learn from, or the earlier residual is another robot's.
    """
    with threadpool_limits(1):  # nets of this size lose by a second thread
        return _train(task, settings, rng, report, folder)


def _train(
    task: Task, settings: LearnSettings, rng: np.random.Generator, report: Report, folder: Path | None
) -> TrainingResult:
    effects = assemble([task.values], Targets(task.robots[0]))
    flagged = task.leaves_out_outliers
    seen = (task.runs, task.robots, task.noise, task.gap_horizon, effects, flagged)
    final = build_evaluation(*seen, False)
    # nothing is learned from a jump of the localisation, and nothing is judged by one
    evaluation = final if flagged else build_evaluation(*seen, True)
    base_error = evaluation.error(None)
    kept = task.held_out
    if kept is None:
        kept = choose_held_out(evaluation.data, per_window(evaluation.data, evaluation.scales, base_error))
    held = held_out_mask(evaluation.data, kept)
    aside, put_aside = choose_validation_windows(evaluation, base_error, held)

    form = form_named(task.form) if task.form else default_form(task.robots[0])
    grid = evaluation.data.blocks[0].drive.dt
    step = step_of(form, grid, settings)
    data = without_outliers(build_dataset(task.runs, task.robots, task.noise, settings.horizon * step))
    train_windows = ~overlapping(data, (*kept, *put_aside)) & ~unfit(data)
    if train_windows.sum() < FEWEST:
        raise BadInput(
            f"at least {FEWEST} windows of {settings.horizon * step:.3g} s are needed for training, "
            f"got {int(train_windows.sum())}",
            "runs",
            "record longer runs, or learn with a shorter `step`",
        )
    problem, blank = build_training_problem(
        data, form, step, settings, effects, (), train_windows, ~evaluation.scales.still, rng
    )
    problem, condition = _earlier(task, evaluation, problem, blank, train_windows, ~held, rng)
    order = order_of(train_windows, settings.passes, rng)

    trail = _updates(task, problem, blank, settings, evaluation, aside, order, report, folder)
    passes = np.array([evaluation.gap(_whole(problem, blank), aside).total, *trail.pass_gap])
    chosen = int(np.nanargmin(passes))
    learned = blank.switched_off() if chosen == 0 else blank.with_theta(trail.pass_theta[chosen - 1])
    whole, left_alone = without_harmful_outputs(evaluation, form, _whole(problem, learned), aside)
    worse: tuple[str, ...] = ()
    last = held if held.any() else ~held
    if held.any():
        whole, worse = without_harmful_outputs(evaluation, form, whole, held)
    whole, all_worse = switched_off_where_worse(tuple(dict.fromkeys((evaluation, final))), whole, last)
    worse = tuple(dict.fromkeys((*worse, *(all_worse if held.any() else ()))))
    learned = learned.without(tuple(o for o, s in zip(whole.outputs, whole.output_scale, strict=True) if s == 0.0))
    before, after = final.gap(None, last), final.gap(whole, last)
    jumps = evaluation.data is not final.data and not np.array_equal(final.data.y, evaluation.data.y, equal_nan=True)
    spared_of_them = (evaluation.gap(None, last).total, evaluation.gap(whole, last).total) if jumps else None
    return TrainingResult(
        learned,
        whole,
        condition,
        bool(problem.fixed) and whole.acts,
        summary(trail.h2, step),
        _held_out_h2(problem, blank, whole, kept),
        trail.update,
        trail.update_ms,
        before,
        after,
        stated_floor(final, seen[:3], whole, held, kept, flagged, rng),
        spared_of_them,
        evaluation.data.channels,
        kept,
        left_alone,
        worse,
        chosen,
        float(train_windows.sum() * settings.horizon * step * settings.passes),
    )


def _whole(problem: TrainingProblem, learned: Residual) -> Residual:
    """The sum of the fixed residuals and what was learned, if that acts."""
    parts = [*problem.fixed, learned] if learned.acts or not problem.fixed else list(problem.fixed)
    return replace(sum_residuals(parts), step=learned.step, robot=learned.robot)


def _earlier(
    task: Task,
    evaluation: Evaluation,
    problem: TrainingProblem,
    blank: Residual,
    windows: np.ndarray,
    seen: np.ndarray,
    rng: np.random.Generator,
) -> tuple[TrainingProblem, Condition | None]:
    """The problem with the earlier residual standing still, where the paper's condition holds on these runs, and where
    the gap on the windows `seen` falls with it: an H2 norm of noisy velocities may fall while positions get worse."""
    if task.earlier is None:
        return problem, None
    check_compatible(task.earlier, blank, task.earlier_file)
    some = np.flatnonzero(windows)
    some = np.sort(rng.permutation(some)[:100])
    norms = [np.concatenate([h2_of(problem, r, int(w)) for w in some]) for r in (blank, task.earlier)]
    condition = Condition(*(float(np.nanmean(n)) if np.isfinite(n).any() else float("inf") for n in norms))
    better = evaluation.gap(replace(task.earlier, robot=blank.robot), seen).total < evaluation.gap(None, seen).total
    return (replace(problem, fixed=(task.earlier,)) if condition.holds and better else problem), condition


def _updates(
    task: Task,
    problem: TrainingProblem,
    blank: Residual,
    settings: LearnSettings,
    evaluation: Evaluation,
    aside: np.ndarray,
    order: np.ndarray,
    report: Report,
    folder: Path | None,
) -> disk.Checkpoint:
    """All updates, from the last checkpoint of this very call on."""
    each = len(order) // settings.passes
    path = None if folder is None else folder / disk.FILE
    call = disk.fingerprint(
        problem.data.y, problem.data.start, *(b.drive.command for b in problem.data.blocks),
        repr(task.values), task.case, blank.theta, blank.input_scale, blank.output_scale,
        *(r.theta for r in problem.fixed), settings, order, blank.inputs, blank.form, blank.step,
    )  # fmt: skip
    at = None if path is None else disk.resume(path, call)
    if at is None:
        nothing = np.empty(0)
        error = first_error(problem, np.isin(np.arange(problem.data.count), order))
        at = disk.Checkpoint(
            0, prior_belief(blank, settings), error, nothing, nothing, nothing, np.empty((0, blank.net.size))
        )
    h2, ms = [at.h2], [at.update_ms]
    recent = list(at.h2[-500:])
    for p in update_over_windows(problem, blank, at.belief, at.error, order, settings, at.update):
        h2.append(p.h2)
        ms.append(np.array([p.update_ms]))
        recent = [*recent, *p.h2][-max(1, round(10.0 / blank.step)) :]
        ended = p.update % each == 0
        if ended or p.update % SAVE_EVERY == 0:
            gaps, thetas = at.pass_gap, at.pass_theta
            if ended:
                now = evaluation.gap(_whole(problem, blank.with_theta(p.belief.mean)), aside).total
                gaps, thetas = np.append(gaps, now), np.vstack([thetas, p.belief.mean])
            h2, ms = [np.concatenate(h2)], [np.concatenate(ms)]
            at = disk.Checkpoint(p.update, p.belief, p.error, h2[0], ms[0], gaps, thetas)
            if path is not None:
                disk.save(path, call, at)
        good = [x for x in recent if np.isfinite(x)]
        report(p.update, len(order), p.seconds, float(np.mean(good)) if good else float("nan"))
    return at


def _held_out_h2(
    problem: TrainingProblem, blank: Residual, whole: Residual, kept: Sequence[KeptBack]
) -> tuple[float | None, float | None]:
    rows = np.flatnonzero(overlapping(problem.data, kept))
    if not len(rows):
        return None, None
    alone = replace(problem, fixed=())
    before = mean_of([h2_of(alone, blank, int(w)) for w in rows])
    return before, mean_of([h2_of(alone, whole, int(w)) for w in rows])
