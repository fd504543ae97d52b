"""What a residual network learned, as a page of its own."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.figures.learning import learning_curve
from residual_mpc.report.page import Frame, page
from residual_mpc.report.sections.gap_bar import bar_of
from residual_mpc.report.sections.section import Section, render
from residual_mpc.report.words.learned import at_the_floor, earlier_fate, hardly_fell, why_nothing
from residual_mpc.report.words.numbers import listed, number, percent

Document = Mapping[str, Any]  # learn.json

CASES = {
    "sim-to-dyn": "from the simulator, for the dynamic model",
    "real-to-dyn": "from the real robot, for the dynamic model",
    "real-to-sim": "from the real robot, for the simulator",
}
TITLES = {True: "Helps", False: "Does not help"}


def learned_page(document: Document, robot: str) -> str:
    """The page as text: it needs no network, no script and no second file."""
    frame = Frame(robot, "the learned residual", "What a network learned of the remaining error", "learn.json")
    return page(frame, (_verdict(document), _course(document), _channels(document), _network(document), _words()))


def helps(document: Document) -> bool:
    gap = document["gap"]
    return gap["before"] is not None and gap["after"] is not None and gap["after"] < gap["before"]


def learned_sentence(document: Document) -> str:
    """The result in one sentence."""
    gap = document["gap"]
    where = "held-out data" if gap["on"] == "held_out" else "the data that it was trained on"
    if document.get("kept") is False:
        return f"Nothing that was learned was kept: {why_nothing(document)}."
    if not helps(document):
        return f"The learned residual does not make the gap smaller on {where}, so the model is better without it."
    change = percent(1.0 - gap["after"] / gap["before"])
    seconds = number(document["seconds"], 2)
    trained = f"A network with {document['parameters']} weights, trained on {seconds} s of data,"
    return f"{trained} removes {change} of the gap on {where}."


def _verdict(document: Document) -> Section:
    gap = document["gap"]
    parts = [("before", "Without the network", gap["before"]), ("after", "With the network", gap["after"])]
    known = [part for part in parts if part[2] is not None]
    body = render(
        "learned/verdict.html.jinja",
        badge="effects" if helps(document) else "unknown",
        title=TITLES[helps(document)],
        headline=learned_sentence(document),
        bar=bar_of(known, gap.get("noise_floor"), None) if known else None,
        floor=_floor(document),
        case=CASES[document["case"]],
        training=gap["on"] != "held_out",
        left_alone=listed(document["left_alone"] or [""]),
        worse=listed(document["worse_on_held_out"] or [""]),
        spikes=gap.get("without_spikes"),
        note=document["note"],
    )
    return Section("verdict", "Verdict", body)


def _floor(document: Document) -> str:
    """The gap beside the noise floor, in words; empty where the floor is not known."""
    gap = document["gap"]
    floor = gap.get("noise_floor")
    if floor is None:
        return ""
    said = f"Sensor noise alone causes a gap of {number(floor)} (noise floor). The gap is {number(gap['before'])} "
    said += f"without the network and {number(gap['after'])} with it."
    at = at_the_floor(document)
    return f"{said} {at}." if at else said


def _course(document: Document) -> Section | None:
    """There where the course of the learning was kept."""
    history = document.get("history") or []
    if len(history) < 3:
        return None
    body = render(
        "learned/course.html.jinja", figure=learning_curve(history, document["converged_after"], "course"),
        h2=document["h2_norm"], converged=document["converged_after"], hardly=hardly_fell(document),
    )  # fmt: skip
    return Section("course", "How it learned", body)


def _channels(document: Document) -> Section | None:
    channels = sorted(document["gap"]["channels"].items(), key=lambda c: -c[1]["before"])
    if not channels:
        return None
    floors = any(figures.get("noise_floor") is not None for _, figures in channels)
    body = render("learned/channels.html.jinja", channels=channels, floors=floors)
    return Section("channels", "The gap by channel", body)


def _network(document: Document) -> Section:
    condition = document["condition"]
    fate = None if condition is None else earlier_fate(condition)
    return Section("network", "The network", render("learned/network.html.jinja", **document, fate=fate))


def _words() -> Section:
    return Section("definitions", "Definitions", render("learned/definitions.html.jinja"))
