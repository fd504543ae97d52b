"""What of a diagnosis still holds at the end of its runs: an effect that has ended cannot be tested on new ones."""

from collections.abc import Mapping
from typing import Any

Entries = list[Mapping[str, Any]]


def lasting(document: Mapping[str, Any]) -> tuple[Entries, Entries]:
    """The explanation of a diagnosis.json and its alternatives, without the effects that ended and that the model
    therefore leaves out, and without what stood in their place."""
    kept = {_name(v) for v in document["model"]["values"]}
    ended = {_name(e) for e in document["explanation"] if e.get("until") and _name(e) not in kept}
    explanation = [e for e in document["explanation"] if _name(e) not in ended]
    alternatives: Entries = []
    for a in document.get("alternatives", ()):
        if not any(_name(e) in ended for e in a.get("instead_of", ())):
            alternatives.append({**a, "values": [v for v in a["values"] if _name(v) not in ended]})
    return explanation, alternatives


def _name(entry: Mapping[str, Any]) -> tuple[str, str | None]:
    return entry["effect"], entry["target"]
