"""A diagnosis and a measured gap as lines for a terminal."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.effects import DIVISIONS, numbers_of, sizes_words
from residual_mpc.report.words.gaps import (
    few_windows,
    floor_matters,
    horizon_line,
    horizons_of,
    new_readings_line,
    warnings,
)
from residual_mpc.report.words.groups import group_sentence
from residual_mpc.report.words.numbers import count, measure_interval, number, percent, percent_interval, plain
from residual_mpc.report.words.rest import rest_sentence
from residual_mpc.report.words.servo import motor_lines, servo_lines
from residual_mpc.report.words.summary import sentence, unseen
from residual_mpc.report.words.uncertain import by_certainty, told_groups, uncertain_line

Document = Mapping[str, Any]


def diagnosis_lines(document: Document) -> list[str]:
    """The verdict, then a line for each figure, cause, doubt and note that a reader needs."""
    explained = bool(document["explanation"])
    gap = document["gap"]
    shown, uncertain = by_certainty(document)
    details = [
        *(horizon_line(one, explained) for one in horizons_of(gap)),
        *_new_readings(gap, explained),
        *_reference(gap),
        *_doubts(gap, explained),
        *_shrink(document),
        *(line for effect in shown for line in (_cause(effect), *_sizes(effect), *_motor(effect))),
        *([uncertain_line(uncertain)] if uncertain else []),
        *servo_lines(document, {effect["effect"] for effect in uncertain}),
        *(group_sentence(group, document) for group in told_groups(document, uncertain)),
    ]
    if document.get("unlike_the_rest"):
        details.append(document["unlike_the_rest"]["note"])
    elif document.get("odd_run"):
        details.append(document["odd_run"]["note"])
    if document.get("remainder"):
        details.append(rest_sentence(document["remainder"]))
    headline = document.get("verdict_sentence") or sentence(document)
    return [plain(headline), *(f"  {plain(line)}" for line in details)]


def gap_lines(gap: Document) -> list[str]:
    """What `gap --json` prints, in words: the horizons, then the channels of the headline one."""
    other = gap["model"] is not None
    first, *longer = horizons_of(gap)
    lines = [horizon_line({**first, "windows": gap["windows"]}, other)]
    for name, c in gap["channels"].items():
        arrow = "" if c["model"] is None else f" -> {number(c['model'])}"
        lines.append(f"  {name:<24} {number(c['nominal'])}{arrow}  (noise floor {number(c['noise_floor'], 2)})")
    lines += [horizon_line(one, other) for one in longer]
    lines += _new_readings(gap, other)
    lines += _reference(gap)
    lines += _left_out(gap, other)
    lines += _doubts(gap, other)
    if not other and not gap.get("noise_stated", True) and floor_matters(gap):
        lines.append("the noise floor is estimated from these runs; if the sensor noise is known, put it under [noise]")
    if gap["still"]:
        lines.append(f"left out since they hardly move: {', '.join(gap['still'])}")
    if gap["skipped"]:
        lines.append(f"{count(gap['skipped'], 'window')} skipped: no sample within 0.25 s of the start")
    return [plain(line) for line in lines]


def _new_readings(gap: Document, explained: bool) -> list[str]:
    line = new_readings_line(gap, explained)
    return [line] if line else []


def _reference(gap: Document) -> list[str]:
    constant = gap.get("constant_velocity")
    return [] if constant is None else [f"gap of a constant-velocity forecast: {number(constant)}"]


def _left_out(gap: Document, explained: bool) -> list[str]:
    """The gap without the windows across gaps and incidents of the log, if there are any."""
    lost = gap.get("left_out_of_fits") or {"windows": 0}
    if not lost["windows"]:
        return []
    without = number(lost["nominal_without"]) + (f" -> {number(lost['model_without'])}" if explained else "")
    return [f"without the {count(lost['windows'], 'window')} across gaps or incidents of the log: {without}"]


def _doubts(gap: Document, explained: bool) -> list[str]:
    few = [text for one in horizons_of(gap) if (text := few_windows(one, explained))]
    return [*warnings(gap, explained), *few[:1]]


def _shrink(document: Document) -> list[str]:
    shrink = document.get("shrink")
    if not shrink:
        return []
    achieved = f"achieved {percent(shrink['value'])} on {unseen(document['held_out'])}"
    if shrink.get("expected") is None:
        return [f"shrink {achieved}"]
    return [f"shrink expected {percent(shrink['expected'])} ({percent_interval(shrink['expected_ci95'])}), {achieved}"]


def _cause(effect: Document) -> str:
    numbers = [
        f"{name} = {measure_interval(p['value'], p.get('ci95'), p.get('unit', '1'))}{_remark(p)}"
        for name, p in numbers_of(effect).items()
    ]
    named = f"{effect['effect']} [{effect['target']}]" if effect.get("target") else str(effect["effect"])
    sure = effect.get("probability")
    parts = [*numbers, *([] if sure is None else [f"probability {sure:.2f}"])]
    return f"{named}: {', '.join(parts)}{_remark(effect)}"


def _sizes(effect: Document) -> list[str]:
    return [f"  {sizes_words(effect)}"] if any(effect.get(d) for d in DIVISIONS) else []


def _motor(effect: Document) -> list[str]:
    return [f"  {line}" for line in motor_lines(effect)]


def _remark(entry: Document) -> str:
    return f" ({entry['note']})" if entry.get("note") else ""
