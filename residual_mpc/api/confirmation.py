"""Test a diagnosis on new runs: planned to separate its explanations, or recorded after a known change."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.diagnosis_files import COMMANDS, excite_command, write_whole
from residual_mpc.api.display import brief, page
from residual_mpc.api.given import check_given
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs
from residual_mpc.api.servos import with_servos
from residual_mpc.api.written import Source, placed, written
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.experiment.confirmation.confirm import confirm as run_confirmation
from residual_mpc.experiment.confirmation.described import described
from residual_mpc.experiment.confirmation.document import (
    confirmed_document,
    explanations_in,
    probabilities_in,
    sigma_in,
)
from residual_mpc.experiment.confirmation.inputs import ConfirmationInput, DiagnosedExplanation
from residual_mpc.experiment.confirmation.known_change import KnownChange, check_change, check_possible, read_change
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.experiment.drive_setup import setup_from_runs
from residual_mpc.experiment.explanations import explanations_of
from residual_mpc.logs.digest import run_digests
from residual_mpc.models.model_file import Written, diagnosis_in
from residual_mpc.report import Evidence, compose, diagnosis_lines
from residual_mpc.report.confirmation import confirmation_page
from residual_mpc.report.words.confirmation import confirmation_lines, confirmation_sentence, confirmed_sentence

if TYPE_CHECKING:
    from pandas import DataFrame

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Confirmation:
    """document: the diagnosis updated with the test, whose result is under "confirmation"; evidence: the data for the
    figures of the diagnosis report, None if the diagnosis was made in an earlier call; commands: the table of the next
    experiment, None if there is none or if an earlier call wrote it."""

    robot: NominalRobot
    document: dict[str, Any]
    evidence: Evidence | None = None
    commands: str | None = None

    @property
    def verdict(self) -> str:
        """ "effects" or "partial"."""
        return str(self.document["verdict"])

    @property
    def explanation(self) -> list[dict[str, Any]]:
        """The named effects, each with its updated probability and evidence."""
        return list(self.document["explanation"])

    @property
    def outcomes(self) -> dict[str, str]:
        """Maps each effect (with its target in square brackets) to "agrees", "other size", "denies" or "open"."""
        return {
            e["effect"] + (f" [{e['target']}]" if e["target"] else ""): e["outcome"]
            for e in self.document["confirmation"]["effects"]
        }

    def to_frame(self) -> "DataFrame":
        """One row per tested parameter: expected and fitted values with 95 % intervals, in its unit."""
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
        replaced = not document["confirmation"]["explanations"][0]["kept"]  # its pictures are of another model
        alone = self.evidence is None or replaced
        page_of_it = confirmation_page(document) if alone else compose(document, self.evidence or Evidence())
        write_whole(document, page_of_it, self.commands if document["next_experiment"] else None, out)
        return out

    def document_in(self, folder: Path) -> dict[str, Any]:
        """The content of diagnosis.json for this folder, with paths relative to it."""
        following = self.document["next_experiment"]
        if following:
            commands = COMMANDS if self.commands is not None else None
            following = {**following, "commands": commands, "excite": excite_command(self.robot.given, folder)}
        files = [os.path.relpath(path, folder) for path in self.document["run_files"]]
        model = placed(self.document["model"], self.robot, folder)
        return {**self.document, "model": model, "next_experiment": following, "run_files": files}

    def as_written(self) -> Written:
        return Written(self.document, "the confirmed diagnosis")

    def lines(self) -> list[str]:
        """The result of the test, then the diagnosis, as lines of text."""
        return [*confirmation_lines(self.document["confirmation"]), *diagnosis_lines(self.document)]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        frame = self.to_frame()
        return page(self.lines(), frame.assign(unit=frame["unit"].replace("1", "")))


def confirm(
    robot: NominalRobot,
    diagnosis: Source,
    runs: Runs,
    *,
    changed: str | Sequence[str] = (),
    seed: int = 0,
    out: str | Path | None = None,
    command: str = "",
    evidence: Evidence | None = None,
    commands: str | None = None,
    progress: Progress = lambda stage, done: None,
) -> Confirmation:
    """Test a diagnosis on runs that were not used to make it: planned to separate its explanations, or recorded after a
    known change to the robot.

    The explanation and its alternatives are compared on the new runs; each effect is tested by removing it and by
    comparing its fitted size with the expected one. If the runs exclude the explanation in favour of an alternative,
    that alternative replaces it.

    Args:
        robot: the robot that was diagnosed.
        diagnosis: a diagnosis of it, or the path of its file; it must name at least one effect.
        runs: new runs, not used in the diagnosis.
        changed: changes made to the robot before the new runs, in the syntax of `--changed` and the unit of the
            parameter: "payload=none", "payload+=0.2", "sensor_bias@position.elbow=0".
        seed: of the simulated noise, for the noise floor.
        out: folder to which the results are written.
        command: the call as the report prints it.
        evidence, commands: the data for the figures of the diagnosis report and the table of the next experiment, if
            the diagnosis was made in this process.
        progress: called with what is done and the share of the work that is behind.

    Raises:
        BadInput: if the diagnosis names no effect, is of another robot or was made from one of the runs; if the runs
            cannot be used or compared; or if a change cannot be parsed, or gives a parameter an impossible value.
    """
    check_given(robot, runs)
    earlier = written(diagnosis)
    document = diagnosis_in(earlier)
    explanations_of(document, robot.model, earlier.where)  # fits the robot, and can be read
    if not document["explanation"]:
        raise BadInput(
            f"the verdict is {document['verdict']!r}: the diagnosis names no effect to test on new runs", earlier.where,
            "diagnose the new runs together with the old ones",
        )  # fmt: skip
    if out is not None and _same_folder(earlier.where, Path(out)) and evidence is None:
        raise BadInput("would overwrite the diagnosis that is tested", str(out), "choose another folder")
    seen = _files(earlier, document)
    _unseen(runs, seen, document)
    try:
        explanations, sigma, before = explanations_in(document), sigma_in(document), probabilities_in(document)
        horizon = float(document["gap"]["horizon"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(
            f"the diagnosis cannot be read: missing or malformed entry {error}", earlier.where,
            "run `diagnose` again on the original runs",
        ) from error  # fmt: skip
    changes = _changes(changed, explanations, robot)
    setup = setup_from_runs(document, robot.model, earlier.where, {})
    settings = ConfirmationSettings()
    given = ConfirmationInput(
        runs.runs, runs.models, runs.noise, robot.file.tunable, explanations, sigma, setup.dispersion, changes,
        Options(horizon=horizon),
    )  # fmt: skip
    made = run_confirmation(given, settings, np.random.default_rng(seed), progress)
    updated = confirmed_document(document, made, bool(changes), settings)
    after = probabilities_in(updated)
    updated["confirmation"] = described(made, robot.model, before, after, changes, runs.names)
    result: dict[str, Any] = with_servos(finite(updated), robot)
    result["confirmed_by"] = [*document.get("confirmed_by", ()), *run_digests(runs)]
    result["confirmation"]["sentence"] = confirmation_sentence(result["confirmation"])
    result["verdict_sentence"] = confirmed_sentence(result, document["verdict"])
    result["run_files"] = seen
    if command:
        result["command"] = command
    found = Confirmation(robot, result, evidence, commands)
    if out is not None:
        progress("writing the report", 0.95)
        found.save(out)
    return found


def check_options(robot: NominalRobot, diagnosed: Runs, runs: Runs, changed: Sequence[str]) -> None:
    """Raises BadInput for new runs that are among the diagnosed ones, and for a change that cannot be parsed, before
    minutes are spent on the diagnosis."""
    _unseen(runs, (), {"runs": run_digests(diagnosed)})
    slots = _slots(robot)
    for text in changed:
        check_change(text, slots)


def _changes(
    changed: str | Sequence[str], explanations: Sequence[DiagnosedExplanation], robot: NominalRobot
) -> tuple[KnownChange, ...]:
    named = list(dict.fromkeys(t for e in explanations for t in e.terms))
    slots = _slots(robot)
    texts = [changed] if isinstance(changed, str) else changed
    changes = tuple(read_change(text, named, slots) for text in texts)
    check_possible(changes, explanations[0].values, robot.model)
    return changes


def _slots(robot: NominalRobot) -> dict[str, tuple[str, ...]]:
    """The targets of each effect on the robot."""
    return {effect.name: robot.model.slots(effect.name) for effect in LIBRARY}


def _same_folder(file: str, folder: Path) -> bool:
    return os.path.exists(file) and os.path.realpath(Path(file).parent) == os.path.realpath(folder)


def _files(earlier: Written, document: Mapping[str, Any]) -> list[str]:
    """Paths of the diagnosed runs, relative to the current directory."""
    folder = Path(earlier.where).parent if os.path.exists(earlier.where) else Path()
    return [os.path.normpath(folder / f) for f in document.get("run_files") or ()]


def _unseen(runs: Runs, seen: Sequence[str], document: Mapping[str, Any]) -> None:
    """Raise BadInput for a run that was used in the diagnosis or has already been tested."""
    used = {os.path.realpath(f) for f in seen}
    for path in runs.paths:
        if os.path.realpath(path) in used:
            raise BadInput("this run was used in the diagnosis", str(path), "use a run that was not part of it")
    diagnosed, tested = ({d["digest"] for d in document.get(key) or ()} for key in ("runs", "confirmed_by"))
    for run in run_digests(runs):
        if run["digest"] in diagnosed:
            raise BadInput("this run was used in the diagnosis", run["name"], "use a run that was not part of it")
        if run["digest"] in tested:
            raise BadInput("the diagnosis has already been tested on this run", run["name"], "use another run")
