"""Every case that is made here, by the finding that it belongs to."""

from __future__ import annotations

from benchmarks.findings import arm_cases, changed, ice, perfect, recorded, rover, skid, slow
from benchmarks.findings.records import Case

SETS = (perfect, slow, skid, changed, arm_cases, recorded, rover, ice)


def catalogue() -> list[Case]:
    """The cases in the order of the page."""
    return [case for part in SETS for case in part.cases()]
