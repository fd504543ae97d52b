"""What a diagnosis tells, and leaves in its folder, before it is finished."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.api.robot import NominalRobot
from residual_mpc.diagnosis.phases.early_answers import EarlyAnswer, FirstLook, SoFar
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.effects.library import BY_NAME
from residual_mpc.files import write_json
from residual_mpc.models.model_file import MODEL_SCHEMA
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.settings import TUNE
from residual_mpc.report.words.early import first_look_sentence, so_far_sentence

SO_FAR = "unfinished.json"
NOTE = (
    "The best set of effects when this file was written, on the windows of the search alone: none of it has been "
    "tested on held-out runs, and it has no intervals or probabilities. The diagnosis was running, or was stopped."
)


@dataclass(frozen=True, eq=False)
class EarlyAnswers:
    """Says each early answer, and writes the best set so far to `folder` (None: nowhere) as a model that every command
    takes with --model."""

    robot: NominalRobot
    folder: Path | None
    say: Callable[[str], None]

    def __call__(self, answer: EarlyAnswer) -> None:
        if isinstance(answer, FirstLook):
            self.say(first_look_sentence(look_document(answer)))
            return
        document = so_far_document(answer, self.robot)
        if self.folder is not None:
            write_json(self.folder / SO_FAR, document)
        self.say(so_far_sentence(document["unfinished"]))


def look_document(look: FirstLook) -> dict[str, Any]:
    """A first look as plain dicts and numbers."""
    leads = [{"effect": a.term.effect, "target": a.term.target, "shrink": a.shrink} for a in look.leads]
    figures = {"horizon": look.horizon, "gap": look.gap, "noise_floor": look.noise_floor, "channels": look.channels}
    clean: dict[str, Any] = finite({**figures, "leads": leads})
    return clean


def so_far_document(answer: SoFar, robot: NominalRobot) -> dict[str, Any]:
    """The best set so far as a model file (see `model_in`) that says under "unfinished" what it is."""
    explanation = []
    for term in answer.terms:
        parameters = {
            k.parameter: {
                "value": v,
                "unit": unit_of(robot.model, term, BY_NAME[term.effect].parameter(k.parameter).unit),
            }
            for k, v in answer.values.items()
            if k.effect != TUNE and k.term == term
        }
        explanation.append({"effect": term.effect, "target": term.target, "parameters": parameters})
    gap = {
        "before": answer.before, "after": answer.after, "noise_floor": answer.noise_floor,
        "horizon": answer.horizon, "windows": answer.windows,
    }  # fmt: skip
    document: dict[str, Any] = finite(
        {
            "schema": MODEL_SCHEMA,
            "robot": robot.model.name,
            "values": [{**k._asdict(), "value": v} for k, v in answer.values.items()],
            "leaves_out_outliers": False,
            "unfinished": {"gap": gap, "explanation": explanation, "note": NOTE},
        }
    )
    return document
