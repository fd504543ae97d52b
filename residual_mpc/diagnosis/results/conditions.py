"""What a diagnosis rests on: how its runs were made, the parameters that moved, and the notes to its figures."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import per_window
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.gaps import ExplanationGaps
from residual_mpc.diagnosis.results.odd_run import OddRun, odd_run
from residual_mpc.diagnosis.results.one_encoder import encoder_notes
from residual_mpc.diagnosis.results.records import Moved, Setup
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import beats_forecast, deciding
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.logs.run import Run
from residual_mpc.logs.time_gaps import time_gaps
from residual_mpc.models.settings import TUNE

SMALLER_STEP = (
    'Use a smaller time step, or an implicit integrator if its own is explicit: <option timestep="0.0005" '
    'integrator="implicitfast"/> in an MJCF file, in a URDF, the same element inside <mujoco>.'
)


def _in_parts(of: FittedExplanation) -> list[str]:
    """Effects that act in a part of the runs alone, or have their own size in each run."""
    said = []
    if of.in_parts:
        said.append(
            "Windows that span the instant at which an effect begins or ends, and held-out windows next to it, are "
            "left out of all figures."
        )
    ended = [str(t) for t, v in of.in_parts.items() if v.until is not None]
    if ended:
        said.append(f"No longer acting at the end of the runs, and so left out of model.json: {', '.join(ended)}.")
    said.append(
        "model.json describes the robot at the end of the last run. To train a network on it, use only runs for which "
        "it holds."
    )
    return said


def _left_out(runs: Sequence[Run]) -> list[str]:
    """Gaps and incidents of the logs."""
    said = []
    for what, broken in (
        ("gaps in time, in which commands may be lost: windows across them are left out", [time_gaps(r) for r in runs]),
        ("incidents, see `residual-mpc check`: no fit sees windows across them", [r.incidents for r in runs]),
    ):
        count = sum(len(b) > 0 for b in broken)
        if count:
            verb = "has" if count == 1 else "have"
            said.append(f"{count} of {len(runs)} logs {verb} {what}.")
    return said


def setup(data: Dataset, spread: float) -> Setup:
    """How the runs were driven and measured; spread: how much larger than noise the residuals are."""
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


def moved(base: Fit, final: Fit) -> tuple[Moved, ...]:
    """What each tuned parameter of the model is without the effects, and beside them."""
    return tuple(Moved(k.parameter, base.values[k], final.values[k]) for k in base.knobs if k.effect == TUNE)


def one_run(found: ExplanationGaps) -> OddRun | None:
    """The run that is unlike all others, where much is left; None where there is none."""
    if found.verdict[0] not in ("partial", "unknown"):
        return None
    error = found.errors["after" if found.helps else "before"]
    return odd_run(per_window(found.of.raw, found.of.scales, error), found.of.raw.run)


def notes(
    of: FittedExplanation,
    found: ExplanationGaps,
    odd: Mapping[str, object] | None,
    unlike: Mapping[str, object] | None,
    settings: ResultSettings,
) -> tuple[str, ...]:
    """What a reader has to know before trusting the figures, a sentence each. odd, unlike: the documents of `OddRun`
    and `Unlike`."""
    said = []
    first = found.looks[0]
    if found.useless:
        said.append(
            f"The model is unusable for these runs: over {first.horizon:g} s it predicts worse "
            f"({found.left.total:.2g}) than a constant-velocity forecast ({found.constant_velocity:.2g}), with or "
            "without the effects that were tried."
        )
    elif first.nominal.total > max(found.constant_velocity, settings.gaps.useless):
        said.append(
            f"Without the named effects the model predicts worse ({first.nominal.total:.2g}) than a constant-velocity "
            f"forecast ({found.constant_velocity:.2g})."
        )
    if found.helps and beats_forecast(first, found.constant_velocity) < 0.5 * settings.causes.useful:
        said.append(
            f"Even with the named effects the model predicts little better ({found.left.total:.2g}) than a "
            f"constant-velocity forecast ({found.constant_velocity:.2g}): a large cause is missing, and the named "
            "effects may be compensating for it."
        )
    if found.stepping:
        said.append(
            f"The time step of the model makes errors of {found.step_error or 0.0:.2g} (noise floor "
            f"{first.floor.total:.2g}). {SMALLER_STEP}"
        )
    elif found.step_error is not None and found.step_error > first.floor.total:
        what = "the named effects" if found.coarse and found.helps else "small effects"
        said.append(
            f"The time step of the model makes errors of {found.step_error:.2g} (noise floor {first.floor.total:.2g}); "
            f"{what} may only stand for it. {SMALLER_STEP}"
        )
    if found.helps and any(v < 0.0 for k, v in of.final.values.items() if k.effect == COMMAND_DELAY.name):
        said.append(
            "Commands act before their stamps where a log holds fewer of them than were sent, or stamps them late. "
            "That is a fault of the log, not of the robot: controllers and exports leave it out. Log every command "
            "that is sent."
        )
    said += [str(x["note"]) for x in (odd, unlike) if x is not None]
    if found.helps and (of.in_parts or of.run_sizes):
        said += _in_parts(of)
    if of.doubtful:
        said.append(
            f"{', '.join(map(str, of.doubtful))} improved the fit on the windows of the search, but on all windows the "
            "size is not significantly different from zero."
        )
    if found.helps and of.unlikely:
        said.append(
            f"Left out as unlikely, since the model is hardly better with it: {', '.join(map(str, of.unlikely))}."
        )
    if of.vetoed:
        said.append(
            f"{', '.join(map(str, of.vetoed))} would reduce the gap of the pose, but contradicts the wheel encoders."
        )
    if found.helps:
        said += encoder_notes(of.final.terms, [n.term for n in of.untestable])
    for look in found.looks if found.helps else ():
        if look.unjudged and (look.decides or look is not first):
            some = "1 window" if look.unjudged == 1 else f"{look.unjudged} windows"
            begin, count = ("begins", "It counts") if look.unjudged == 1 else ("begin", "They count")
            why = "already in motion, under load or unlike the rest"
            said.append(
                f"{some} of {look.horizon:g} s {begin} at the start of a run that is {why}: "
                f"what was sent before the first stamp is unknown. {count} in the gap, and not in the verdict."
            )
    for look in deciding(found.looks)[1:] if found.helps else ():
        if look.steady.total > max(AS_GOOD * look.floor.total, settings.gaps.worse * look.before.total):
            said.append(
                f"Over {look.horizon:g} s the named effects make the gap larger, {look.steady.total:.2g} instead of "
                f"{look.before.total:.2g} (noise floor {look.floor.total:.2g}): they do not hold for that long, or "
                "something else compensates for them there."
            )
    if not of.held.any():
        said.append("The runs are too short to hold out windows: all figures are on windows used in the fit.")
    said += _left_out(of.raw.runs)
    if of.raw.skipped:
        some = "1 window was" if of.raw.skipped == 1 else f"{of.raw.skipped} windows were"
        said.append(f"{some} skipped: a measured channel has no sample within 0.25 s of the start.")
    if of.outliers.count and not of.with_outliers:
        some = "1 sample is an outlier" if of.outliers.count == 1 else f"{of.outliers.count} samples are outliers"
        said.append(f"{some}, excluded from the fit but not from the gap.")
    for knob, rests in zip(of.final.knobs, of.final.held, strict=True):
        if rests and (knob.effect == TUNE or knob.term in of.final.terms):
            what = knob.parameter if knob.effect == TUNE else f"{knob.parameter} of {knob.term}"
            said.append(
                f"{what} is at the bound of its search range, {of.final.values[knob]:.3g}: its "
                "interval is not meaningful, and something else may be the cause."
            )
    said.append(
        "Effects outside the library cannot be identified; intervals assume that the named effects are the true causes."
    )
    return tuple(said)
