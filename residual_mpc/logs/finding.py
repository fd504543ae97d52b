"""One thing that the reader or the audit found in the runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["info", "warning", "error"]


def rows_were(number: int, said: str = "") -> str:
    """ "1 row was", "3 rows were"; said: between the two."""
    between = f" {said}" if said else ""
    return f"{number} row{between} was" if number == 1 else f"{number} rows{between} were"


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing about a run before anything is fitted to it.

    Attributes:
        severity: "info" may be the robot itself, "warning" deserves a look, "error" forbids using the data.
        kind: a short stable name of the check, such as "gap in time" or "degrees".
        run: the run's name, empty where it concerns all runs of the call.
        column: the column, empty where it concerns the table.
        row: index of the first sample concerned, from 0 within the run; None where no one sample is meant.
        message: what was seen, as a sentence.
        remedy: how to mend it, empty where nothing needs mending.
    """

    severity: Severity
    kind: str
    run: str
    column: str
    row: int | None
    message: str
    remedy: str = ""

    @property
    def where(self) -> str:
        """The run and the column, where the message does not name it."""
        return ", ".join(x for x in (self.run, self.about) if x)

    @property
    def about(self) -> str:
        """The column, where the message does not name it."""
        return "" if self.column in self.message else self.column
