"""The whole diagnosis, in order: gap, where, which, how far."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from residual_mpc.diagnosis.causes import causes_of, most_sure
from residual_mpc.diagnosis.conditions import moved, notes, setup
from residual_mpc.diagnosis.contenders import alternatives, candidates, rival_sets
from residual_mpc.diagnosis.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit import Fit, fit_all
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Scales, gap_of, measure_scales, per_window
from residual_mpc.diagnosis.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.how_far import Shrink, expected_errors, foretold, shrink_of
from residual_mpc.diagnosis.learner import RidgeLearner
from residual_mpc.diagnosis.next_experiment import next_experiment
from residual_mpc.diagnosis.problem import Problem, build_problem, part_of
from residual_mpc.diagnosis.records import Diagnosis, GapFigures, Verdict
from residual_mpc.diagnosis.remainder import NOTHING, Learner, learn, remainder_of
from residual_mpc.diagnosis.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.replays import Replays
from residual_mpc.diagnosis.rest.describe import describe
from residual_mpc.diagnosis.rest.resemblance import resembles
from residual_mpc.diagnosis.rivals import Rivalry, find_rivals
from residual_mpc.diagnosis.search import Ruler, search, without
from residual_mpc.diagnosis.search_settings import SearchSettings
from residual_mpc.diagnosis.space import Space, build_space
from residual_mpc.diagnosis.spikes import Outliers, find_outliers
from residual_mpc.diagnosis.stages import staged
from residual_mpc.diagnosis.testable import not_testable
from residual_mpc.diagnosis.thinning import evenly, floor_draws, thin, well_begun
from residual_mpc.diagnosis.where import locate
from residual_mpc.diagnosis.witness import contradicted, witnesses
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Term, Values

Progress = Callable[[str, float], None]
POLISH, POLISH_TOLERANCE = 24, 1e-6  # steps and relative gain at which the last fit ends
LAST = 2  # of these steps that are on all windows, where there are too many for all
FEW = 4  # draws of the noise that tell what of a remainder is noise
LUCK = 4.0  # standard deviations of a perfect model's squared gap that chance is allowed


@dataclass(frozen=True)
class Options:
    """horizon s; only, without: effect names; held_out: what is kept back (None: chosen); search: see SearchSettings.

    search_steps: simulation steps that one hypothesis may cost in the search (windows are thinned evenly to that);
    final_steps: likewise in the last fit but for its last steps, and half of it in the shares of the stages; a perfect
    model may cost 24 times that.
    floor_margin: a gap within this factor of the noise floor is no gap; on development seeds perfect wheeled robots
    came within 1.1.
    """

    horizon: float = 1.0
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    held_out: tuple[KeptBack, ...] | None = None
    search_steps: int = 16_000
    final_steps: int = 100_000
    floor_margin: float = 1.25
    search: SearchSettings = field(default_factory=SearchSettings)


@dataclass(frozen=True)
class Made:
    """A diagnosis and what the report draws: errors (W, M, C) of all windows before and after, and the predictions."""

    diagnosis: Diagnosis
    data: Dataset
    scales: Scales
    before: np.ndarray
    after: np.ndarray
    held: np.ndarray


def diagnose(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: dict[str, float],
    tunable: Sequence[str],
    options: Options,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
    learners: Sequence[Learner] = (RidgeLearner(),),
) -> Made:
    """robots[i] is the nominal model of runs[i]; learners: who is asked what can be learned of the rest.

    Raises BadInput where nothing can be compared.
    """
    progress("cutting the runs into windows", 0.02)
    raw = build_dataset(runs, robots, noise, options.horizon)
    scales = measure_scales(raw)
    outliers = find_outliers(raw)
    clean = with_outliers_removed(raw, outliers.flagged)
    kept = options.held_out
    if kept is None:
        kept = choose_held_out(raw, per_window(raw, scales, raw.y - predict(raw, Settings(1))[0]))
    held = held_out_mask(raw, kept)

    fitting = clean.take(~held)
    space = build_space(fitting, tunable, options.only, options.without)
    progress("searching for effects", 0.1)
    # a step of a small robot costs less: a servo on the bench is looked at more closely than an arm
    budget = int(options.search_steps * np.clip(6.0 / len(space.robot.states), 1.0, 2.0))
    few = well_begun(thin(fitting, budget), scales, rng)
    by_noise = build_problem(few, space, few.sigma)
    found = search(
        by_noise,
        scales,
        options.search,
        rng,
        lambda text, done: progress(text, 0.1 + 0.5 * done),
    )
    progress("comparing with rival explanations", 0.6)
    rivalry = find_rivals(found)
    untestable = not_testable(by_noise, found.base, rivalry.fit.terms)

    progress("fitting on all windows", 0.75)
    problem = build_problem(fitting, space, 1.0 / found.problem.weight)  # with the weights of the search
    final, base = polish(problem, [rivalry.fit.values, found.base.values], options.final_steps)
    before_fit = raw.take(~held)
    final, vetoed = _heed_witnesses(problem, final, options)
    with_outliers = _wanted(outliers, options) and (
        outliers.frequent or _weigh(before_fit, fitting, scales, space.settings([final.values]), rng, options)
    )
    progress("stating the expected shrink", 0.85)
    base_error = before_fit.y - predict(before_fit, space.settings([base.values]))[0]
    explained = bool(final.terms) or with_outliers
    expected = None
    if explained:
        kept_back = raw.take(held) if held.any() else before_fit
        after = expected_errors(fitting if with_outliers else before_fit, space, final)
        expected = foretold(before_fit, kept_back, scales, base_error, after, rng)

    progress("opening the held-out windows", 0.9)
    return _judge(
        raw, clean, scales, held, kept, space, problem, base, final, rivalry, untestable, outliers, with_outliers,
        expected, vetoed, options, rng, learners,
    )  # fmt: skip


def polish(problem: Problem, starts: list[Values], steps: int) -> list[Fit]:
    """Fit to the end: on `steps` simulation steps' worth of windows, evenly spread, and the last steps on all."""
    few = evenly(problem.data, steps)
    if few.all():
        return fit_all(problem, starts, POLISH, POLISH_TOLERANCE, secants=0)
    near = fit_all(part_of(problem, few), starts, POLISH, POLISH_TOLERANCE, rough=True)
    return fit_all(problem, [f.values for f in near], LAST, POLISH_TOLERANCE, secants=0)


def _heed_witnesses(problem: Problem, final: Fit, options: Options) -> tuple[Fit, tuple[Term, ...]]:
    """The fit without the effects that the encoders contradict, and those."""
    if not final.terms or not witnesses(problem.data):
        return final, ()
    rows = [final.values, *(without(final.values, t) for t in final.terms)]
    after, *less = predict(problem.data, problem.space.settings(rows))
    bad = contradicted(problem.data, after, np.stack(less))
    vetoed = tuple(t for t, b in zip(final.terms, bad, strict=True) if b)
    if not vetoed:
        return final, ()
    left = final.values
    for t in vetoed:
        left = without(left, t)
    return polish(problem, [left], options.final_steps)[0], vetoed


def _wanted(outliers: Outliers, options: Options) -> bool:
    name = "sensor_outliers"
    return outliers.enough and (not options.only or name in options.only) and name not in options.without


def _weigh(
    spoilt: Dataset, clean: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, options: Options
) -> bool:
    """Whether the flagged samples, few as they are, make up much of what the effects leave: the search's own terms."""
    keep = evenly(clean, options.final_steps)
    spoilt, clean = spoilt.take(keep), clean.take(keep)
    left, cleaned = (gap_of(d, scales, d.y - predict(d, row)[0]).total ** 2 for d in (spoilt, clean))
    floor = float(np.mean([gap_of(clean, scales, e).total ** 2 for e in noise_errors(clean, row, rng, 4)]))
    worth = max(options.search.over_floor * floor, options.search.sizeable * (left - floor))
    return left - cleaned > worth


def _judge(
    raw: Dataset,
    clean: Dataset,
    scales: Scales,
    held: np.ndarray,
    kept: tuple[KeptBack, ...],
    space: Space,
    problem: Problem,
    base: Fit,
    final: Fit,
    rivalry: Rivalry,
    untestable: tuple,  # type: ignore[type-arg]
    outliers: Outliers,
    with_outliers: bool,
    expected: Shrink | None,
    vetoed: tuple[Term, ...],
    options: Options,
    rng: np.random.Generator,
    learners: Sequence[Learner],
) -> Made:
    after_data = clean if with_outliers else raw
    rows = space.settings([{}, base.values, final.values])
    nominal_p, base_p, final_p = predict(raw, rows)
    after_p = predict(after_data, rows)[2]
    errors = {"nominal": raw.y - nominal_p, "before": raw.y - base_p, "after": after_data.y - after_p}
    test = held if held.any() else np.ones(raw.count, dtype=bool)
    floors = noise_errors(after_data, space.settings([final.values]), rng, floor_draws(after_data, options.final_steps))
    draws = np.square([gap_of(after_data, scales, e, test).total for e in floors])
    floor = float(np.sqrt(draws.mean()))
    draws_everywhere = np.square([gap_of(after_data, scales, e).total for e in floors])
    floor_everywhere = float(np.sqrt(draws_everywhere.mean()))
    g = {k: gap_of(raw, scales, e, test) for k, e in errors.items()}
    everywhere = {k: gap_of(raw, scales, e).total for k, e in errors.items()}

    explained = bool(final.terms) or with_outliers
    helps = explained and g["after"].total < g["before"].total
    verdict: Verdict
    if not helps:
        # beyond the noise everywhere, and on the very windows that the figures are printed for
        beyond = everywhere["before"] > max(options.floor_margin * floor_everywhere, _with_luck(draws_everywhere))
        beyond &= g["before"].total > _with_luck(draws)
        verdict = "unknown" if beyond else "no_gap"
        share = 0.0 if verdict == "no_gap" else 1.0
    else:
        excess = max(g["before"].total ** 2 - floor**2, 1e-12)
        share = float(np.clip((g["after"].total ** 2 - floor**2) / excess, 0.0, 1.0))
        verdict = "effects" if share <= 0.25 else "partial"
    if not helps:
        errors["after"], g["after"] = errors["before"], g["before"]
        after_p = base_p
    achieved = shrink_of(raw.take(test), scales, errors["before"][test], errors["after"][test], rng) if helps else None

    # what a perfect model might have left under this noise is not worth a learner's time
    worth = verdict in ("partial", "unknown") or g["after"].total > max(options.floor_margin * floor, _with_luck(draws))
    learned, rest = NOTHING, None
    if worth and verdict != "no_gap":
        seen, current = (after_data, final) if helps else (raw, base)
        row = space.settings([current.values])
        if held.any():
            left = remainder_of(seen, scales, row, after_p, errors["after"], held)
            learned = learn(left, learners, rng.spawn(1)[0])
        like = resembles(problem, current, vetoed, Ruler(Replays(seen.take(test), space), scales, floor**2))
        unspoilt = np.where(np.isfinite(clean.y), errors["after"], np.nan)
        rest = describe(seen, scales, row, after_p, unspoilt, floors[:FEW], like, rng.spawn(1)[0])
    sure = most_sure(verdict, share)
    causes = causes_of(final, problem, rivalry, outliers, with_outliers, share, sure) if helps else ()
    gaps = everywhere["before"], everywhere["after"], floor_everywhere
    steps, stages = staged(after_data, scales, space, final if helps else None, gaps, options.final_steps // 2)
    channel_floor = np.sqrt(np.mean([gap_of(after_data, scales, e, test).channels ** 2 for e in floors], axis=0))
    figures = GapFigures(
        nominal=g["nominal"].total,
        before=g["before"].total,
        after=g["after"].total,
        noise_floor=floor,
        horizon=options.horizon,
        windows=int(test.sum()),
        skipped=raw.skipped,
        still=tuple(c for c, s, m in zip(raw.channels, scales.still, scales.compared, strict=True) if s and m),
        channels={
            c: (float(g["before"].channels[k]), float(g["after"].channels[k]), float(channel_floor[k]))
            for k, c in enumerate(raw.channels)
            if not scales.still[k]
        },
    )
    groups = tuple(g for g in rivalry.groups if not any(t in vetoed for m in g for t in m)) if helps else ()
    others = alternatives(rivalry, groups, final) if helps else ()
    diagnosis = Diagnosis(
        robot=space.robot.name,
        verdict=verdict,
        held_out=kept if held.any() else (),
        gap=figures,
        expected=expected if helps else None,
        achieved=achieved,
        stages=stages,
        where=locate(raw, scales, errors["before"]),
        causes=causes,
        candidates=candidates(rivalry, base, final, sure) if helps else (),
        groups=groups,
        rivals=rival_sets(rivalry) if helps else (),
        alternatives=others,
        setup=setup(raw, dispersion(final, blocks_of(problem.data))),
        not_testable=untestable,
        moved=moved(base, final) if helps else (),
        unexplained=share,
        learned=learned,
        rest=rest,
        steps=steps,
        outlier_share=outliers.share if with_outliers else 0.0,
        outlier_channels={c: s for c, s in outliers.shares.items() if s > 0} if with_outliers else {},
        next_experiment=next_experiment(
            (*groups, *((a.instead_of, a.terms) for a in others if not a.confounded)),
            wheeled="left" in raw.blocks[0].robot.actuators,
            verdict=verdict,
        ),
        values=final.values if helps else base.values,
        notes=notes(raw, held, outliers, with_outliers, vetoed, final),
    )
    return Made(diagnosis, raw, scales, errors["before"], errors["after"], test)


def _with_luck(draws: np.ndarray) -> float:
    """The gap that noise hardly ever exceeds, from squared gaps that it alone made."""
    return float(np.sqrt(draws.mean() + LUCK * draws.std(ddof=1)))
