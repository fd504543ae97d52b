"""In which unit the columns are: the likeliest that all columns of a kind share, by names, ranges and ratios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import log, pi

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, Roles, joint_response
from residual_mpc.init.columns.signals import SignalMatch
from residual_mpc.init.columns.words import Quantity
from residual_mpc.logs.run import FloatArray

RANGE, RANGE_SPREAD = 1.0, 1.5  # rad that a joint usually moves over, and the spread of its logarithm
SLIDE, SLIDE_SPREAD = 0.1, 1.5  # m
SPEED, SLIDING_SPEED, SPEED_SPREAD = 3.0, 0.2, 1.5  # rad/s, m/s: the fastest of a usual log
ANSWER_SPREAD = 0.6  # of the logarithm of an answer over its command: weak servos stop short
RATE_SPREAD = 0.15  # of a velocity over the rate of its position
SAID = 6.0  # log odds
TURNS = 4.0 * pi  # rad that a servo rarely goes beyond
SURE, RIVAL = 0.8, 0.15  # probability from which a column is converted, and from which another unit is said
OWN = 4.0  # log odds from which a column has a unit of its own, apart from its kind


@dataclass(frozen=True)
class Unit:
    """name: such as `deg`. size: of one, in rad, m or their rates. prior: log odds before anything is seen.
    words: that say it. counts: whether its values are whole numbers, from a zero that nobody knows."""

    name: str
    size: float
    prior: float
    words: frozenset[str]
    counts: int = 0


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


COUNTING = _words("ticks tick counts count raw")
RAD = Unit("rad", 1.0, 2.0, _words("rad radian radians rads"))
DEG = Unit("deg", pi / 180.0, 1.0, _words("deg degree degrees dps"))
ANGLES = (
    RAD,
    DEG,
    Unit("mrad", 1e-3, -6.0, _words("mrad")),
    Unit("turns", 2.0 * pi, -5.0, _words("turns rev revs")),
    *(
        Unit(f"counts of 1/{n} turn", 2.0 * pi / n, 0.5 if n == 4096 else -0.5, COUNTING, n)
        for n in (4096, 1024, 2048, 8192, 16384, 65536)
    ),
)
LENGTHS = (Unit("m", 1.0, 2.0, _words("m")), Unit("mm", 1e-3, 1.0, _words("mm")))
SPEEDS = (
    Unit("rad/s", 1.0, 2.0, _words("rad radian radians rads")),
    Unit("deg/s", pi / 180.0, 1.0, _words("deg degree degrees dps")),
    Unit("rpm", pi / 30.0, 0.5, _words("rpm")),
    Unit("turns/s", 2.0 * pi, -2.0, _words("turns rev revs")),
    Unit("0.229 rpm", 0.229 * pi / 30.0, -1.0, COUNTING, 1),
    Unit("counts/s of 1/4096 turn", 2.0 * pi / 4096, -0.5, COUNTING, 4096),
)
RATES = (Unit("m/s", 1.0, 2.0, _words("m")), Unit("mm/s", 1e-3, 1.0, _words("mm")))
TORQUES = (Unit("N m", 1.0, 0.0, frozenset()),)


@dataclass(frozen=True)
class UnitGuess:
    """A column's unit, why, how sure, and others that are plausible."""

    unit: Unit
    why: str
    sure: float
    rivals: tuple[str, ...] = ()


SHARE = UnitGuess(
    Unit("1", 1.0, 0.0, frozenset()),
    "a share of the torque: in the model the command ends at 1, and its gear is the torque",
    0.9,
)


@dataclass(frozen=True)
class _Chain:
    """The columns of one driven joint, None where it has none, and their ratios as raw numbers."""

    joint: str
    slides: bool
    kind: Quantity
    columns: Mapping[str, str]  # "position", "velocity", "command" -> column
    answer: SignalMatch | None  # of what `kind` says, to the command
    answering: str  # "position" or "velocity"
    rate: SignalMatch | None  # the velocity over the rate of the position
    gear: float  # the command over what it asks of the joint

    def at_joint(self, case: ColumnEvidence, column: str) -> FloatArray:
        """(n,) the raw numbers of a column, of the command over the gear."""
        x = case.signals.raw[column]
        return x / self.gear if column == self.columns.get("command") else x


def find_units(case: ColumnEvidence, roles: Roles, kinds: Mapping[str, Quantity]) -> dict[str, UnitGuess]:
    """The unit of every column that has a role, the likeliest together. kinds: by actuator, what its command is."""
    found: dict[str, UnitGuess] = {}
    for slides in (False, True):
        chains = [c for c in _chains(case, roles, kinds) if c.slides == slides]
        if chains:
            found |= _solve(case, chains)
    shares = {c for d in case.driven if d.share and (c := roles.of("command").get(d.name)) in found}
    return found | dict.fromkeys(shares, SHARE)


def _chains(case: ColumnEvidence, roles: Roles, kinds: Mapping[str, Quantity]) -> list[_Chain]:
    groups = {g: roles.of(g) for g in ("position", "velocity", "command")}
    driven = {d.joint: d for d in case.driven if d.name in groups["command"]}
    chains = []
    for joint in case.structure.joints:
        d = driven.get(joint.name)
        columns = {g: groups[g][joint.name] for g in ("position", "velocity") if joint.name in groups[g]}
        kind: Quantity = "other"
        seen, answering = None, "position"
        if d is not None:
            columns["command"] = groups["command"][d.name]
            kind = kinds[d.name]
            if kind in ("position", "velocity"):
                of, by = joint_response(case, roles, columns["command"], replace(d, kind=kind))
                seen = of if abs(of.correlation) > 0.7 and columns["command"] != by else None
                answering = "velocity" if by == columns.get("velocity") else "position"
        rate = None
        if {"position", "velocity"} <= set(columns):
            of = case.signals.follows(columns["position"], columns["velocity"], source_rate=True)
            rate = of if abs(of.correlation) > 0.8 else None
        if columns:
            gear = 1.0 if d is None else d.gear
            chains.append(_Chain(joint.name, joint.slides, kind, columns, seen, answering, rate, gear))
    return chains


def _solve(case: ColumnEvidence, chains: Sequence[_Chain]) -> dict[str, UnitGuess]:
    """The three units, of positions, velocities and commands, that all joints share."""
    slides = chains[0].slides
    places, rates = (LENGTHS, RATES) if slides else (ANGLES, SPEEDS)
    commands: dict[Quantity, tuple[Unit, ...]] = {"position": places, "velocity": rates, "effort": TORQUES}
    found: dict[str, UnitGuess] = {}
    for kind in dict.fromkeys(c.kind for c in chains):
        mine = [c for c in chains if c.kind == kind]
        sent = commands.get(kind, TORQUES)
        triples = list(product(places, rates, sent))
        prior = np.array([sum(u.prior for u in triple) + _alike(*triple, kind) for triple in triples])
        table = np.array([_odds(case, c, places, rates, sent) for c in mine])  # (joints, triples)
        total = table.sum(axis=0) + prior
        for k, group in enumerate(("position", "velocity", "command")):
            units = [t[k] for t in triples]
            best = units[int(total.argmax())]
            for row, c in enumerate(mine):
                if group not in c.columns:
                    continue
                own = table[row] + prior
                alone = units[int(own.argmax())]
                apart = len(mine) > 1 and _best(own, units, alone) - _best(own, units, best) > OWN
                unit = alone if apart else best
                shares = _shares(own if apart else total, units)
                why = _why(case, c, group, unit, apart)
                found[c.columns[group]] = _decided(unit, shares, units, why, _tells(case, c, group))
    return found


def _alike(place: Unit, rate: Unit, sent: Unit, kind: Quantity) -> float:
    """Log odds of units going together: who logs positions in degrees commands them so, and logs their rates so."""
    odds = 1.0 if rate.name.split("/s")[0] == place.name else 0.0
    return odds + (1.5 if sent is (rate if kind == "velocity" else place) else 0.0)


def _tells(case: ColumnEvidence, chain: _Chain, group: str) -> float:
    """How sure one can be at most of the unit of a column: of a torque, or of what never moves, hardly."""
    if group == "command" and chain.kind == "effort":
        return 0.5
    return 0.99 if any(case.signals.moves(column) for column in chain.columns.values()) else 0.6


def _decided(unit: Unit, shares: Mapping[str, float], units: Sequence[Unit], why: str, at_most: float) -> UnitGuess:
    """The unit, unless it is not the log format's and doubtful: a column is then left as it is."""
    doubtful = unit.size != 1.0 and shares[unit.name] < SURE
    taken = units[0] if doubtful else unit  # the first is the log format's
    rivals = tuple(n for n, share in shares.items() if n != taken.name and share > RIVAL)
    likelier = (
        f"kept, though {unit.name} is more likely ({shares[unit.name]:.0%}), since that is not certain enough: {why}"
    )
    reason = likelier if doubtful else why
    return UnitGuess(taken, reason, round(min(at_most, shares[taken.name]), 2), rivals)


def _best(odds: np.ndarray, units: Sequence[Unit], unit: Unit) -> float:
    return float(odds[[u is unit for u in units]].max())


def _shares(odds: np.ndarray, units: Sequence[Unit]) -> dict[str, float]:
    """The probability of each unit, over all that the others may be."""
    weight = np.exp(np.maximum(odds - odds.max(), -60.0))
    shares: dict[str, float] = {}
    for u, w in zip(units, weight.tolist(), strict=True):
        shares[u.name] = shares.get(u.name, 0.0) + w / float(weight.sum())
    return shares


def _odds(
    case: ColumnEvidence, chain: _Chain, places: Sequence[Unit], rates: Sequence[Unit], sent: Sequence[Unit]
) -> np.ndarray:
    """(places * rates * sent,) log odds of three units by what one joint shows."""
    position, velocity, command = (chain.columns.get(g) for g in ("position", "velocity", "command"))
    odds = np.zeros((len(places), len(rates), len(sent)))
    place, rate, told = (np.array([u.size for u in units]) for units in (places, rates, sent))
    if position is not None:
        odds += np.array([_alone(case, chain, position, u) for u in places])[:, None, None]
    if velocity is not None:
        odds += np.array([_speed(case, chain, velocity, u) for u in rates])[None, :, None]
    if command is not None:
        of = _alone if chain.kind == "position" else _speed if chain.kind == "velocity" else _torque
        odds += np.array([of(case, chain, command, u) for u in sent])[None, None, :]
    if chain.rate is not None:
        off = np.log(abs(chain.rate.slope) * rate[None, :] / place[:, None])
        odds -= 0.5 * (off / RATE_SPREAD)[:, :, None] ** 2
    if chain.answer is not None:
        size = rate[None, :, None] if chain.answering == "velocity" else place[:, None, None]
        odds -= 0.5 * (np.log(abs(chain.answer.slope) * size / told[None, None, :]) / ANSWER_SPREAD) ** 2
    return np.maximum(odds, -60.0).reshape(-1)


def _alone(case: ColumnEvidence, chain: _Chain, column: str, unit: Unit) -> float:
    """How likely a place is in a unit, by its name and by where it goes."""
    x = chain.at_joint(case, column)
    x = x[np.isfinite(x)]
    odds = _said(case, column, unit)
    if not len(x):
        return odds
    low, high = (float(q) * unit.size for q in np.quantile(x, [0.005, 0.995]))
    usual, spread = (SLIDE, SLIDE_SPREAD) if chain.slides else (RANGE, RANGE_SPREAD)
    if case.signals.moves(column) and high > low:
        odds -= 0.5 * (log((high - low) / usual) / spread) ** 2
    limits = next(j.limits for j in case.structure.joints if j.name == chain.joint)
    if unit.counts:
        return odds - (5.0 if limits and high - low > 1.1 * (limits[1] - limits[0]) else 0.0)
    if limits is not None:
        margin = 0.1 * (limits[1] - limits[0])
        y = x * unit.size
        odds -= 10.0 * float(np.mean((y < limits[0] - margin) | (y > limits[1] + margin)))
    elif not chain.slides and max(-low, high) > TURNS and chain.kind == "position":
        odds -= 2.0
    return odds


def _speed(case: ColumnEvidence, chain: _Chain, column: str, unit: Unit) -> float:
    """How likely a speed is in a unit, by its name and its size."""
    x = np.abs(chain.at_joint(case, column))
    x = x[np.isfinite(x)]
    odds = _said(case, column, unit)
    largest = float(np.quantile(x, 0.99)) * unit.size if len(x) else 0.0
    if largest > 0.0 and case.signals.moves(column):
        odds -= 0.5 * (log(largest / (SLIDING_SPEED if chain.slides else SPEED)) / SPEED_SPREAD) ** 2
    return odds


def _torque(case: ColumnEvidence, chain: _Chain, column: str, unit: Unit) -> float:
    return _said(case, column, unit)


def _said(case: ColumnEvidence, column: str, unit: Unit) -> float:
    words = case.words[column]
    odds = 0.0
    if words.unit is not None:
        odds += SAID if words.unit in unit.words else 0.0
    if unit.counts:
        x = case.signals.raw[column]
        x = x[np.isfinite(x)]
        whole = column in case.signals.whole and len(x) > 0 and np.abs(x).max() > 30
        odds -= 0.0 if whole else 12.0
    return odds


def _why(case: ColumnEvidence, chain: _Chain, group: str, unit: Unit, apart: bool) -> str:
    column = chain.columns[group]
    reasons = []
    if case.words[column].unit in unit.words:
        reasons.append("the name says so")
    x = chain.at_joint(case, column)
    x = x[np.isfinite(x)]
    if len(x) and (group == "position" or group == "command" and chain.kind == "position"):
        over = f" over its gear of {chain.gear:g}" if group == "command" and chain.gear != 1.0 else ""
        reasons.append(f"its values{over} range from {x.min():.4g} to {x.max():.4g}")
        limits = next(j.limits for j in case.structure.joints if j.name == chain.joint)
        if limits is not None and not unit.counts:
            size = "" if unit.size == 1.0 else f" in {unit.name}"
            reasons[-1] += f", the joint range{size} is {limits[0] / unit.size:.4g} to {limits[1] / unit.size:.4g}"
    if group == "velocity" and chain.rate is not None:
        reasons.append(f"it is {abs(chain.rate.slope):.4g} times the derivative of {chain.columns['position']}")
    if group == "command" and chain.answer is not None:
        reasons.append(f"the response is {abs(chain.answer.slope):.4g} times as large")
    if apart:
        reasons.append("unlike the other columns of this kind")
    if group == "command" and chain.kind == "effort":
        return "the default of the log format; the data cannot tell"
    return ", ".join(reasons) or "nothing contradicts it"
