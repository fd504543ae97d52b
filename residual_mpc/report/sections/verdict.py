"""The first screen: the verdict in one sentence, the gap as one bar, and the numbers to change in the model."""

from residual_mpc.effects.library import BY_NAME
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.gap_bar import gap_bar
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.confidence import likelihood
from residual_mpc.report.words.effects import name_at, numbers_of
from residual_mpc.report.words.gaps import warnings
from residual_mpc.report.words.groups import group_sentence
from residual_mpc.report.words.numbers import interval_in, measure
from residual_mpc.report.words.rest import rest_sentence
from residual_mpc.report.words.summary import sentence, unseen
from residual_mpc.report.words.uncertain import by_certainty, told_groups

TITLES = {
    "no_gap": "No gap",
    "effects": "Explained",
    "partial": "Partly explained",
    "unknown": "Unknown",
}
LONG = 180  # characters, above which the sentence is set smaller
TIMES = "\N{MULTIPLICATION SIGN}\N{NO-BREAK SPACE}"
NUMBERS = 3  # numbers to change in the model; the section of the causes has all


def verdict(document: Document, evidence: Evidence) -> Section:
    """Always there: it opens the report."""
    headline = document.get("verdict_sentence") or sentence(document)
    changes, more = _changes(document)
    body = render(
        "sections/verdict.html.jinja",
        verdict=document["verdict"],
        title=TITLES[document["verdict"]],
        headline=headline,
        long=len(headline) > LONG,
        gap=document["gap"],
        bar=gap_bar(document),
        warnings=warnings(document["gap"], bool(document["explanation"])),
        changes=changes,
        more=more,
        shrink=document.get("shrink"),
        unseen=unseen(document["held_out"]),
        rest=rest_sentence(document["remainder"]) if document.get("remainder") else "",
        doubts=[group_sentence(group, document) for group in told_groups(document, by_certainty(document)[1])],
        notes=document.get("notes") or [],
    )
    return Section("verdict", "Verdict", body)


def _changes(document: Document) -> tuple[list[Document], int]:
    """The first number of each of the surest effects, then their second ones, at most NUMBERS; how many more there
    are."""
    rows = [
        (place, rank, effect, name, parameter)
        for rank, effect in enumerate(by_certainty(document)[0])
        for place, (name, parameter) in enumerate(numbers_of(effect).items())
    ]
    rows.sort(key=lambda row: row[:2])
    shown: list[Document] = [
        {
            "effect": name_at(effect),
            "parameter": name.replace("_", " ") if len(numbers_of(effect)) > 1 else "",
            "value": (TIMES if _multiplies(effect["effect"], name) else "")
            + measure(parameter["value"], parameter.get("unit", "1")),
            "interval": interval_in(parameter.get("ci95") or (None, None), parameter.get("unit", "1")),
            "probability": effect.get("probability"),
            "likelihood": "" if effect.get("probability") is None else likelihood(effect["probability"]),
        }
        for _, _, effect, name, parameter in rows[:NUMBERS]
    ]
    return shown, max(0, len(rows) - NUMBERS)


def _multiplies(effect: str, parameter: str) -> bool:
    """Whether the parameter is a factor on a number of the model."""
    known = BY_NAME[effect].parameters if effect in BY_NAME else ()
    return any(p.name == parameter and p.unit == "1" and p.null == 1.0 for p in known)
