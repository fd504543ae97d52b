"""What a confirmation is given: the explanations of a diagnosis, new runs, and what was changed before them."""

from collections.abc import Mapping
from dataclasses import dataclass

from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.experiment.confirmation.known_change import KnownChange
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Values


@dataclass(frozen=True, eq=False)
class DiagnosedExplanation:
    """terms: what it has and the diagnosis' own explanation lacks (of the own one: all); instead_of: what they
    replace; values: of the whole model, before any known change."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values


@dataclass(frozen=True, eq=False)
class ConfirmationInput:
    """runs: the new ones, each with its nominal model in robots; noise, options: as a diagnosis has them. explanations:
    the diagnosis' own first; sigma: of the numbers that it gives an interval, in their units; dispersion: of its
    residuals. changes: made on the robot before these runs."""

    runs: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: Mapping[str, float]
    explanations: tuple[DiagnosedExplanation, ...]
    sigma: Mapping[Knob, float]
    dispersion: float
    changes: tuple[KnownChange, ...]
    options: Options
