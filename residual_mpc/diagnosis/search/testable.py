"""What these runs cannot show, and why: an effect whose plausible values move the prediction by less than the noise."""

from dataclasses import dataclass

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.screen import reaches
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Term

WHY = {
    "dead_zone": "no small commands near which it would act",
    "saturation": "no command near the actuator's limit",
    "voltage_sag": "the runs are too short for the supply to weaken",
    "backlash": "the motion hardly reverses",
    "stribeck_friction": "no slow motion in which the friction would rise",
    "load_dependent_friction": "the torque hardly varies",
    "joint_compliance": "the torque that the gear carries hardly varies",
    "link_length": "the joints before it hardly move, or carry little",
    "track_width": "the robot hardly turns",
    "lateral_slip": "the robot hardly turns while it drives",
    "longitudinal_slip": "the robot hardly accelerates",
    "sensor_mounting": "the robot hardly turns",
    "sensor_bias": "the robot hardly drives in the direction that it biases",
}


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
        NotTestable(t, WHY.get(t.effect, "its strongest plausible dose moves the prediction by less than the noise"))
        for t in problem.space.candidates
        if reach[t] < settings.visible and t not in terms
    )
