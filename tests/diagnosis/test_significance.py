"""What the last fit makes nothing of is not named."""

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.evidence import least_sure
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.models.settings import Knob, Term

WINDOWS, SAMPLES = 60, 20
TRACK, DELAY = Knob("track_width", None, "scale"), Knob("command_delay", None, "delay")
MASS, COM = Knob("link_mass", "l1", "mass"), Knob("link_mass", "l1", "com")
ZONE = Knob("dead_zone", None, "width")


def fitted(values: dict[Knob, float], correlated: float = 0.0) -> Fit:
    """A fit under white residuals: each number's standard deviation is 0.01 / sqrt(1200), 0.0003, where the derivatives
    are not correlated."""
    rng, knobs = np.random.default_rng(0), tuple(values)
    j = rng.standard_normal((WINDOWS, SAMPLES, len(knobs)))
    if correlated:
        j[..., 1] = correlated * j[..., 0] + np.sqrt(1.0 - correlated**2) * j[..., 1]
    r = rng.standard_normal((WINDOWS, SAMPLES))
    terms, held = tuple(dict.fromkeys(k.term for k in knobs)), np.zeros(len(knobs), dtype=bool)
    return Fit(terms, knobs, values, np.full(len(knobs), 0.01), float(np.sum(r * r)), r, j, held)


def asked(fit: Fit, finer: dict[Knob, float] | None = None) -> Term | None:
    return least_sure(fit, np.arange(WINDOWS), finer or {}, settings=FitSettings())


def test_effects_far_from_none_stay() -> None:
    assert asked(fitted({TRACK: 1.002, DELAY: 0.002})) is None


def test_the_one_nearest_to_none_goes_first() -> None:
    assert asked(fitted({TRACK: 1.0002, DELAY: 0.0001})) == DELAY.term
    assert asked(fitted({TRACK: 1.0, DELAY: 0.0001})) == TRACK.term


def test_two_numbers_that_stand_for_each_other_are_asked_together() -> None:
    """Each alone may be nothing, both may not."""
    both = fitted({MASS: 0.002, COM: 0.002}, correlated=0.999)
    assert asked(both) is None
    assert asked(fitted({MASS: 0.0002, COM: -0.0002}, correlated=0.999)) == MASS.term


@pytest.mark.parametrize(("there", "stands"), [(0.0019, True), (0.0001, False), (-0.0005, False)])
def test_what_a_finer_time_step_would_take_away_goes(there: float, stands: bool) -> None:
    asked_of = asked(fitted({TRACK: 1.002, DELAY: 0.002}), {TRACK: 1.002, DELAY: there})
    assert asked_of == (None if stands else DELAY.term)


def test_a_finer_step_does_not_save_what_is_in_doubt_without_it() -> None:
    """Two numbers that stand for each other: what is near by itself would be far if one of them were taken alone."""
    apart = fitted({MASS: 0.0003, COM: -0.0003}, correlated=0.999)
    assert asked(apart) == MASS.term
    assert asked(apart, {MASS: 0.0003, COM: 1e-6}) == MASS.term


def test_a_threshold_is_not_asked() -> None:
    assert asked(fitted({ZONE: 1e-6})) is None


def test_what_ended_at_a_bound_where_it_does_nothing_goes() -> None:
    resting = fitted({TRACK: 1.002, ZONE: 0.0})
    resting.held[1] = True
    assert asked(resting) == ZONE.term
    apart = fitted({TRACK: 1.002, DELAY: 0.004})
    apart.held[1] = True
    assert asked(apart) is None
