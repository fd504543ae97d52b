"""A suite on disk: the cases, and what travels with them. Nothing in it says what a case hides.

suite.json          names, families, commitments, withheld candidates
cases/<name>/       robot.toml, the nominal model, the runs
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically

SCHEMA = "residual-mpc/blind-suite/1"
RECORD = "experiment.json"  # of each case, beside a suite: its second answer, after the proposed experiment
NOTHING_OPEN = "nothing is open"  # its status where no experiment was proposed
FIRST_TEST_SEED = 100_000  # seeds under it are for development, the others for tests


@dataclass(frozen=True)
class Entry:
    """One case, as everyone may know it."""

    name: str
    family: str
    commitment: str  # hex
    without: tuple[str, ...]  # effects whose candidate a diagnosis of this case has to do without


@dataclass(frozen=True)
class Suite:
    """All cases of one folder."""

    folder: Path
    seeds: str  # "development" or "test"
    version: str  # of the program that made it
    cases: tuple[Entry, ...]

    def case(self, entry: Entry) -> Path:
        """The folder with the files of ``entry``."""
        return self.folder / "cases" / entry.name


def program_version() -> str:
    """The installed version of this program."""
    return metadata.version("residual-mpc")


def write_suite(suite: Suite) -> None:
    """Write ``suite.json``, whole or not at all."""
    document = {"schema": SCHEMA, "seeds": suite.seeds, "version": suite.version,
                "cases": [asdict(entry) for entry in suite.cases]}  # fmt: skip
    write_json(suite.folder / "suite.json", document)


def read_suite(folder: Path) -> Suite:
    """The suite in ``folder``; ``BadInput`` where there is none."""
    path = folder / "suite.json"
    remedy = "make one with `residual-mpc blind make --out FOLDER`"
    try:
        document = json.loads(path.read_text())
        cases = tuple(Entry(c["name"], c["family"], c["commitment"], tuple(c["without"])) for c in document["cases"])
        suite = Suite(folder, document["seeds"], document["version"], cases)
    except FileNotFoundError:
        raise BadInput("this folder contains no suite of blind cases", str(folder), remedy) from None
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"not a suite of blind cases ({error!r})", str(path), remedy) from None
    for entry in suite.cases:
        if not suite.case(entry).is_dir():
            raise BadInput("a case of the suite is missing", str(suite.case(entry)), remedy)
    return suite


def write_json(path: Path, document: object) -> None:
    """Write JSON so that a reader sees the old file or the new one, never half of it."""
    write_atomically(path, json.dumps(document, indent=1) + "\n")
