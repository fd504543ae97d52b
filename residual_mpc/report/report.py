"""One HTML file that says what was found: it needs no network and no second file, and is whole without its script."""

from pathlib import Path

from residual_mpc.files import write_atomically
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.page import Frame, page
from residual_mpc.report.sections.audit import audit
from residual_mpc.report.sections.causes import causes
from residual_mpc.report.sections.confirmation import confirmation
from residual_mpc.report.sections.confounded import confounded
from residual_mpc.report.sections.definitions import definitions
from residual_mpc.report.sections.explore import explore
from residual_mpc.report.sections.gap import gap
from residual_mpc.report.sections.left import left
from residual_mpc.report.sections.motion import motion
from residual_mpc.report.sections.next import next_experiment
from residual_mpc.report.sections.not_testable import not_testable
from residual_mpc.report.sections.section import Document, Maker
from residual_mpc.report.sections.servo_changes import servo_changes
from residual_mpc.report.sections.servos import servos
from residual_mpc.report.sections.traces import traces
from residual_mpc.report.sections.verdict import verdict
from residual_mpc.report.sections.where import where

SECTIONS: tuple[Maker, ...] = (
    verdict, confirmation, motion, causes, servos, servo_changes, confounded, next_experiment, not_testable, left,
    traces, explore, gap, where, audit, definitions,
)  # fmt: skip

NAME = "report.html"


def write_report(document: Document, evidence: Evidence, folder: Path) -> Path:
    """Write `folder/report.html` and return its path. `document` is what diagnosis.json holds.

    The file appears whole or not at all. Raises KeyError where the document lacks a key.
    """
    target = folder / NAME
    write_atomically(target, compose(document, evidence))
    return target


def compose(document: Document, evidence: Evidence, makers: tuple[Maker, ...] = SECTIONS) -> str:
    """The page as text."""
    frame = Frame(
        document["robot"], "the gap between model and robot", "The gap between model and robot", "diagnosis.json"
    )
    return page(frame, (maker(document, evidence) for maker in makers))
