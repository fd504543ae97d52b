"""What these runs cannot show, and why: an effect whose plausible values move the prediction by less than the noise."""

from dataclasses import dataclass

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.screen import reaches
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


@dataclass(frozen=True)
class NotTestable:
    term: Term
    why: str


def not_testable(
    problem: Problem, base: Fit, terms: tuple[Term, ...], *, settings: SearchSettings = SearchSettings()
) -> tuple[NotTestable, ...]:
    """The candidates that even their strongest probe does not show; `terms` are never among them."""
    reach = reaches(problem, base, problem.space.candidates, settings.visible, settings=settings)
    ruled_out = tuple(NotTestable(t, why) for t, why in problem.space.ruled_out.items())
    return ruled_out + tuple(
        NotTestable(t, BY_NAME[t.effect].unseen)
        for t in problem.space.candidates
        if reach[t] < settings.visible and t not in terms
    )
