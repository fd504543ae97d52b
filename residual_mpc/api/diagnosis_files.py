"""What `diagnose` writes: the answer as soon as it stands, then the whole with its report."""

import shlex
from pathlib import Path
from typing import Any

from residual_mpc.api.early_answers import SO_FAR
from residual_mpc.files import write_atomically, write_json

ANSWER, MODEL, REPORT, COMMANDS = "diagnosis.json", "model.json", "report.html", "next.csv"
UNFINISHED = (
    "Written before the diagnosis was finished: what follows the answer, from the remaining error to the report, may "
    "be missing. The diagnosis was still running, or was stopped."
)


def excite_command(robot: str, folder: Path) -> str:
    """The command that plans the next experiment of a diagnosis in this folder; robot: as it was given."""
    call = ["residual-mpc", "excite", str(folder / ANSWER), "--robot", robot, "--out", str(folder / COMMANDS)]
    return shlex.join(call)


def write_answer(document: dict[str, Any], out: Path) -> None:
    """The answer and the augmented model, with a note that the rest is still to come.

    What an earlier diagnosis left here is removed first, so that no report of it stands beside this answer.
    """
    for name in (REPORT, COMMANDS, SO_FAR):
        (out / name).unlink(missing_ok=True)
    write_json(out / MODEL, document["model"])
    write_json(out / ANSWER, {**document, "notes": [*document["notes"], UNFINISHED]})


def write_whole(document: dict[str, Any], page: str, commands: str | None, out: Path) -> None:
    """All files; commands: the table of the next experiment, None where there is none."""
    write_json(out / MODEL, document["model"])
    if commands is None:
        (out / COMMANDS).unlink(missing_ok=True)
    else:
        write_atomically(out / COMMANDS, commands)
    write_atomically(out / REPORT, page)
    write_json(out / ANSWER, document)
