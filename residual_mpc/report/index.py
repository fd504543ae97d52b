"""One page for a folder of results: what each says in a sentence, its gap before and after, and where its report is."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from residual_mpc.report.comparison import BADGES, TITLES, comparison_sentence
from residual_mpc.report.drive import NAME as DRIVE
from residual_mpc.report.drive import better, drive_sentence
from residual_mpc.report.learned import TITLES as LEARNED
from residual_mpc.report.learned import helps as learned_helps
from residual_mpc.report.sections.section import render
from residual_mpc.report.sections.verdict import TITLES as VERDICTS
from residual_mpc.report.words.numbers import number, percent
from residual_mpc.report.words.summary import sentence

Document = Mapping[str, Any]
MOTION = "motion.webp"
SHOWN = ("tracking.png", "drive.gif", MOTION, "model.json", "next.csv")  # files that are linked
PAGE = "report.html"  # of a result, before the others; a closed loop has a page of another name
CLOSED_LOOP = "closed loop"
DEEP = 6  # folders below the one that is indexed


@dataclass(frozen=True)
class Bar:
    """A figure before and after as lengths, per cent of the longer; first, second: what they are called."""

    first: str
    second: str
    before: str
    after: str
    before_share: float
    after_share: float
    less: str


@dataclass(frozen=True)
class Entry:
    """One result. folder: relative to the index; robot: empty where the result names none; badge: class of the
    stylesheet; links: (text, address); picture: address of an animation, empty where there is none."""

    folder: str
    kind: str
    robot: str
    badge: str
    title: str
    sentence: str
    bar: Bar | None
    links: tuple[tuple[str, str], ...]
    picture: str
    written: float

    def document(self) -> dict[str, Any]:
        return asdict(self)


def entries_in(folder: Path) -> list[Entry]:
    """Every result in a folder and those below it, latest first."""
    found = []
    for where, folders, files in os.walk(folder):
        deep = len(Path(where).relative_to(folder).parts)
        folders[:] = sorted(f for f in folders if not f.startswith(".") and deep < DEEP)
        for name in sorted(set(files) & set(_READERS)):
            entry = _entry(Path(where) / name, folder)
            found += [] if entry is None else [entry]
    return sorted(found, key=lambda e: (-e.written, e.folder, e.kind))


def index_page(title: str, entries: list[Entry]) -> str:
    """The page as text: it needs no network, no script and no second file."""
    return str(render("index.html.jinja", title=title, entries=entries)) + "\n"


def _entry(file: Path, top: Path) -> Entry | None:
    """None for a file of this name that is no result."""
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        kind, badge, name, says, bar = _READERS[file.name](document)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    folder = file.parent.relative_to(top)
    page = DRIVE if kind == CLOSED_LOOP else PAGE
    names = [n for n in (page, *SHOWN) if (file.parent / n).is_file()] + [file.name]
    links = tuple((n, quote((folder / n).as_posix())) for n in names)
    shown = "." if folder == Path() else folder.as_posix()
    film = folder / MOTION if (file.parent / MOTION).is_file() else None
    picture = "" if film is None else quote(film.as_posix())
    robot = str(document.get("robot", ""))
    return Entry(shown, kind, robot, badge, name, says, bar, links, picture, file.stat().st_mtime)


Read = tuple[str, str, str, str, Bar | None]


def _diagnosis(d: Document) -> Read:
    verdict = d["verdict"]
    bar = _bar("gap before", "after", d["gap"]["before"], d["gap"]["after"]) if d["explanation"] else None
    if bar is None:
        bar = _bar("gap", "", d["gap"]["before"], None)
    return "diagnosis", verdict, VERDICTS[verdict], d.get("verdict_sentence") or sentence(d), bar


def _comparison(d: Document) -> Read:
    verdict, gap = d["verdict"], d["gap"]
    explained = gap["after_explained"] if d["changes"] else None
    bar = _bar("gap on the runs after", "with the change in the model", gap["after"], explained)
    return "comparison", BADGES[verdict], TITLES[verdict], d.get("verdict_sentence") or comparison_sentence(d), bar


def _learned(d: Document) -> Read:
    gap = d["gap"]
    before, after = gap["before"], gap["after"]
    says = f"The learned residual ({d['case']}) takes the gap from {number(before)} to {number(after)}."
    helps = learned_helps(d)
    bar = _bar("gap before", "after", before, after)
    return "learned residual", "effects" if helps else "unknown", LEARNED[helps], says, bar


def _run(d: Document) -> Read:
    d = d.get("run", d)
    of = {name: c["tracking_rmse"] for name, c in d["controllers"].items()}
    nominal, other = of["nominal"], of.get("augmented")
    helps = better(d)
    unit = f"m{d.get('unit', 'm')}"
    small = [None if e is None else 1e3 * e for e in (nominal, other)]
    bar = _bar(f"tracking error in {unit}, nominal", "corrected", *small)
    badge = "effects" if helps else "unknown"
    return CLOSED_LOOP, badge, "Better" if helps else "Not better", f"{d['scenario']}: {drive_sentence(d)}", bar


_READERS: dict[str, Callable[[Document], Read]] = {
    "diagnosis.json": _diagnosis,
    "comparison.json": _comparison,
    "learn.json": _learned,
    "result.json": _run,
}


def _bar(first: str, second: str, before: float | None, after: float | None) -> Bar | None:
    """None where the first is not known."""
    if before is None or before <= 0.0:
        return None
    if after is None:
        return Bar(first, second, number(before), "", 100.0, 0.0, "")
    longest = max(before, after)
    change = 1.0 - after / before
    less = f"{percent(abs(change))} {'less' if change >= 0 else 'more'}"
    return Bar(first, second, number(before), number(after), 100.0 * before / longest, 100.0 * after / longest, less)
