"""Input of a confirmation: the explanations of a diagnosis, the new runs, and the changes made before them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.experiment.confirmation.known_change import KnownChange
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Values


@dataclass(frozen=True, eq=False)
class DiagnosedExplanation:
    """terms: the effects that it adds to the diagnosed explanation (of that one itself: all its effects); instead_of:
    the effects that they replace; values: parameters of the whole model, before any known change; parts: of a
    combination, the places of its alternatives."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values
    parts: tuple[int, ...] = ()


def with_combinations(explanations: Sequence[DiagnosedExplanation], most: int) -> tuple[DiagnosedExplanation, ...]:
    """The explanations, then at most so many combinations of alternatives that replace different effects.

    Each alternative of a diagnosis exchanges one ambiguous effect and keeps the others as they are named. With two
    ambiguities open, the truth may be on the other side of both. Smaller combinations come first.
    """
    own, *others = explanations
    found: list[DiagnosedExplanation] = []
    for size in range(2, len(others) + 1):
        for places in combinations(range(len(others)), size):
            chosen = [others[i] for i in places]
            gone = [t for e in chosen for t in e.instead_of]
            came = [t for e in chosen for t in e.terms]
            if len(set(gone)) == len(gone) and len(set(came)) == len(came) and all(e.instead_of for e in chosen):
                values = {k: v for k, v in own.values.items() if k.effect == TUNE or k.term not in gone}
                for e in chosen:
                    values |= {k: v for k, v in e.values.items() if k.effect != TUNE and k.term in e.terms}
                parts = tuple(i + 1 for i in places)
                found.append(DiagnosedExplanation(tuple(came), tuple(gone), values, parts))
            if len(found) == most:
                return (*explanations, *found)
        if size > 2 and not found:
            break
    return (*explanations, *found)


@dataclass(frozen=True, eq=False)
class ConfirmationInput:
    """runs: the new runs; robots: the nominal model of each; noise, tunable, options: as for a diagnosis.
    explanations: the diagnosed one, then its alternatives; sigma: standard deviations of the parameters that have
    an interval, in their units; dispersion: of the residuals of the diagnosis. changes: made to the robot before
    these runs."""

    runs: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: Mapping[str, float]
    tunable: tuple[str, ...]
    explanations: tuple[DiagnosedExplanation, ...]
    sigma: Mapping[Knob, float]
    dispersion: float
    changes: tuple[KnownChange, ...]
    options: Options
