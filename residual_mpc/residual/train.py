"""A whole learning call, in order: what is kept back, the earlier residual, the updates, the choice, the verdict."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.gap import Gap, Scales, gap_of, measure_scales, per_window
from residual_mpc.diagnosis.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.spikes import find_outliers
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.residual import checkpoint as disk
from residual_mpc.residual.cases import Condition, check_alike, total
from residual_mpc.residual.forms import Form, form_named, usual_form
from residual_mpc.residual.h2 import H2, mean_of, summary
from residual_mpc.residual.learn import LearnSettings, begin, first_error, order_of, prior, run, step_of
from residual_mpc.residual.lesson import Course, h2_of
from residual_mpc.residual.record import Residual
from residual_mpc.residual.robot import with_residual

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
class Learned:
    """learned: what this call learned; whole: with what it builds on, as one residual. condition: of model_constr, None
    where nothing came before. h2 over the updates; held_out_h2 and gaps before and after on what was kept back (None:
    nothing was). left_alone: channels that got worse on windows set aside; worse_held_out: those that got worse on what
    was kept back, and were then left alone too. chosen_pass: whose weights were taken, 0 for none."""

    learned: Residual
    whole: Residual
    condition: Condition | None
    h2: H2
    held_out_h2: tuple[float | None, float | None]
    updates: int
    update_ms: np.ndarray
    before: Gap
    after: Gap
    channels: tuple[str, ...]
    kept: tuple[KeptBack, ...]
    left_alone: tuple[str, ...]
    worse_held_out: tuple[str, ...]
    chosen_pass: int
    seconds: float


Report = Callable[[int, int, float, float], None]  # update, of how many, seconds of data, H2 norm over the last 10 s


@dataclass(frozen=True, eq=False)
class _Exam:
    """The windows of the gap, and how a residual does on them."""

    data: Dataset
    scales: Scales
    settings: Settings
    task: Task

    def error(self, residual: Residual | None) -> np.ndarray:
        """(W, M, C) measured - predicted."""
        data = self.data
        if residual is not None and residual.output_scale.any():
            made = with_residual([b.robot for b in data.blocks], residual)
            blocks = tuple(replace(b, robot=m) for b, m in zip(data.blocks, made, strict=True))
            data = replace(data, blocks=blocks)
        return np.asarray(data.y - predict(data, self.settings)[0])

    def gap(self, residual: Residual | None, windows: np.ndarray) -> Gap:
        return gap_of(self.data, self.scales, self.error(residual), windows)


def train(
    task: Task,
    settings: LearnSettings,
    rng: np.random.Generator,
    report: Report = lambda update, of, seconds, h2: None,
    folder: Path | None = None,
) -> Learned:
    """Learn; with a folder, checkpoints are kept in it, and one of this very call is taken up again.

    Raises BadInput where the runs hold too little to learn from, or the earlier residual is another robot's.
    """
    with threadpool_limits(1):  # nets of this size lose by a second thread
        return _train(task, settings, rng, report, folder)


def _train(
    task: Task, settings: LearnSettings, rng: np.random.Generator, report: Report, folder: Path | None
) -> Learned:
    effects = assemble([task.values], {e.name: task.robots[0].slots(e.name) for e in LIBRARY})
    exam = _exam(task, effects)
    base_error = exam.error(None)
    kept = task.held_out
    if kept is None:
        kept = choose_held_out(exam.data, per_window(exam.data, exam.scales, base_error))
    held = held_out_mask(exam.data, kept)
    aside, set_aside = _set_aside(exam, base_error, held)

    form = form_named(task.form) if task.form else usual_form(task.robots[0])
    grid = exam.data.blocks[0].drive.dt
    step = step_of(form, grid, settings)
    data = _clean(build_dataset(task.runs, task.robots, task.noise, settings.horizon * step), task)
    train_windows = ~overlapping(data, (*kept, *set_aside))
    if train_windows.sum() < FEWEST:
        raise BadInput(
            f"{int(train_windows.sum())} windows of {settings.horizon * step:.3g} s are left to learn from, "
            f"{FEWEST} or more are needed",
            "runs",
            "record longer runs, or learn with a shorter --horizon or --step",
        )
    course, blank = begin(data, form, step, settings, effects, (), train_windows, ~exam.scales.still, rng)
    course, condition = _earlier(task, course, blank, train_windows, rng)
    order = order_of(train_windows, settings.passes, rng)

    trail = _updates(task, course, blank, settings, exam, aside, order, report, folder)
    passes = np.array([exam.gap(_whole(course, blank), aside).total, *trail.pass_gap])
    chosen = int(np.nanargmin(passes))
    learned = blank if chosen == 0 else blank.with_theta(trail.pass_theta[chosen - 1])
    learned, left_alone = _spared(exam, form, course, learned, aside)
    worse: tuple[str, ...] = ()
    before = exam.gap(None, held if held.any() else ~held)
    if held.any():
        learned, worse = _spared(exam, form, course, learned, held)
    after = exam.gap(_whole(course, learned), held if held.any() else ~held)
    return Learned(
        learned,
        _whole(course, learned),
        condition,
        summary(trail.h2, step),
        _held_out_h2(task, course, blank, learned, kept),
        trail.update,
        trail.update_ms,
        before,
        after,
        exam.data.channels,
        kept,
        left_alone,
        worse,
        chosen,
        float(train_windows.sum() * settings.horizon * step * settings.passes),
    )


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


def _clean(data: Dataset, task: Task) -> Dataset:
    return with_outliers_removed(data, find_outliers(data).flagged) if task.leaves_out_outliers else data


def _exam(task: Task, effects: Settings) -> _Exam:
    raw = build_dataset(task.runs, task.robots, task.noise, task.gap_horizon)
    return _Exam(_clean(raw, task), measure_scales(raw), effects, task)


def _set_aside(exam: _Exam, error: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, tuple[KeptBack, ...]]:
    """Windows (W,) that choose the pass and the channels; none of them is learned from, none kept back. Where the runs
    are too short for that, the windows that are learned from choose."""
    rest = exam.data.take(~held)
    kept = choose_held_out(rest, per_window(rest, exam.scales, error[~held]))
    mask = np.zeros(exam.data.count, dtype=bool)
    if kept:
        mask = held_out_mask(exam.data, kept) & ~held
    return (mask, kept) if mask.any() else (~held, ())


def _whole(course: Course, learned: Residual) -> Residual:
    return total((*course.fixed, learned))


def _earlier(
    task: Task, course: Course, blank: Residual, windows: np.ndarray, rng: np.random.Generator
) -> tuple[Course, Condition | None]:
    """The course with the earlier residual standing still, where the paper's condition holds on these runs."""
    if task.earlier is None:
        return course, None
    check_alike(task.earlier, blank, task.earlier_file)
    some = np.flatnonzero(windows)
    some = np.sort(rng.permutation(some)[:100])
    norms = [np.concatenate([h2_of(course, r, int(w)) for w in some]) for r in (blank, task.earlier)]
    condition = Condition(*(float(np.nanmean(n)) if np.isfinite(n).any() else float("inf") for n in norms))
    return (replace(course, fixed=(task.earlier,)) if condition.holds else course), condition


def _updates(
    task: Task,
    course: Course,
    blank: Residual,
    settings: LearnSettings,
    exam: _Exam,
    aside: np.ndarray,
    order: np.ndarray,
    report: Report,
    folder: Path | None,
) -> disk.Checkpoint:
    """All updates, from the last checkpoint of this very call on."""
    each = len(order) // settings.passes
    path = None if folder is None else folder / "checkpoint.npz"
    call = disk.fingerprint(
        course.data.y, course.data.start, *(b.drive.command for b in course.data.blocks), repr(task.values), task.case,
        blank.theta, blank.input_scale, blank.output_scale, *(r.theta for r in course.fixed), settings, order,
        blank.inputs, blank.form, blank.step,
    )  # fmt: skip
    at = None if path is None else disk.resume(path, call)
    if at is None:
        nothing = np.empty(0)
        error = first_error(course, np.isin(np.arange(course.data.count), order))
        at = disk.Checkpoint(0, prior(blank, settings), error, nothing, nothing, nothing, np.empty((0, blank.net.size)))
    h2, ms = [at.h2], [at.update_ms]
    recent = list(at.h2[-500:])
    for p in run(course, blank, at.belief, at.error, order, settings, at.update):
        h2.append(p.h2)
        ms.append(np.array([p.update_ms]))
        recent = [*recent, *p.h2][-max(1, round(10.0 / blank.step)) :]
        ended = p.update % each == 0
        if ended or p.update % SAVE_EVERY == 0:
            gaps, thetas = at.pass_gap, at.pass_theta
            if ended:
                now = exam.gap(_whole(course, blank.with_theta(p.belief.mean)), aside).total
                gaps, thetas = np.append(gaps, now), np.vstack([thetas, p.belief.mean])
            h2, ms = [np.concatenate(h2)], [np.concatenate(ms)]
            at = disk.Checkpoint(p.update, p.belief, p.error, h2[0], ms[0], gaps, thetas)
            if path is not None:
                disk.save(path, call, at)
        good = [x for x in recent if np.isfinite(x)]
        report(p.update, len(order), p.seconds, float(np.mean(good)) if good else float("nan"))
    return at


def _spared(
    exam: _Exam, form: Form, course: Course, learned: Residual, windows: np.ndarray
) -> tuple[Residual, tuple[str, ...]]:
    """The residual with the outputs switched off that make a channel worse on these windows, and those channels."""
    base = exam.gap(_whole(course, learned.without(learned.outputs)), windows).channels
    worse: list[str] = []
    for _ in range(len(learned.outputs)):
        if not learned.output_scale.any():
            break
        now = exam.gap(_whole(course, learned), windows).channels
        off = [c for k, c in enumerate(exam.data.channels) if now[k] > base[k]]
        moving = {o for c in off for o in form.moved_by(exam.data.blocks[0].robot, c)}
        moving = {o for o, s in zip(learned.outputs, learned.output_scale, strict=True) if o in moving and s > 0}
        if not moving:
            break
        worse += [c for c in off if c not in worse]
        learned = learned.without(tuple(moving))
    return learned, tuple(worse)


def _held_out_h2(
    task: Task, course: Course, blank: Residual, learned: Residual, kept: Sequence[KeptBack]
) -> tuple[float | None, float | None]:
    rows = np.flatnonzero(overlapping(course.data, kept))
    if not len(rows):
        return None, None
    alone = replace(course, fixed=())
    before = mean_of([h2_of(alone, blank, int(w)) for w in rows])
    return before, mean_of([h2_of(course, learned, int(w)) for w in rows])
