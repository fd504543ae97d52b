"""Input of a confirmation: the explanations of a diagnosis, the new runs, and the changes made before them."""

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
    """terms: the effects that it adds to the diagnosed explanation (of that one itself: all its effects); instead_of:
    the effects that they replace; values: parameters of the whole model, before any known change."""

    terms: EffectSet
    instead_of: EffectSet
    values: Values


@dataclass(frozen=True, eq=False)
class ConfirmationInput:
    """runs: the new runs; robots: the nominal model of each; noise, tunable, options: as for a diagnosis. explanations:
    the diagnosed one, then its alternatives; sigma: standard deviations of the parameters that have an interval, in
    their units; dispersion: of the residuals of the diagnosis. changes: made to the robot before these runs."""

    runs: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: Mapping[str, float]
    tunable: tuple[str, ...]
    explanations: tuple[DiagnosedExplanation, ...]
    sigma: Mapping[Knob, float]
    dispersion: float
    changes: tuple[KnownChange, ...]
    options: Options
