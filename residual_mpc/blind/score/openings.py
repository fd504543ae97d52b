"""The ledger of openings: how often test seeds were scored, and by which version of the program."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Opening:
    """One look at the answers of a test suite."""

    when: str  # ISO 8601, UTC
    version: str  # of the program whose diagnoses were scored
    suite: str  # the first letters of a hash over the suite's commitments
    cases: int


def record_opening(ledger: Path, versions: str, suite: str, cases: int) -> None:
    """Append one line; nothing is ever taken back."""
    opening = Opening(datetime.now(UTC).isoformat(timespec="seconds"), versions, suite, cases)
    ledger.parent.mkdir(parents=True, exist_ok=True)
    with ledger.open("a") as lines:
        lines.write(json.dumps(asdict(opening)) + "\n")


def read_openings(ledger: Path) -> tuple[Opening, ...]:
    """Every opening so far; none where the ledger does not exist yet."""
    if not ledger.exists():
        return ()
    try:
        return tuple(Opening(**json.loads(line)) for line in ledger.read_text().splitlines() if line.strip())
    except (ValueError, TypeError) as error:
        raise BadInput(
            f"the ledger contains an invalid line ({error})", str(ledger), "restore it from version control"
        ) from None
