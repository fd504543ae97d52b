"""The result of testing a diagnosis on new runs, as a page of its own."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.page import Frame, page
from residual_mpc.report.sections.audit import audit
from residual_mpc.report.sections.causes import causes
from residual_mpc.report.sections.confirmation import confirmation
from residual_mpc.report.sections.confounded import confounded
from residual_mpc.report.sections.definitions import definitions
from residual_mpc.report.sections.next import next_experiment
from residual_mpc.report.sections.section import Document

SECTIONS = (confirmation, causes, confounded, next_experiment, audit, definitions)


def confirmation_page(document: Document) -> str:
    """The page as text: the pictures of the diagnosis stay in its own report."""
    frame = Frame(document["robot"], "test on new runs", "A diagnosis tested on new runs", "diagnosis.json")
    return page(frame, (maker(document, Evidence()) for maker in SECTIONS))
