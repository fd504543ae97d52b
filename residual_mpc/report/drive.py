"""A closed-loop run as a page: how far each controller was off its path, and how the robot moved."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.report.evidence.evidence import Array, Clip, Evidence
from residual_mpc.report.figures.controllers import line_of
from residual_mpc.report.figures.tracking import error_over_time, paths
from residual_mpc.report.page import Frame, page
from residual_mpc.report.sections.motion import encoded
from residual_mpc.report.sections.section import Section, render
from residual_mpc.report.words.numbers import listed, number, percent

Document = Mapping[str, Any]  # result.json

NAME = "drive.html"
NOMINAL, CORRECTED = "nominal", "augmented"
NETWORKS = ("network", "online")  # corrected models without named effects
WORDS = {
    "nominal": "nominal model", "augmented": "corrected model", "effects": "named effects alone",
    "network": "network alone", "online": "network that learns while driving", "oracle": "true model",
}  # fmt: skip
SUBJECTS = {"network": "The network alone", "online": "Learning while driving"}
CLOSE = 0.02  # share of the error that two controllers may differ by and still be called equal


@dataclass(frozen=True)
class Driven:
    """One controller's first episode. channels: of the reference; t (n,) s; wanted, driven (n, c) in the channels'
    units; error (n,): mean distance from the reference over the seeds, in the unit of the run."""

    name: str
    channels: tuple[str, ...]
    t: Array
    wanted: Array
    driven: Array
    error: Array


def drive_page(document: Document, driven: Sequence[Driven], clip: Clip | None) -> str:
    """The page as text: it needs no network, no script and no second file. clip: the first seed's robots."""
    robot = f"{document['robot']}: " if document.get("robot") else ""
    frame = Frame(robot + document["scenario"], "closed loop", "Closed loop: controllers on equal terms", "result.json")
    tracking = _tracking(document, driven)
    return page(frame, (_verdict(document), _motion(clip), tracking, _controllers(document), _words(document)))


def better(document: Document) -> bool:
    """Whether the corrected model drives better than the nominal one."""
    nominal, corrected = (_error(document, name) for name in (NOMINAL, _best(document)))
    return corrected is not None and (nominal is None or corrected < (1.0 - CLOSE) * nominal)


def drive_sentence(document: Document) -> str:
    """The result in one sentence."""
    nominal, corrected = (_error(document, name) for name in (NOMINAL, _best(document)))
    kind, unit = document.get("controller", "controller").upper(), f"m{document.get('unit', 'm')}"
    if corrected is None:
        return f"With the corrected model the {kind} lost the path."
    off = f"{number(1e3 * corrected, 2)} {unit}"
    if nominal is None:
        return f"With the nominal model the {kind} lost the path; with the corrected model it stays within {off} (RMS)."
    change = 1.0 - corrected / nominal
    if abs(change) <= CLOSE:
        return f"The {kind} follows the path equally well with both models, with an RMS error of {off}."
    less = f"{percent(abs(change))} {'less' if change > 0 else 'more'}"
    said = f"With the corrected model the {kind} is {off} off its reference (RMS)"
    return f"{said}, {less} than the {number(1e3 * nominal, 2)} {unit} with the nominal model."


def _best(document: Document) -> str:
    """The corrected model: with its network, if there is one."""
    return next((n for n in (CORRECTED, "effects", "online", "network") if n in document["controllers"]), CORRECTED)


def _error(document: Document, name: str) -> float | None:
    error = document["controllers"].get(name, {}).get("tracking_rmse")
    return None if error is None else float(error)


def _without_help(document: Document) -> list[str]:
    """A sentence for each network with which the robot drives no better than with the nominal model."""
    nominal, unit = _error(document, NOMINAL), f"m{document.get('unit', 'm')}"
    out = []
    for name in NETWORKS:
        if name not in document["controllers"] or nominal is None:
            continue
        error, what = _error(document, name), SUBJECTS[name]
        if error is None:
            out.append(f"{what} lost the path, whereas the nominal model did not.")
        elif error >= (1.0 - CLOSE) * nominal:
            effect = "did harm" if error > (1.0 + CLOSE) * nominal else "did not help"
            errors = f"{number(1e3 * error)} {unit} against {number(1e3 * nominal)} {unit} with the nominal model"
            out.append(f"{what} {effect}: {errors}.")
    return out


def _same_paths(driven: Sequence[Driven]) -> list[tuple[str, str]]:
    """Pairs of controllers that drove alike, in words: one line covers the other."""
    pairs = ((a, b) for k, a in enumerate(driven) for b in driven[k + 1 :])
    return [
        (WORDS.get(a.name, a.name), WORDS.get(b.name, b.name))
        for a, b in pairs
        if np.array_equal(a.driven, b.driven) and np.array_equal(a.error, b.error)
    ]


def _verdict(document: Document) -> Section:
    errors = {name: _error(document, name) for name in document["controllers"]}
    largest = max((e for e in errors.values() if e is not None), default=0.0) or 1.0
    unit = f"m{document.get('unit', 'm')}"
    bars = [
        (line_of(n).colour, WORDS.get(n, n), "lost the path" if e is None else f"{number(1e3 * e)} {unit}",
         0.0 if e is None else e / largest)
        for n, e in errors.items()
    ]  # fmt: skip
    body = render(
        "drive/verdict.html.jinja",
        badge="effects" if better(document) else "unknown",
        title="Better" if better(document) else "Not better",
        headline=drive_sentence(document),
        bars=bars,
        without_help=_without_help(document),
        share=(document["recovered"].get(_best(document)) or {}).get("value"),
        interval=(document["recovered"].get(_best(document)) or {}).get("ci95"),
        seeds=document["seeds"],
        plant=document["plant"],
        diagnosis=document.get("diagnosis"),
    )
    return Section("verdict", "Verdict", body)


def _motion(clip: Clip | None) -> Section | None:
    if clip is None:
        return None
    shown, failed = encoded(Evidence(clips=(clip,)))
    alt = "The robot driven with the nominal and with the corrected model, over its reference."
    clips = [{**one, "alt": alt} for one in shown]
    body = render("drive/motion.html.jinja", clips=clips, failed=failed)
    return Section("motion", "The robot's motion", body)


def _tracking(document: Document, driven: Sequence[Driven]) -> Section | None:
    """The paths and the errors over time; none where no episode was kept."""
    if not driven:
        return None
    unit = document.get("unit", "m")
    body = render(
        "drive/tracking.html.jinja", paths=paths(driven, unit, "paths"), error=error_over_time(driven, unit, "error"),
        names=[(line_of(d.name).swatch(), WORDS.get(d.name, d.name)) for d in driven],
        same=_same_paths(driven), seeds=document["seeds"],
    )  # fmt: skip
    return Section("tracking", "The paths and the error over time", body)


def _controllers(document: Document) -> Section:
    rows = [
        {
            "name": WORDS.get(name, name),
            "rmse": _small(c["tracking_rmse"]),
            "max": _small(c.get("tracking_max")),
            "h2": " \N{RIGHTWARDS ARROW} ".join(
                number(v) for v in (c["h2_norm"].values() if isinstance(c["h2_norm"], Mapping) else [c["h2_norm"]])
            ),
            **{k: number(c["solve_ms"][k], 2) if "solve_ms" in c else "" for k in ("median", "p99")},
            "failures": c.get("failures", 0),
            "late": c.get("late", 0),
        }
        for name, c in document["controllers"].items()
    ]
    body = render("drive/controllers.html.jinja", rows=rows, unit=f"m{document.get('unit', 'm')}")
    return Section("controllers", "The controllers", body)


def _small(error: float | None) -> str:
    return number(None if error is None or not np.isfinite(error) else 1e3 * error)


def _words(document: Document) -> Section:
    effects = [e["effect"].replace("_", " ") for e in (document.get("diagnosis") or {}).get("effects", [])]
    names = document["controllers"].keys()
    body = render("drive/definitions.html.jinja", effects=listed(effects) if effects else "", names=names)
    return Section("definitions", "Definitions", body)
