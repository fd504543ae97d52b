"""What a diagnosis claims, read from its ``diagnosis.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput

Name = tuple[str, str | None]  # effect, target
_GAPS = ("before", "after", "noise_floor", "constant_velocity")


@dataclass(frozen=True)
class Estimate:
    """One parameter of one named effect."""

    value: float
    low: float  # of the 95 % interval
    high: float


@dataclass(frozen=True)
class Claim:
    """The part of a diagnosis that is scored."""

    verdict: str
    named: tuple[Name, ...]  # the explanation
    estimates: Mapping[Name, Mapping[str, Estimate]]
    groups: tuple[tuple[frozenset[Name], ...], ...]  # confounded; a member is a set of effects
    probabilities: Mapping[Name, float]  # of the candidates
    expected_shrink: float | None
    expected_interval: tuple[float, float] | None
    shrink: float | None  # achieved on the runs kept back
    gap: Mapping[str, float]  # before, after, noise_floor, constant_velocity, as far as they are stated
    changing: frozenset[Name] = frozenset()  # those of ``named`` that begin in the middle or differ from run to run


def read_claim(path: Path) -> Claim:
    """The claim in a ``diagnosis.json``; ``BadInput`` where it does not keep the contract."""
    try:
        return claim_of(json.loads(path.read_text()))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"not a valid diagnosis ({error!r})", str(path), "see the format of diagnosis.json") from None


def claim_of(document: Mapping[str, Any]) -> Claim:
    """The claim of a diagnosis document."""
    estimates: dict[Name, dict[str, Estimate]] = {}
    for part in document["explanation"]:
        found = {}
        for parameter, figure in part.get("parameters", {}).items():
            low, high = figure.get("ci95") or (float("nan"), float("nan"))
            found[parameter] = Estimate(float(figure["value"]), float(low), float(high))
        estimates[_name(part)] = found
    groups = tuple(tuple(_member(m) for m in group) for group in document.get("confounded") or ())
    probabilities = {
        _name(c): float(c["probability"])
        for c in [*(document.get("candidates") or ()), *document["explanation"]]
        if c.get("probability") is not None
    }
    shrink = document.get("shrink") or {}
    interval = shrink.get("expected_ci95")
    return Claim(
        verdict=str(document["verdict"]),
        named=tuple(_name(part) for part in document["explanation"]),
        estimates=estimates,
        groups=groups,
        probabilities=probabilities,
        expected_shrink=shrink.get("expected"),
        expected_interval=None if interval is None else (float(interval[0]), float(interval[1])),
        shrink=shrink.get("value"),
        gap={k: float(v) for k, v in (document.get("gap") or {}).items() if k in _GAPS and v is not None},
        changing=frozenset(
            _name(p) for p in document["explanation"] if p.get("since") or p.get("until") or p.get("by_run")
        ),
    )


def _name(part: Mapping[str, Any]) -> Name:
    return str(part["effect"]), part.get("target")


def _member(member: Any) -> frozenset[Name]:
    return frozenset(_name(m) for m in (member if isinstance(member, list) else [member]))
