"""Where the gap lies, which effects cause it, and how far it shrinks once they are added to the model."""

import os
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.diagnosis_files import excite_command, write_answer, write_whole
from residual_mpc.api.display import brief, page
from residual_mpc.api.early_answers import SO_FAR, EarlyAnswers
from residual_mpc.api.effect_names import effect_names, possible_effects
from residual_mpc.api.given import check_given, check_seconds
from residual_mpc.api.resume import checkpoint_in, key_of
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs
from residual_mpc.api.servos import with_servos
from residual_mpc.api.written import Source, placed, written
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.diagnose import diagnose as run_diagnosis
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.early_answers import unheard
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.diagnosis.results.records import Diagnosis as Record
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.diagnosis.search.measured_commands import not_commanded
from residual_mpc.effects.laws import FITTED_LAW
from residual_mpc.errors import BadInput
from residual_mpc.experiment.propose import propose
from residual_mpc.export.augmented import settings_from
from residual_mpc.learning.batch.network_learner import LEARNERS
from residual_mpc.logs.digest import run_digests
from residual_mpc.models.model_file import Written, model_in
from residual_mpc.models.robot_file import measured_over
from residual_mpc.models.settings import Values
from residual_mpc.report import Evidence, compose, diagnosis_lines, sentence
from residual_mpc.report.evidence.collect import collect
from residual_mpc.report.motion.animation import check_video, write_video
from residual_mpc.report.words.effects import sentence_of
from residual_mpc.report.words.rest import rest_sentence

if TYPE_CHECKING:
    from pandas import DataFrame

Progress = Callable[[str, float], None]  # what is done, and the share of it all that is behind


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """document: the content of diagnosis.json (contract, section 5), but for the places of files; made: what the report
    draws; commands: the table of the next experiment, None where none was planned; paths: of the runs, as given."""

    robot: NominalRobot
    document: dict[str, Any]
    made: DiagnosisResult
    commands: str | None
    paths: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """ "no_gap", "effects", "partial" or "unknown"."""
        return str(self.document["verdict"])

    @property
    def explanation(self) -> list[dict[str, Any]]:
        """The named effects, each with target, probability, parameters and evidence."""
        return list(self.document["explanation"])

    @property
    def gap(self) -> dict[str, Any]:
        """Before and after, with the noise floor, at each horizon."""
        return dict(self.document["gap"])

    def to_frame(self) -> "DataFrame":
        """One row a parameter of a named effect: value and 95 % interval (low, high) in its unit."""
        import pandas as pd

        columns = ["effect", "target", "probability", "parameter", "value", "low", "high", "unit"]
        rows = [
            (e["effect"], e["target"], e["probability"], name, p["value"], *(p["ci95"] or (None, None)), p["unit"])
            for e in self.explanation
            for name, p in e["parameters"].items()
        ]
        return pd.DataFrame(rows, columns=columns)

    def servos(self) -> "DataFrame":
        """One row a number of a servo of an arm: the model's, and corrected with its 95 % interval (low, high)."""
        import pandas as pd

        columns = ["actuator", "joint", "number", "unit", "nominal", "value", "low", "high", "probability", "status"]
        rows = [
            (s["actuator"], s["joint"], v["name"], v["unit"], v["nominal"], v["value"], *(v["ci95"] or (None, None)),
             v["probability"], v["status"])
            for s in self.document["servos"]
            for v in s["values"]
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=columns)

    def save(self, folder: str | Path) -> Path:
        """Write diagnosis.json, model.json, report.html and, where one was planned, the next experiment's commands.

        The answer is on disk before anything is drawn.
        """
        out = Path(folder)
        document = self.document_in(out)
        write_answer(document, out)
        write_whole(document, compose(document, self.evidence), self.commands, out)
        return out

    def save_video(self, path: str | Path) -> Path:
        """Write the robot's measured, predicted and corrected motion in the windows that the report shows, as .mp4
        (by ffmpeg), .gif or .webp.

        Raises BadInput for another suffix, an .mp4 without ffmpeg, and a robot whose motion cannot be drawn.
        """
        check_video(Path(path))
        if not self.evidence.clips:
            raise BadInput("there is no motion to show", "`video`", self.evidence.drawing)
        write_video(self.evidence.clips, Path(path))
        return Path(path)

    @cached_property
    def evidence(self) -> Evidence:
        """What the report draws beside the document."""
        return collect(self.made)

    def document_in(self, folder: Path) -> dict[str, Any]:
        """diagnosis.json as it is written to a folder."""
        return _placed(self.document, self.robot, self.paths, folder)

    def as_written(self) -> Written:
        return Written(self.document, "the diagnosis")

    def lines(self) -> list[str]:
        """The diagnosis in words."""
        return diagnosis_lines(self.document)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        frame = self.to_frame()
        return page(self.lines(), frame.assign(unit=frame["unit"].replace("1", "")))


def diagnose(
    robot: NominalRobot,
    runs: Runs,
    *,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    held_out: Sequence[str] = (),
    horizon: float = 1.0,
    seed: int = 0,
    start: Source | None = None,
    out: str | Path | None = None,
    command: str = "",
    progress: Progress = lambda stage, done: None,
    say: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Attribute the gap between the nominal model and the runs.

    Args:
        only, without: effects to consider alone, or to leave out (contract, section 6).
        held_out: runs (names or patterns) to keep out of every fit; by default they are chosen.
        horizon: length of a window, s.
        start: an earlier diagnosis of this robot, or its file: the search begins with its effects, and may drop them.
        out: folder that the answer is written to as soon as it stands, and everything in the end. A diagnosis that was
            stopped goes on from there when it is called again with the same robot, runs and options.
        command: the call as the report prints it; by default the command line that does the same.
        say: called with one sentence per intermediate result: a first look at the gap, and each better set of
            effects. With `out` the latest set is in its unfinished.json until the answer takes its place.

    Raises:
        BadInput: runs that cannot be used or compared, an effect or run that does not exist, an effect in `only` that
            the robot cannot have, or a start of another robot.
    """
    check_given(robot, runs)
    check_seconds(horizon, "horizon")
    because = not_commanded(robot.model, measured_over(robot.file, list(runs.names)))
    options = Options(
        horizon=horizon,
        only=possible_effects(only, "`only`", runs.models),
        without=effect_names(without, "`without`"),
        without_because=because,
        held_out=_kept(held_out, runs.names) if held_out else None,
        start={} if start is None else _start(start, robot),
    )
    said = command or _command(robot, runs, options, held_out, seed, start)
    folder = None if out is None else Path(out)
    checkpoint = checkpoint_in(folder, key_of(robot, runs, options, seed))
    if checkpoint.last is not None:
        progress("going on from where an earlier call was stopped", 0.01)
    elif folder is not None:
        (folder / SO_FAR).unlink(missing_ok=True)  # of other runs or options

    def answered(record: Record) -> None:
        if folder is not None:
            write_answer(_placed(_document(record, robot, runs, said), robot, runs.paths, folder), folder)

    made = run_diagnosis(
        runs.runs, runs.models, runs.noise, robot.file.tunable, options, np.random.default_rng(seed), progress,
        LEARNERS, answered, checkpoint, unheard if say is None else EarlyAnswers(robot, folder, say),
    )  # fmt: skip
    progress("planning the next experiment", 0.95)
    document = _document(made.diagnosis, robot, runs, said)
    logged = {c for r in runs for c in (*r.columns, *r.extra_columns)}
    proposal = propose(document, robot.model, excite_command(robot.given, Path()), seed, logged)
    document["next_experiment"] = proposal.next_experiment
    found = Diagnosis(robot, document, made, proposal.table, runs.paths)
    if folder is not None:
        progress("writing the report", 0.96)
        found.save(folder)
    checkpoint.close()
    return found


def _document(record: Record, robot: NominalRobot, runs: Runs, command: str) -> dict[str, Any]:
    """diagnosis.json, but for the next experiment made concrete and the places of files."""
    document = with_servos(to_document(record), robot)
    document["audit"] = [asdict(finding) for finding in runs.findings]
    document["command"] = command
    document["runs"] = run_digests(runs)
    document["verdict_sentence"] = sentence(document)
    for law in (e for e in document["explanation"] if e["effect"] == FITTED_LAW):
        law["sentence"] = sentence_of(law)
    if document["remainder"]:
        document["remainder"]["sentence"] = rest_sentence(document["remainder"])
    return document


def _placed(document: dict[str, Any], robot: NominalRobot, paths: Sequence[str], folder: Path) -> dict[str, Any]:
    """The document as it is written to a folder, with where its runs lie, seen from there."""
    following = document["next_experiment"]
    if following and following.get("excite"):
        following = {**following, "excite": excite_command(robot.given, folder)}
    model = placed(document["model"], robot, folder)
    files = [os.path.relpath(path, folder) for path in paths]
    return {**document, "model": model, "next_experiment": following, "run_files": files}


def _start(source: Source, robot: NominalRobot) -> Values:
    """The numbers of an earlier diagnosis. Raises BadInput for one of another robot."""
    earlier = written(source)
    settings_from(earlier, robot.model)
    return model_in(earlier)[1]


def _command(
    robot: NominalRobot, runs: Runs, options: Options, held_out: Sequence[str], seed: int, start: Source | None
) -> str:
    """The command line of a diagnosis; one that begins with a result needs that result saved."""
    words = ["residual-mpc", "diagnose", "--robot", robot.given, *runs.paths]
    for option, values in (("--only", options.only), ("--without", options.without), ("--held-out", held_out)):
        words += [word for value in values for word in (option, value)]
    if start is not None:
        words += ["--from", str(start) if isinstance(start, str | Path) else "earlier/diagnosis.json"]
    return shlex.join([*words, "--horizon", f"{options.horizon:g}", "--seed", str(seed), "--out", "out"])


def _kept(given: Sequence[str], names: Sequence[str]) -> tuple[KeptBack, ...]:
    """Runs by name, file or pattern."""
    out: list[KeptBack] = []
    for text in given:
        found = [n for n in names if any(n == t or fnmatchcase(n, t) for t in (text, Path(text).stem))]
        if not found:
            raise BadInput(f"no run matches {text!r}", "`held_out`", f"the runs are {', '.join(names[:12])}")
        out += [KeptBack(n) for n in found]
    return tuple(dict.fromkeys(out))
