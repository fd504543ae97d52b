"""What a comparison claims, read from its ``comparison.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput

Name = tuple[str, str | None]  # effect, target


@dataclass(frozen=True)
class Estimate:
    """How much one parameter changed, with its 95 % interval where one was given."""

    value: float
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class Claim:
    """The part of a comparison that is scored. groups: of changes that the runs cannot tell apart; a member is a set
    of changes. visible: the smallest change of a parameter that the runs would show, as a distance from no change."""

    verdict: str
    named: tuple[Name, ...]
    estimates: Mapping[Name, Mapping[str, Estimate]]
    probabilities: Mapping[Name, float]
    groups: tuple[tuple[frozenset[Name], ...], ...]
    visible: Mapping[Name, Mapping[str, float]] = field(default_factory=dict)


def read_claim(path: Path) -> Claim:
    """The claim in a ``comparison.json``; ``BadInput`` where it does not keep the contract."""
    try:
        document = json.loads(path.read_text())
        return claim_of(document.get("compare", document))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"not a valid comparison ({error!r})", str(path), "see the format of comparison.json") from None


def claim_of(document: Mapping[str, Any]) -> Claim:
    """The claim of a comparison's document."""
    changes = document["changes"]
    return Claim(
        str(document["verdict"]),
        tuple(_name(part) for part in changes),
        {_name(part): _estimates(part.get("parameters") or {}) for part in changes},
        {
            _name(part): float(part["probability"])
            for part in [*(document.get("candidates") or ()), *changes]
            if part.get("probability") is not None
        },
        tuple(tuple(_member(m) for m in group) for group in document.get("confounded") or ()),
        {
            _name(part): {name: float(figures["change"]) for name, figures in part["parameters"].items()}
            for part in document.get("visible") or ()
        },
    )


def _estimates(parameters: Mapping[str, Any]) -> dict[str, Estimate]:
    found = {}
    for name, figures in parameters.items():
        change = figures["change"]
        given = change.get("ci95")
        found[name] = Estimate(float(change["value"]), (float(given[0]), float(given[1])) if given else None)
    return found


def _name(part: Mapping[str, Any]) -> Name:
    return str(part["effect"]), part.get("target")


def _member(member: Any) -> frozenset[Name]:
    return frozenset(_name(m) for m in (member if isinstance(member, list) else [member]))
