"""A change is judged by what it explains alone, and not by what the effect explains on both sets."""

from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.search import fitted_leads
from residual_mpc.comparison.sets import cut
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import change_space
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.space import build_space
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY, LIMIT = (Term(effect, None, True) for effect in ("command_delay", "saturation"))


def drops(before: dict[str, dict[str, float]], after: dict[str, dict[str, float]]) -> dict[Term, float]:
    """By how much a delay and a limit lower the cost as changes, each in an account that lacks both."""
    sets = [[rover_run(f"{name}{k}", effects, 12.0, seed=10 * i + k) for k in range(3)]
            for i, (name, effects) in enumerate((("before", before), ("after", after)))]  # fmt: skip
    settings = ComparisonSettings()
    two = cut(sets[0], sets[1], [ROVER] * 6, SIGMA, 1.0, settings.results.data)
    space = change_space(build_space(two.fitting, (), ("command_delay", "saturation")))
    problem = build_problem(two.fitting, space, two.fitting.sigma, two.scales.motion)
    current = fit_all(problem, [{}], settings=settings.results.fit)[0]
    probes = {DELAY: {Knob(*DELAY[:2], "delay", True): 0.05}, LIMIT: {Knob(*LIMIT[:2], "limit", True): 5.0}}
    leads = [Contrast(term, probe, 1.0, 1.0, 1.0, 5.0, 1e-3, 0.1) for term, probe in probes.items()]
    return {one.lead.term: one.drop for one in fitted_leads(problem, current, leads, settings)}


def test_what_both_sets_have_is_no_change() -> None:
    """The later runs fit better with a limit of their own, but as well with one that both sets have."""
    both = {"saturation": {"limit": 4.0}}
    found = drops(both, both)
    assert found[LIMIT] < 0.0


def test_what_one_set_has_is_one() -> None:
    found = drops({}, {"saturation": {"limit": 4.0}})
    assert found[LIMIT] > 1000.0 and found[LIMIT] > 3.0 * found[DELAY]
