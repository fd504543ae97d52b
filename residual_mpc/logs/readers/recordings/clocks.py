"""The clocks of a recording: the stamp that a sender put into the header, and the time at which it was received."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from residual_mpc.logs.clock import IntArray
from residual_mpc.logs.readers.table import Remark

Key = TypeVar("Key", bound=Hashable)

NO_STAMP = -1
UNSET = 0.01  # share of header stamps that may be zero or run backwards
REPEATED = 0.2  # share that may repeat the one before
APART = 10_000_000_000  # ns: clocks farther apart do not count from the same zero
OFFSET = 20_000_000  # ns between the clocks of two topics above which there is a warning
DRIFT = 10_000_000  # ns over the recording above which there is a warning
ENOUGH = 20  # messages from which an offset is estimated
PROMPT = 0.05  # quantile of the delays that represents a message without queueing


@dataclass(frozen=True)
class TopicClock:
    """Attributes:
    topic: name.
    receive: (n,) time of receipt, ns.
    header: (n,) header stamp, ns; NO_STAMP without one.
    """

    topic: str
    receive: IntArray
    header: IntArray

    @property
    def fault(self) -> str:
        """Why the header stamps cannot serve as the time; empty where they can."""
        if (self.header == NO_STAMP).all():
            return "no header"
        if np.mean(self.header <= 0) > UNSET:
            return "header stamps are not set"
        there = self.header[self.header > 0]
        steps = np.diff(there)
        if len(steps) and np.mean(steps < 0) > UNSET:
            return "header stamps run backwards"
        if len(steps) and np.mean(steps == 0) > REPEATED:
            return "header stamps repeat"
        return ""

    @property
    def delay(self) -> IntArray:
        """(m,) time from header stamp to receipt of the messages with a stamp, ns; it includes the clocks' offset."""
        there = self.header > 0
        return np.asarray(self.receive[there] - self.header[there])


def choose_clocks(clocks: Mapping[Key, TopicClock]) -> tuple[dict[Key, IntArray], list[Remark]]:
    """The stamps of the samples of each topic, (n,) ns, NO_STAMP where a sample has none; and remarks on the clocks.

    Valid header stamps are used, since they say when something was measured or sent; otherwise the time of receipt. If
    the clocks to be mixed do not count from the same zero, all topics use the time of receipt. No stamp is shifted.
    """
    sound = {key: not clock.fault for key, clock in clocks.items()}
    zeros = {key: float(np.median(clocks[key].delay)) for key in clocks if sound[key]}
    on_receipt = [0.0] if not all(sound.values()) else []
    mixed = [*zeros.values(), *on_receipt]
    remarks = []
    if zeros and max(mixed) - min(mixed) > APART:
        sound = dict.fromkeys(clocks, False)
        far = sorted({clocks[key].topic for key, zero in zeros.items() if abs(zero) > APART})
        most = max(abs(z) for z in zeros.values()) / 1e9
        text = (
            f"the header stamps of {', '.join(far)} differ by {most:.4g} s from the time of receipt and cannot be"
            " combined with the stamps of other topics; all topics use the time of receipt"
        )
        remarks.append(Remark("warning", "other clock", "t", text, "stamp the messages of all topics by one clock"))
    stamps = {
        key: np.where(clock.header > 0, clock.header, NO_STAMP) if sound[key] else clock.receive
        for key, clock in clocks.items()
    }
    said = sorted({_described(clock, sound[key]) for key, clock in clocks.items()})  # the same order in every recording
    remarks.append(Remark("info", "clocks", "t", "; ".join(said)))
    return stamps, remarks + _offsets([clocks[key] for key in clocks if sound[key]])


def _described(clock: TopicClock, sound: bool) -> str:
    if not sound:
        return f"{clock.topic}: time of receipt ({clock.fault or 'another clock'})"
    middle = float(np.median(clock.delay)) / 1e6
    low, high = np.quantile(clock.delay, [0.05, 0.95]) / 1e6
    return f"{clock.topic}: header stamps, received {middle:.3g} ms later ({low:.3g} to {high:.3g} ms)"


def _offsets(clocks: list[TopicClock]) -> list[Remark]:
    """Warnings about offsets between the header clocks of the topics, and about drift.

    Without queueing a message takes almost no time, so the shortest delays of two topics differ by the offset of their
    clocks.
    """
    remarks = []
    prompt = {c.topic: float(np.quantile(c.delay, PROMPT)) for c in clocks if len(c.delay) >= ENOUGH}
    if prompt:
        first, last = max(prompt, key=prompt.__getitem__), min(prompt, key=prompt.__getitem__)
        if prompt[first] - prompt[last] > OFFSET:
            behind = (prompt[first] - prompt[last]) / 1e6
            text = (
                f"the header stamps of {first} are {behind:.3g} ms behind those of {last}, relative to the time of"
                " receipt; no correction is applied"
            )
            remedy = (
                "synchronise the clocks, or check whether a driver stamps late; a diagnosis may find this as a delay"
            )
            remarks.append(Remark("warning", "clock offset", "t", text, remedy))
    for clock in clocks:
        delay = clock.delay
        if len(delay) >= 5 * ENOUGH:
            fifth = len(delay) // 5
            drift = float(np.quantile(delay[-fifth:], PROMPT) - np.quantile(delay[:fifth], PROMPT))
            if abs(drift) > DRIFT:
                text = f"the clock of {clock.topic} drifts by {drift / 1e6:.3g} ms against the time of receipt"
                remarks.append(Remark("warning", "clock drift", "t", text, "synchronise the clocks"))
    return remarks
