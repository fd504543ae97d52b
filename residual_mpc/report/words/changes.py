"""What changed between two sets of runs, in words."""

import math
from collections.abc import Mapping
from typing import Any

from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.phrase import Noun
from residual_mpc.report.words.effects import name
from residual_mpc.report.words.groups import Member, member_name, member_names, or_else
from residual_mpc.report.words.numbers import (
    ARROW,
    listed,
    measure,
    measure_interval,
    number,
    percent,
    percent_of_nominal,
)

Document = Mapping[str, Any]  # comparison.json
Number = Mapping[str, Any]  # an entry of `parameters` of a change

SURE = 0.5  # probability from which a change is stated without "possibly"
FAINT = 0.1  # probability below which a change is left out of the sentence, unless there is none above
WORSE = 1.5  # times the gap before, from which a larger gap after is remarked where no change was found
SMALL = 0.05  # share of the rise of the squared gap, below which what is left is a smaller difference
DIFFER = 0.01  # p value up to which the errors of two sets differ (`contrast.left` of the comparison)
NONE = 0.02  # share of a number's value on the other side under which something is said to be absent

UNCHANGED = 1e-9  # SI units, below which a number has stayed: a fit leaves rounding errors


def comparison_sentence(document: Document) -> str:
    """The verdict in one sentence."""
    verdict = document["verdict"]
    if verdict == "same":
        return "No change found: no effect differs by more between the two sets than within one of them."
    if verdict == "unknown":
        return "The two sets differ, but no change of an effect in the library explains how."
    changes = document["changes"]
    likely = [c for c in changes if c["probability"] >= FAINT] or changes
    said = capital(listed([_or_else(change, document) for change in likely]))
    if verdict == "changed":
        return f"{said}."
    if not gap_is_explained(document):
        return f"{said}; this explains only part of the difference between the two sets."
    if errors_differ(document):
        return f"{said}; this explains the gap, but the errors of the two sets still differ."
    return f"{said}; this explains the gap, but another change explains the runs better (see the notes)."


def gap_is_explained(document: Document) -> bool:
    """Whether the changes explain the rise of the gap; the errors of the two sets may still differ."""
    return bool(document["unexplained"]["share"] < SMALL)


def errors_differ(document: Document) -> bool:
    """Whether the errors of the two sets differ beside the changes by more than those of one set among themselves."""
    return bool(document["unexplained"].get("p", 0.0) <= DIFFER)


def _or_else(change: Mapping[str, Any], document: Document) -> str:
    """The change, and what may have changed in its place."""
    alternative = or_else(change, document)
    return change_clause(change) + (f" ({alternative})" if alternative else "")


def warnings(document: Document) -> list[str]:
    """What casts doubt on the figures or the verdict: sets without a held-out window, a gap that rises though no change
    was found."""
    gap = document["gap"]
    unseen = [side for side in ("before", "after") if gap[side] is None]
    if unseen:
        whose = listed(unseen)
        return [f"No window of the runs {whose} was held out, so their gap is unknown: record more or longer runs."]
    if document["changes"] or gap["after"] <= WORSE * max(gap["before"], gap["noise_floor"] or 0.0):
        return []
    return [
        f"The gap is {number(gap['after'] / gap['before'], 2)} times as large on the runs after, but no significant "
        "change of an effect explains it: record more runs, or compare again for only what may have changed."
    ]


def visible_words(entry: Mapping[str, Any]) -> str:
    """ "command delay 12 ms", "actuator gain (left) 3 %"."""
    ((_, size),) = entry["parameters"].items()
    words = percent(size["change"]) if size["unit"] == "1" else measure(size["change"], size["unit"])
    return f"{member_name(entry)} {words}"


def change_clause(change: Mapping[str, Any]) -> str:
    """ "the command delay increased by 45 ms, from 71 ms to 116 ms", after "possibly" where that is less likely than
    not. Of several numbers, only those are named whose interval excludes that they stayed."""
    numbers = {k: n for k, n in change["parameters"].items() if not _is_shape(change, k)}
    clear = {k: n for k, n in numbers.items() if not _may_have_stayed(change, k, n)}
    clauses = [_clause(change, k, n) for k, n in (clear or numbers).items()]
    doubt = "possibly " if change["probability"] < SURE else ""
    return f"{doubt}{listed(clauses)}" if clauses else f"{doubt}{name(change)}{_of(change)} changed"


def change_line(change: Mapping[str, Any]) -> str:
    """ "command_delay: delay 71 ms → 116 ms, change 45 ms (26 to 64), probability 0.97"."""
    named = f"{change['effect']} [{change['target']}]" if change["target"] else str(change["effect"])
    parts = [f"{parameter} {number_words(change, parameter)}" for parameter in change["parameters"]]
    return f"{named}: {', '.join(parts)}, probability {change['probability']:.2f}"


def number_words(change: Mapping[str, Any], parameter: str) -> str:
    """ "71 ms → 116 ms, change 45 ms (26 to 64)"."""
    n = change["parameters"][parameter]
    note = f" ({n['note']})" if n.get("note") else ""
    if _is_shape(change, parameter):
        return f"{measure(n['after'], n['change']['unit'])}{note}"
    before, after = _ends(change, parameter)
    size = measure_interval(n["change"]["value"], n["change"]["ci95"], n["change"]["unit"])
    if n["before"] is None:
        return f"none {ARROW} {size}{note}"
    if not is_ratio(change, parameter) and abs(n["change"]["value"]) < UNCHANGED:
        return f"{before}, as before{note}"
    return f"{before} {ARROW} {after}, {'ratio' if is_ratio(change, parameter) else 'change'} {size}{note}"


def is_ratio(change: Mapping[str, Any], parameter: str) -> bool:
    """Whether the change of a number is its ratio: of a factor, or of a limit or stiffness that was there before."""
    known = _parameter(change, parameter)
    if known is None:
        return _seems_a_ratio(change["parameters"][parameter])
    there = change["parameters"][parameter]["before"] is not None
    return known.null == 1.0 or (math.isinf(known.null) and there)


def stretch_words(document: Document) -> str:
    """ "15 stretches of the runs before against 15 of the runs after"."""
    there = document["stretches"]
    noun = "stretch" if there["before"] == 1 else "stretches"
    return f"{there['before']} {noun} of the runs before against {there['after']} of the runs after"


def alike_sentence(group: list[Member]) -> str:
    """ "These runs cannot tell apart changes of command delay and sensor delay."."""
    return f"These runs cannot tell apart changes of {listed(member_names(group))}."


def capital(text: str) -> str:
    """The text with its first letter large."""
    return f"{text[:1].upper()}{text[1:]}"


def _clause(change: Mapping[str, Any], parameter: str, n: Number) -> str:
    known = BY_NAME.get(change["effect"])
    noun = known.nouns.get(parameter) if known else None
    noun = noun or Noun(f"{name(change)} ({_plain(parameter)})")
    text, own = noun.text, noun.kind == "own"
    if noun.targeted and _of(change):
        text = noun.targeted
    appears = noun.appears or text
    if own and _absent(n["before"], n["after"]):
        article = "a" if text == noun.targeted else noun.article
        what = " ".join(word for word in (article, appears) if word)
        size = " ".join(word for word in (noun.size, _written(change, parameter, n["after"])) if word)
        return f"{_happened(what, 'appeared', change, noun)} ({_inside_brackets(size)})"
    if own and _absent(n["after"], n["before"]):
        was = _inside_brackets(_written(change, parameter, n["before"]))
        return f"{_happened(f'the {appears}', 'disappeared', change, noun)} ({was} before)"
    the, value = f"the {text}{_of(change)}", n["change"]["value"]
    before, after = _ends(change, parameter)
    if is_ratio(change, parameter):
        if noun.kind == "factor":
            before, after = percent_of_nominal(n["before"]), f"{percent_of_nominal(n['after'])} of the modelled value"
        return f"{the} {_scaled(value)}, from {before} to {after}"
    turned = f"{the} {'increased' if value >= 0.0 else 'decreased'}"
    if _is_share(change, parameter):
        return f"{turned} from {before} to {after}"
    if noun.kind == "excess":
        return f"{turned} by {_written(change, parameter, abs(value))}"
    return f"{turned} by {_written(change, parameter, abs(value))}, from {before} to {after}"


def _happened(what: str, verb: str, change: Mapping[str, Any], noun: Noun) -> str:
    """ "a command delay of the left wheel appeared", "backlash appeared in the gear of j1"."""
    where = _of(change, noun.inside)
    return f"{what} {verb}{where}" if noun.inside == "in" else f"{what}{where} {verb}"


def _inside_brackets(text: str) -> str:
    """ "0.2 rad, 11°" of "0.2 rad (11°)"."""
    return text.replace(" (", ", ").removesuffix(")")


def _scaled(ratio: float) -> str:
    """ "increased by 10 %"; large ones as a factor."""
    if ratio >= 2.0:
        return f"increased by a factor of {number(ratio)}"
    return f"{'increased' if ratio >= 1.0 else 'decreased'} by {percent(abs(ratio - 1.0))}"


def _of(change: Mapping[str, Any], preposition: str = "of") -> str:
    """ " of the left wheel"; empty where the effect acts on the whole robot, all actuators or all channels."""
    target, known = change.get("target") or change.get("only_target"), BY_NAME.get(change["effect"])
    if not target and (known is None or known.target not in ("joint", "body")):
        return ""
    who = known.phrase.who(target, known.target) if known and known.phrase else target
    return f" {preposition} {who}"


def _ends(change: Mapping[str, Any], parameter: str) -> tuple[str, str]:
    """Both values; one that is nothing beside the other is a zero, without a unit of its own."""
    n = change["parameters"][parameter]
    both, differs = ((n["before"], n["after"]), (n["after"], n["before"])), not is_ratio(change, parameter)
    before, after = (
        "none" if v is None else "0" if v == 0.0 or (differs and _absent(v, other)) else _written(change, parameter, v)
        for v, other in both
    )
    return before, after


def _written(change: Mapping[str, Any], parameter: str, value: float) -> str:
    """A value with its unit; a share as a percentage."""
    unit = str(change["parameters"][parameter]["change"]["unit"])
    if _is_share(change, parameter):
        return percent(value) + (" per second" if unit == "1/s" else "")
    return measure(value, unit)


def _is_share(change: Mapping[str, Any], parameter: str) -> bool:
    """Whether a number that changes by a difference reads better as a percentage."""
    known = BY_NAME.get(change["effect"])
    return bool(known and known.phrase and parameter in known.phrase.shares and not is_ratio(change, parameter))


def _absent(value: float | None, other: float | None) -> bool:
    return value is None or (other is not None and abs(value) < NONE * abs(other))


def _parameter(change: Mapping[str, Any], parameter: str) -> Any:
    known = BY_NAME.get(change["effect"])
    return next((p for p in known.parameters if p.name == parameter), None) if known else None


def _is_shape(change: Mapping[str, Any], parameter: str) -> bool:
    """Whether the number says only how the effect acts."""
    known = _parameter(change, parameter)
    return bool(known is not None and known.shape)


def _may_have_stayed(change: Mapping[str, Any], parameter: str, n: Number) -> bool:
    low, high = n["change"]["ci95"]
    stayed = 1.0 if is_ratio(change, parameter) else 0.0
    return low is not None and high is not None and low <= stayed <= high


def _seems_a_ratio(n: Number) -> bool:
    """The same for an effect that the library does not have, from its numbers alone."""
    before, after, change = n["before"], n["after"], n["change"]
    if before is None or after is None or change["unit"] != "1" or before == 0.0:
        return False
    return bool(abs(after / before - change["value"]) < abs(after - before - change["value"]))


def _plain(parameter: str) -> str:
    return parameter.replace("_", " ")
