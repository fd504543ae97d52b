"""The whole diagnosis, in order: gap, where, which, how far."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from residual_mpc.diagnosis.causes import causes_of, most_sure
from residual_mpc.diagnosis.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit import Fit, fit_all
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Scales, gap_of, measure_scales, per_window
from residual_mpc.diagnosis.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.how_far import Shrink, expected_errors, foretold, shrink_of
from residual_mpc.diagnosis.learner import RidgeLearner
from residual_mpc.diagnosis.next_experiment import next_experiment
from residual_mpc.diagnosis.problem import Problem, build_problem, reweigh, start_sensitivity
from residual_mpc.diagnosis.records import (
    Alternative,
    Candidate,
    Diagnosis,
    GapFigures,
    Moved,
    Setup,
    Verdict,
)
from residual_mpc.diagnosis.remainder import NOTHING, Learner, learn, remainder_of
from residual_mpc.diagnosis.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.rivals import Rivalry, find_rivals
from residual_mpc.diagnosis.screen import shorten
from residual_mpc.diagnosis.search import SearchSettings, search, without
from residual_mpc.diagnosis.space import Space, build_space
from residual_mpc.diagnosis.spikes import Outliers, find_outliers
from residual_mpc.diagnosis.stages import shapley, squared_gaps, stage_shares
from residual_mpc.diagnosis.testable import not_testable
from residual_mpc.diagnosis.where import locate
from residual_mpc.diagnosis.witness import contradicted
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Settings, Term

Progress = Callable[[str, float], None]
POLISH, POLISH_TOLERANCE = 24, 1e-6  # steps and relative gain at which the last fit ends
FLOOR_DRAWS = 24  # the floor hangs on a few windows with poorly measured starts: three draws scatter by a fifth
LUCK = 4.0  # standard deviations of a perfect model's squared gap that chance is allowed
POOR_START = 25.0  # times the median of the windows' squared noise
FEWEST = 32  # windows that a search looks at, however small the steps


@dataclass(frozen=True)
class Options:
    """horizon s; only, without: effect names; held_out: what is kept back (None: chosen); search_steps: simulation
    steps that one hypothesis may cost in the search (windows are thinned evenly to that); search: see SearchSettings.

    floor_margin: a gap within this factor of the noise floor is no gap; on development seeds perfect wheeled robots
    came within 1.1.
    """

    horizon: float = 1.0
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    held_out: tuple[KeptBack, ...] | None = None
    search_steps: int = 16_000
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
    found = search(
        build_problem(few, space, few.sigma),
        scales,
        options.search,
        rng,
        lambda text: progress(text, 0.35),
    )
    progress("comparing with rival explanations", 0.6)
    rivalry = find_rivals(found)
    untestable = not_testable(build_problem(few, space, few.sigma), found.base, rivalry.fit.terms)

    progress("fitting on all windows", 0.75)
    problem = problem_like(fitting, space, found.problem)
    final, base = fit_all(problem, [rivalry.fit.values, found.base.values], POLISH, POLISH_TOLERANCE)
    before_fit = raw.take(~held)
    final, vetoed = _heed_witnesses(problem, final)
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


def problem_like(data: Dataset, space: Space, like: Problem) -> Problem:
    """The problem on other windows with the weights of one that is there."""
    return reweigh(data, space, start_sensitivity(data, space, {}), 1.0 / like.weight)


def thin(data: Dataset, steps: int) -> Dataset:
    """Less to replay, so that one hypothesis costs at most about `steps` simulation steps: windows cut to their first
    half, and evenly fewer of them."""
    cost = max(b.drive.steps for b in data.blocks)
    if data.count * cost <= steps:
        return data
    if data.count * cost > 2 * steps:
        data, cost = shorten(data, 0.5), (cost + 1) // 2
    keep = np.zeros(data.count, dtype=bool)
    keep[np.unique(np.linspace(0, data.count - 1, max(FEWEST, steps // cost)).round().astype(int))] = True
    return data.take(keep)


def well_begun(data: Dataset, scales: Scales, rng: np.random.Generator) -> Dataset:
    """Without the windows whose start is so poorly measured (dropouts, few samples) that noise alone explains them."""
    noise = per_window(data, scales, noise_errors(data, Settings(1), rng, 1)[0])
    keep = ~(noise > POOR_START * np.nanmedian(noise))
    return data.take(keep) if keep.sum() >= min(FEWEST, data.count) // 2 else data


def _heed_witnesses(problem: Problem, final: Fit) -> tuple[Fit, tuple[Term, ...]]:
    """The fit without the effects that the encoders contradict, and those."""
    if not final.terms:
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
    return fit_all(problem, [left], POLISH, POLISH_TOLERANCE)[0], vetoed


def _wanted(outliers: Outliers, options: Options) -> bool:
    name = "sensor_outliers"
    return outliers.enough and (not options.only or name in options.only) and name not in options.without


def _weigh(
    spoilt: Dataset, clean: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, options: Options
) -> bool:
    """Whether the flagged samples, few as they are, make up much of what the effects leave: the search's own terms."""
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
    floors = noise_errors(after_data, space.settings([final.values]), rng, FLOOR_DRAWS)
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
    learned = NOTHING
    if worth and verdict != "no_gap" and held.any():
        rest, row = (after_data, final.values) if helps else (raw, base.values)
        left = remainder_of(rest, scales, space.settings([row]), after_p, errors["after"], held)
        learned = learn(left, learners, rng.spawn(1)[0])
    sure = most_sure(verdict, share)
    causes = causes_of(final, problem, rivalry, outliers, with_outliers, share, sure) if helps else ()
    subsets = squared_gaps(after_data, scales, space, final.values, final.terms) if helps and final.terms else {}
    steps, stages = _staged(raw, scales, test, errors["before"], everywhere, subsets, final, floor_everywhere, helps)
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
        candidates=_candidates(rivalry, base, final, sure) if helps else (),
        groups=groups,
        rivals=_rival_sets(rivalry) if helps else (),
        alternatives=_alternatives(rivalry, groups, final),
        setup=_setup(raw, dispersion(final, blocks_of(problem.data))),
        not_testable=untestable,
        moved=_moved(base, final) if helps else (),
        unexplained=share,
        learned=learned,
        steps=steps,
        outlier_share=outliers.share if with_outliers else 0.0,
        outlier_channels={c: s for c, s in outliers.shares.items() if s > 0} if with_outliers else {},
        next_experiment=next_experiment(groups, wheeled="left" in raw.blocks[0].robot.actuators),
        values=final.values if helps else base.values,
        notes=_notes(raw, held, outliers, with_outliers, vetoed, final),
    )
    return Made(diagnosis, raw, scales, errors["before"], errors["after"], test)


def _with_luck(draws: np.ndarray) -> float:
    """The gap that noise hardly ever exceeds, from squared gaps that it alone made."""
    return float(np.sqrt(draws.mean() + LUCK * draws.std(ddof=1)))


def _staged(
    raw: Dataset,
    scales: Scales,
    test: np.ndarray,
    before: np.ndarray,
    everywhere: dict[str, float],
    subsets: dict[frozenset[Term], float],
    final: Fit,
    floor: float,
    helps: bool,
) -> tuple[tuple[tuple[tuple[Term, ...], float], ...], tuple[tuple[str, float], ...]]:
    """The gap after each effect is added (largest first), and the stages' shares; over all windows."""
    start = everywhere["before"]
    if not helps:
        noise = min(floor, start) ** 2 / max(start**2, 1e-30)
        return (((), start),), (("unexplained", 1.0 - noise), ("noise", noise))
    drops = shapley(subsets, final.terms) if subsets else {}
    steps: list[tuple[tuple[Term, ...], float]] = [((), start)]
    for n in range(1, len(final.terms) + 1):
        order = sorted(final.terms, key=lambda t: -drops[t])[:n]
        steps.append((tuple(order), float(np.sqrt(subsets[frozenset(order)]))))
    flagged = max(start**2 - subsets[frozenset()], 0.0) if subsets else start**2 - everywhere["after"] ** 2
    return tuple(steps), stage_shares(drops, everywhere["after"], floor, flagged)


def _candidates(rivalry: Rivalry, base: Fit, final: Fit, sure: float) -> tuple[Candidate, ...]:
    """Every term that was seriously compared, with its probability and what the fit with it leaves."""
    costs: dict[Term, float] = dict.fromkeys(final.terms, final.cost)
    for r in rivalry.rivals:
        for t in r.came:
            costs.setdefault(t, r.fit.cost * final.cost / max(rivalry.fit.cost, 1e-12))
    for t in rivalry.shares:  # what a group's first member took the place of
        costs.setdefault(t, final.cost)
    out = [
        Candidate(t, sure * rivalry.shares.get(t, 0.0), float(1.0 - np.sqrt(max(c, 0.0) / max(base.cost, 1e-12))))
        for t, c in costs.items()
    ]
    return tuple(sorted(out, key=lambda c: -c.probability))


def _rival_sets(rivalry: Rivalry) -> tuple[tuple[tuple[Term, ...], float], ...]:
    weights = [(rivalry.fit.terms, 1.0)]
    weights += [(r.fit.terms, float(np.exp(-0.5 * np.clip(r.ratio, 0.0, 200.0)))) for r in rivalry.rivals]
    total = sum(w for _, w in weights)
    ranked = sorted(((t, w / total) for t, w in weights), key=lambda tw: -tw[1])
    return tuple(ranked[:6])


def _alternatives(
    rivalry: Rivalry, groups: tuple[tuple[tuple[Term, ...], ...], ...], final: Fit
) -> tuple[Alternative, ...]:
    """The other members of the groups, each with the values of the whole in which it stands."""
    out: dict[tuple[Term, ...], Alternative] = {}
    for group in groups:
        for member in group:
            fit = rivalry.standing_for(member)
            if fit is not None and not all(t in final.terms for t in member):
                out[member] = Alternative(member, fit.values)
    return tuple(out.values())


def _setup(data: Dataset, spread: float) -> Setup:
    runs, actuators = data.runs, data.blocks[0].robot.actuators
    sent = {a: np.concatenate([r.columns[f"command.{a}"] for r in runs]) for a in actuators}
    first = {c: [s.y[0] for (_, name), s in data.signals.items() if name == c and len(s.y)] for c in data.channels}
    return Setup(
        period=float(np.median([r.period for r in runs])),
        commands={a: (float(np.nanmin(u)), float(np.nanmax(u))) for a, u in sent.items()},
        sigma={c: float(s) for c, s in zip(data.channels, data.sigma, strict=True)},
        start={c: float(np.median(v)) for c, v in first.items() if v},
        switches=any(b.drive.enabled is not None for b in data.blocks),
        dispersion=max(float(spread), 1.0),
    )


def _moved(base: Fit, final: Fit) -> tuple[Moved, ...]:
    return tuple(Moved(k.parameter, base.values[k], final.values[k]) for k in base.knobs if k.effect == TUNE)


def _notes(
    raw: Dataset, held: np.ndarray, outliers: Outliers, with_outliers: bool, vetoed: tuple[Term, ...], final: Fit
) -> tuple[str, ...]:
    notes = []
    if vetoed:
        notes.append(
            f"{', '.join(map(str, vetoed))} would close the gap, but the wheels' encoders read what it would have to "
            "make up for: the cause lies before them."
        )
    if not held.any():
        notes.append("The runs are too short to keep windows back: every figure is on windows that the fit has seen.")
    if raw.skipped:
        notes.append(
            f"{raw.skipped} windows were skipped: a measured channel has no sample within 0.25 s of their start."
        )
    if outliers.count and not with_outliers:
        notes.append(f"{outliers.count} samples jump away; they are left out of the fit, not of the gap.")
    for knob, rests in zip(final.knobs, final.held, strict=True):
        if rests and (knob.effect == TUNE or knob.term in final.terms):
            what = knob.parameter if knob.effect == TUNE else f"{knob.parameter} of {knob.term}"
            notes.append(
                f"{what} rests on the end of what is tried, {final.values[knob]:.3g}: its "
                "interval says nothing, and something else may be the cause."
            )
    notes.append(
        "Effects outside the library cannot be named; intervals hold for the named effects being the true ones."
    )
    return tuple(notes)
