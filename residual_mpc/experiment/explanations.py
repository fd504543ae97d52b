"""What a diagnosis.json leaves open: its explanation, and those that its runs could not tell from it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.experiment.lasting import lasting
from residual_mpc.models.fits import check_fits
from residual_mpc.models.logged_laws import at_values
from residual_mpc.models.model_file import values_of
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values


@dataclass(frozen=True)
class Explanation:
    """name: its effects, as they are printed. values: of the whole model, to begin with."""

    name: str
    values: Values


def explanations_of(
    document: Mapping[str, Any], robot: Robot, where: str, parts: Collection[str] = ()
) -> tuple[Explanation, ...]:
    """The explanation of a diagnosis.json, then its alternatives; without these there is one. parts: effects that are
    to be told apart, whose alternatives alone count; all where there are none, or none is an alternative.

    Raises BadInput where the diagnosis is of another robot, cannot be read, or names what the robot lacks.
    """
    try:
        of = document["robot"]
        own, others = lasting(document)
        rows = [(own, document["model"]["values"])]
        came = [a for a in others if _names(a["effects"]) & set(parts)]
        swapped = [a for a in came if _names(a.get("instead_of", ())) & set(parts)]
        rows += [(a["effects"], a["values"]) for a in swapped or came or others]
        found = tuple(Explanation(_named(effects), at_values(values_of(values))) for effects, values in rows)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"its explanations cannot be read: {error!r}", where, "diagnose the runs again") from error
    if of != robot.name:
        raise BadInput(
            f"the diagnosis must be of {robot.name!r}, got one of {of!r}", where, "give its robot as `robot`"
        )
    for explanation in found:
        check_fits(explanation.values, robot, of, where)
    warn_of_differences(document["model"], robot, where)
    return found


def _names(effects: Sequence[Mapping[str, Any]]) -> set[str]:
    return {e["effect"] for e in effects}


def _named(effects: Sequence[Mapping[str, Any]]) -> str:
    return " + ".join(e["effect"] + (f" [{e['target']}]" if e["target"] else "") for e in effects)
