"""Which motions to drive next, as commands that can be played."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.display import brief, page
from residual_mpc.api.given import check_robot, check_seconds
from residual_mpc.api.resume import key_of
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.written import Source, written
from residual_mpc.checkpoint import Checkpoint, Keeper
from residual_mpc.experiment.choose import PARTS
from residual_mpc.experiment.command_file import command_table
from residual_mpc.experiment.plan import SECONDS, plan_first, plan_next
from residual_mpc.files import write_atomically
from residual_mpc.models.model_file import diagnosis_in
from residual_mpc.report.words.numbers import count, listed

if TYPE_CHECKING:
    from pandas import DataFrame

LISTED = 5  # effects at one target that are named one by one
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Excitation:
    """document: what `excite --json` prints, but for the file; table: CSV by the log format, one run a motion;
    warnings: motions that may take a joint out of its range."""

    document: dict[str, Any]
    table: str
    warnings: tuple[str, ...]

    def to_frame(self) -> "DataFrame":
        """The commands: `run` (where there are several motions), `t` (s) and `command.*`."""
        from io import StringIO

        import pandas as pd

        return pd.read_csv(StringIO(self.table))

    def save(self, file: str | Path) -> Path:
        """Write the commands to a CSV file."""
        write_atomically(Path(file), self.table)
        return Path(file)

    def lines(self) -> list[str]:
        """The plan in words."""
        return _lines(self.document)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def excite(
    robot: NominalRobot,
    diagnosis: Source | None = None,
    *,
    seconds: float = SECONDS,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    progress: Progress = lambda stage, done: None,
) -> Excitation:
    """Plan the next runs.

    Args:
        diagnosis: what is to be told apart or shown, or its file; None for a first protocol.
        seconds: of a motion.
        limits: actuator -> (lower, upper) command, in the actuator's unit; by default those of the runs that were
            diagnosed, else the model's.
        out: the file for the commands. Finished planning steps are saved next to it; repeat an interrupted call and it
            resumes from there.

    Raises:
        BadInput: a diagnosis that cannot be read, or is of another robot.
    """
    check_robot(robot)
    check_seconds(seconds, "seconds")
    rng, within = np.random.default_rng(seed), dict(limits or {})
    if diagnosis is None:
        plan = plan_first(robot.model, within, seconds, rng)
    else:
        source = written(diagnosis)
        document = diagnosis_in(source)
        key = key_of(robot, (), json.dumps(document, sort_keys=True), sorted(within.items()), seconds, seed)
        checkpoint = Checkpoint(None if out is None else Path(f"{out}.resume"), key)
        keep = Keeper(checkpoint, rng)
        plan = plan_next(document, robot.model, source.where, within, seconds, rng, progress, keep)
        checkpoint.close()
    warnings = tuple(
        f"{p.motion.name}: a joint is predicted to leave its range, or to exceed its speed limit, even for a small "
        "motion; reduce the command range "
        "with `limits`, or supervise the robot"
        for p in plan.played
        if not p.within
    )
    return Excitation(plan.document, command_table([p.motion for p in plan.played], plan.setup.actuators), warnings)


def _hidden(unseen: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the motions cannot reveal: effects that they show nowhere, and others at some targets alone."""
    nowhere = sorted({n["effect"] for n in unseen if n["nowhere"]})
    at: dict[str, list[str]] = {}
    for n in unseen:
        if not n["nowhere"] and n["target"] is not None:
            at.setdefault(n["target"], []).append(n["effect"])
    alike: dict[str, list[str]] = {}
    for target, effects in at.items():
        few = len(effects) <= LISTED
        alike.setdefault(", ".join(sorted(effects)) if few else "most effects", []).append(target)
    said = [f"{effects} at {listed(targets)}" for effects, targets in alike.items()]
    lines = [", ".join(nowhere)] if nowhere else []
    return [f"  these motions cannot reveal: {line}" for line in [*lines, *said]]


def _lines(result: Mapping[str, Any]) -> list[str]:
    if result["purpose"] == "explore":
        best, _, *elsewhere = result["motions"]
        return [
            "no effect in the library explains what is left: run the motion that shows it most, twice",
            f"  {best['name']}: the gap is expected to grow {best['shows']:.2g} times as fast as in the runs so far",
            *(
                f"  then {m['name']}: covers states that the runs hardly visited ({', '.join(m['unseen'])})"
                for m in elsewhere
            ),
        ]
    if not result["parts"]:
        return [
            f"{count(len(result['motions']), 'motion')}: {', '.join(m['name'] for m in result['motions'])}",
            *_hidden(result["not_testable"]),
        ]
    out = [f"to separate: {', '.join(result['parts'])}"]
    if result["sensors"]:
        out.append(f"  also log: {', '.join(result['sensors'])}; motions alone are not enough")
    if result["switches"]:
        out.append("  switch the motors off at times (enabled.*); motions alone are not enough")
    out.append(f"  motions: {', then '.join(result['played'])}")
    pairs, separates = result["pairs"], result["separates"]
    for m in result["motions"]:
        ratio = f"expected likelihood-ratio statistic in favour of the true cause {max(m['ratio'], 0.0):.3g}"
        out.append(f"    {m['name']}: " + (ratio if pairs == 1 else f"separates {m['separates']} of {pairs} pairs"))
    if not result["told_apart"]:
        who = "it separates" if len(result["played"]) == 1 else "together they separate"
        some = f"{who} {separates} of {pairs} pairs; " if separates else ""
        which = "the others" if separates else "them"
        out.append(
            f"  {some}no motion is expected to separate {which} reliably (statistic {PARTS:g}); "
            "another sensor or a known load may"
        )
    return out
