"""The gap over several horizons, and what a forecast of constant velocity would score: parts of the gap's section."""

from dataclasses import dataclass

from residual_mpc.report.sections.section import Document
from residual_mpc.report.words.gaps import Gap, first_of, horizons_of, last_of, window_gaps
from residual_mpc.report.words.numbers import number

ARROW = " \N{RIGHTWARDS ARROW} "


READABLE = 4.0  # times the longest bar, beyond which a reference is said and not drawn


@dataclass(frozen=True)
class Row:
    """One horizon. after: None where no effect is named; quantiles: of the windows' gaps, "before → after" each."""

    horizon: float
    before: float
    after: float | None
    noise_floor: float
    windows: int | None
    held_out: bool
    quantiles: tuple[str, str, str] | None  # p50, p90, max
    channels: list[Document]  # largest gap first


def horizon_rows(gap: Gap, explained: bool) -> list[Row]:
    """The horizons of a document, the headline one first."""
    return [_row(one, explained) for one in horizons_of(gap)]


def channel_rows(gap: Gap) -> list[Document]:
    """The channels of one horizon, the one with the largest gap first."""
    rows = [{"name": name, **values} for name, values in (gap.get("channels") or {}).items()]
    return sorted(rows, key=lambda channel: -channel["before"])


def scale(gap: Gap, longest: float) -> float:
    """What a full bar stands for: the longest one, or the forecast of constant velocity where that still leaves the
    bars readable."""
    constant = gap.get("constant_velocity") or 0.0
    return max(longest, constant if constant <= READABLE * longest else 0.0) or 1.0


def reference(gap: Gap, largest: float) -> Document | None:
    """Where the forecast of constant velocity stands among bars of which the longest is `largest`; `at`: % of the
    width, None where it is off the scale."""
    value = gap.get("constant_velocity")
    if value is None:
        return None
    return {"value": value, "at": None if value > largest else 100.0 * value / largest}


def _row(gap: Gap, explained: bool) -> Row:
    return Row(
        horizon=gap["horizon"],
        before=first_of(gap),
        after=last_of(gap) if explained else None,
        noise_floor=gap["noise_floor"],
        windows=gap.get("windows"),
        held_out=gap.get("held_out") is not False,
        quantiles=_quantiles(gap, explained),
        channels=channel_rows(gap),
    )


def _quantiles(gap: Gap, explained: bool) -> tuple[str, str, str] | None:
    told = [window_gaps(gap, last) for last in ((False, True) if explained else (False,))]
    some = [q for q in told if q is not None]
    if not some:
        return None
    half, most, worst = (ARROW.join(number(q[key], 2) for q in some) for key in ("p50", "p90", "max"))
    return half, most, worst
