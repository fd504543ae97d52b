"""A diagnosis tested on new runs: planned for it, or made after a known change of the robot."""

import os
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.diagnosis_files import ANSWER, COMMANDS, write_whole
from residual_mpc.api.display import page
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs, usable
from residual_mpc.api.servos import with_servos
from residual_mpc.api.written import Source, name_robot_file, written
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.errors import BadInput
from residual_mpc.experiment.confirmation.confirm import confirm as run_confirmation
from residual_mpc.experiment.confirmation.document import confirmed_document, explanations_in, sigma_in
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput
from residual_mpc.experiment.confirmation.known_change import read_change
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.experiment.drive_setup import setup_from_runs
from residual_mpc.experiment.explanations import explanations_of
from residual_mpc.models.model_file import Written, diagnosis_in
from residual_mpc.report import Evidence, compose, diagnosis_lines, sentence
from residual_mpc.report.confirmation import confirmation_page
from residual_mpc.report.words.confirmation import confirmation_lines, confirmation_sentence

if TYPE_CHECKING:
    from pandas import DataFrame

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Confirmation:
    """document: the diagnosis as it stands after the new runs, with what they say under "confirmation"; evidence: what
    the report draws of the diagnosis, None where it was made by an earlier call."""

    robot: NominalRobot
    document: dict[str, Any]
    evidence: Evidence | None

    @property
    def verdict(self) -> str:
        """ "effects" or "partial"."""
        return str(self.document["verdict"])

    @property
    def explanation(self) -> list[dict[str, Any]]:
        """The named effects, each with its probability and evidence after the new runs."""
        return list(self.document["explanation"])

    @property
    def outcomes(self) -> dict[str, str]:
        """Effect (with its target in brackets) -> "agrees", "other size", "denies" or "open"."""
        return {
            e["effect"] + (f" [{e['target']}]" if e["target"] else ""): e["outcome"]
            for e in self.document["confirmation"]["effects"]
        }

    def to_frame(self) -> "DataFrame":
        """One row a tested number: expected and found with their 95 % intervals, in its unit."""
        import pandas as pd

        columns = ["effect", "target", "outcome", "parameter", "expected", "expected_low", "expected_high", "found"]
        columns += ["low", "high", "unit"]
        rows = [
            (e["effect"], e["target"], e["outcome"], name, p["expected"], *p["expected_ci95"], p["found"],
             *p["found_ci95"], p["unit"])
            for e in self.document["confirmation"]["effects"]
            for name, p in e["parameters"].items()
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=columns)

    def save(self, folder: str | Path) -> Path:
        """Write diagnosis.json, model.json and report.html."""
        out = Path(folder)
        document = self.document_in(out)
        made = confirmation_page(document) if self.evidence is None else compose(document, self.evidence)
        write_whole(document, made, None, out)
        return out

    def document_in(self, folder: Path) -> dict[str, Any]:
        """diagnosis.json as it is written to a folder."""
        following = self.document["next_experiment"]
        if following:
            plan = ["residual-mpc", "excite", str(folder / ANSWER), "--robot", self.robot.given]
            excite = shlex.join([*plan, "--out", str(folder / COMMANDS)])
            following = {**following, "commands": None, "excite": excite}
        files = [os.path.relpath(path, folder) for path in self.document["run_files"]]
        model = name_robot_file(self.document["model"], self.robot.file.source, folder)
        return {**self.document, "model": model, "next_experiment": following, "run_files": files}

    def as_written(self) -> Written:
        return Written(self.document, "the confirmed diagnosis")

    def lines(self) -> list[str]:
        """What the new runs say, then the diagnosis, in words."""
        return [*confirmation_lines(self.document["confirmation"]), *diagnosis_lines(self.document)]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        frame = self.to_frame()
        return page(self.lines(), frame.assign(unit=frame["unit"].replace("1", "")))


def confirm(
    robot: NominalRobot,
    diagnosis: Source,
    runs: Runs,
    *,
    changed: Sequence[str] = (),
    seed: int = 0,
    out: str | Path | None = None,
    command: str = "",
    evidence: Evidence | None = None,
    progress: Progress = lambda stage, done: None,
) -> Confirmation:
    """Test a diagnosis on runs that it has not seen, planned for it or made after a known change of the robot.

    The explanation and its alternatives are compared on the new runs; each effect is tested by leaving it out, and by
    its size. Where the runs prefer an alternative beyond doubt, it takes the explanation's place.

    Args:
        diagnosis: of this robot, or its file; it names at least one effect.
        runs: new ones.
        changed: what was changed on the robot before the new runs, in the effect's own unit, as the option `--changed`
            takes it: "payload=none", "payload+=0.2", "sensor_bias@position.elbow=0".
        out: folder that the answer is written to.
        evidence: what the report draws of the diagnosis, if it was made by the same program.

    Raises:
        BadInput: a diagnosis that names nothing, is of another robot or has seen one of the runs; runs that cannot be
            used or compared; a change that cannot be read.
    """
    usable(runs)
    earlier = written(diagnosis)
    document = diagnosis_in(earlier)
    explanations_of(document, robot.model, earlier.where)  # fits the robot, and can be read
    if not document["explanation"]:
        raise BadInput(
            f"the verdict is {document['verdict']!r}: it names no effect that new runs could confirm", earlier.where,
            "diagnose the new runs together with the old ones",
        )  # fmt: skip
    seen = _files(earlier, document)
    _unseen(runs, seen, document)
    try:
        explanations, sigma = explanations_in(document), sigma_in(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"it cannot be read: {error!r}", earlier.where, "diagnose the runs again") from error
    named = [t for e in explanations for t in e.terms]
    slots = {e: robot.model.slots(e) for e in _effects_of(changed)}
    changes = tuple(read_change(text, list(dict.fromkeys(named)), slots) for text in changed)
    setup = setup_from_runs(document, robot.model, earlier.where, {})
    settings = ConfirmationSettings()
    given = ConfirmationInput(
        runs.runs, runs.models, runs.noise, explanations, sigma, setup.dispersion, changes,
        Options(horizon=float(document["gap"]["horizon"])),
    )  # fmt: skip
    made = run_confirmation(given, settings, np.random.default_rng(seed), progress)
    after: dict[str, Any] = finite(confirmed_document(document, made, changes, runs.names, settings))
    after = with_servos(after, robot)
    after["confirmed_by"] = [*document.get("confirmed_by", ()), *runs.names]
    after["confirmation"]["sentence"] = confirmation_sentence(after["confirmation"])
    after["verdict_sentence"] = sentence(after)
    after["run_files"] = seen
    if command:
        after["command"] = command
    found = Confirmation(robot, after, evidence)
    if out is not None:
        progress("writing the report", 0.95)
        found.save(out)
    return found


def _files(earlier: Written, document: Any) -> list[str]:
    """The files of the runs that were diagnosed, seen from here."""
    folder = Path(earlier.where).parent if os.path.exists(earlier.where) else Path()
    return [os.path.normpath(folder / f) for f in document.get("run_files") or ()]


def _unseen(runs: Runs, seen: Sequence[str], document: Any) -> None:
    """Raises BadInput for a run that the diagnosis has been fitted to or confirmed by."""
    known = {os.path.realpath(f) for f in seen}
    for path in runs.paths:
        if os.path.realpath(path) in known:
            raise BadInput("the diagnosis has seen this run", str(path), "confirm with a run that was recorded later")
    for name in runs.names:
        if name in document.get("confirmed_by", ()):
            raise BadInput("the diagnosis has been confirmed by this run already", name, "give another run")


def _effects_of(changed: Sequence[str]) -> list[str]:
    from residual_mpc.effects.library import BY_NAME

    names = (text.partition("=")[0].rstrip("+-").partition("@")[0].partition(".")[0].strip() for text in changed)
    return [n for n in names if n in BY_NAME]
