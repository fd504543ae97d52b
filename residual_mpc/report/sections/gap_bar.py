"""The gap before and after as one bar, beside what gives its length a meaning: the noise floor, a tenth of the motion,
and a forecast that knows no model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.report.sections.horizons import reference, scale
from residual_mpc.report.sections.section import Document
from residual_mpc.report.words.numbers import percent

TENTH = 0.1  # of the motion: a gap that a controller still lives with
MIDDLE = 45.0  # % of the width, beyond which a label stands to the left of its mark


@dataclass(frozen=True)
class Length:
    """A part of the bar. kind: "nominal", "before" or "after"; share: % of the width."""

    kind: str
    label: str
    gap: float
    share: float


@dataclass(frozen=True)
class Mark:
    """A place on the scale, at % of the width. left: whether its label stands to its left."""

    label: str
    at: float

    @property
    def left(self) -> bool:
        return self.at > MIDDLE


@dataclass(frozen=True)
class GapBar:
    """lengths, longest first, one over the other; marks from right to left; beyond: what is off the scale; says: all
    of it in a sentence."""

    lengths: tuple[Length, ...]
    marks: tuple[Mark, ...]
    beyond: str
    says: str


def gap_bar(document: Document) -> GapBar:
    """The bar of a diagnosis."""
    gap = document["gap"]
    return bar_of(_gaps(document), gap["noise_floor"], gap.get("constant_velocity"))


def bar_of(gaps: Sequence[tuple[str, str, float]], noise_floor: float | None, forecast: float | None) -> GapBar:
    """gaps: (kind, label, gap); forecast: the gap at constant velocity, None where it is not known."""
    known = {} if forecast is None else {"constant_velocity": forecast}
    largest = scale(known, max(*(value for _, _, value in gaps), TENTH))
    marks = [Mark("a tenth of the motion", 100.0 * TENTH / largest)]
    if noise_floor is not None:
        floor = f"noise floor: {percent(noise_floor)}"
        marks.append(Mark(floor, 100.0 * min(noise_floor / largest, 1.0)))
    constant, beyond = reference(known, largest), ""
    if constant is not None:
        text = f"constant velocity: {percent(constant['value'])}"
        if constant["at"] is None:
            beyond = f"Off this scale: {text}."
        else:
            marks.append(Mark(text, constant["at"]))
    lengths = tuple(Length(kind, label, value, 100.0 * value / largest) for kind, label, value in gaps)
    says = "; ".join([f"{label}: {percent(value)}" for _, label, value in gaps] + [mark.label for mark in marks])
    lengths = tuple(sorted(lengths, key=lambda part: -part.gap))
    return GapBar(lengths, tuple(sorted(marks, key=lambda mark: -mark.at)), beyond, says)


def _gaps(document: Document) -> list[tuple[str, str, float]]:
    """(kind, label, gap), from the model as it came to the one with the named effects."""
    figures = document["gap"]
    nominal = figures.get("nominal")
    gaps = [("before", "Nominal model", figures["before"])]
    if nominal is not None and not np.isclose(nominal, figures["before"]):
        gaps = [("nominal", "Nominal model", nominal), ("before", "Nominal model, retuned", figures["before"])]
    if document["explanation"]:
        gaps.append(("after", "With the named effects", figures["after"]))
    return gaps
