"""What makes a named effect doubtful makes the other members of its group doubtful as well."""

from types import SimpleNamespace
from typing import Any

from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.certainty import steadiness
from residual_mpc.diagnosis.phases.describe import _likely, as_named, shared
from residual_mpc.diagnosis.phases.validate import Validated
from residual_mpc.diagnosis.results.records import Candidate, Cause
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.variation_records import Instant, Variation
from residual_mpc.models.settings import Term

GAIN, RATIO, RADIUS, DELAY = (
    Term(name, None) for name in ("actuator_gain", "wheel_radius_mismatch", "wheel_radius", "command_delay")
)


def test_members_share_the_doubt_of_the_named_one() -> None:
    doubt = {GAIN: 0.25, DELAY: 0.9}
    assert shared(doubt, [((GAIN,), (RATIO,))]) == {**doubt, RATIO: 0.25}


def test_a_pair_of_members_shares_it_and_named_effects_keep_their_own() -> None:
    doubt = {GAIN: 0.25, DELAY: 0.9}
    assert shared(doubt, [((GAIN,), (RADIUS, RATIO))]) == {**doubt, RADIUS: 0.25, RATIO: 0.25}
    assert shared(doubt, [((GAIN,), (DELAY,))]) == doubt


def test_a_member_shares_the_doubt_of_the_one_whose_place_it_would_take() -> None:
    """A named effect that is only part of another member does not count."""
    doubt = {GAIN: 0.9, DELAY: 0.25}
    assert shared(doubt, [((GAIN,), (RATIO, DELAY))]) == {**doubt, RATIO: 0.9}


def test_of_two_groups_the_less_doubtful_counts_in_either_order() -> None:
    doubt = {GAIN: 0.25, DELAY: 0.9}
    groups = [((GAIN,), (RATIO,)), ((DELAY,), (RATIO,))]
    assert shared(doubt, groups) == shared(doubt, groups[::-1]) == {**doubt, RATIO: 0.9}


def test_a_group_without_a_named_effect_changes_nothing() -> None:
    assert shared({DELAY: 0.9}, [((RADIUS,), (RATIO,))]) == {DELAY: 0.9}


def test_an_effect_that_follows_another_law_on_one_joint_is_doubtful_on_every_joint() -> None:
    scales = [Term("sensor_scale", f"position.j{k}") for k in (1, 2)]
    half = ResultSettings().support.unsupported
    turning = Variation(by_position={"low": 1.05, "middle": 1.05, "high": 1.03})
    factors = [steadiness(t, {scales[0]: turning}, ResultSettings()) for t in (*scales, DELAY)]
    assert factors == [half, half, 1.0]
    runs = Variation(by_run={"run1": 1.05, "run2": 1.03})
    assert steadiness(scales[0], {scales[0]: runs}, ResultSettings()) == 1.0


def test_one_that_begins_or_restricts_some_runs_only_is_doubtful_itself() -> None:
    left, right = Term("rate_limit", "left"), Term("rate_limit", "right")
    half = ResultSettings().support.unsupported
    for variation in (Variation(since=Instant("run2", 3.0)), Variation(by_run={"run1": 300.0}, free=("run2",))):
        assert steadiness(left, {left: variation}, ResultSettings()) == half
        assert steadiness(right, {left: variation}, ResultSettings()) == 1.0


def test_an_explanation_whose_law_is_another_is_partial_however_small_the_gap() -> None:
    scale = Term("sensor_scale", "position.j1")
    steady, thirds = {}, {scale: Variation(by_motion={"small": 1.0, "medium": 1.1, "large": 1.2})}
    runs = {scale: Variation(by_run={"run1": 1.0, "run2": 1.2})}
    gaps: Any = SimpleNamespace(verdict=("effects", 0.0))
    found = [Validated(gaps, None, {}, Options(), varying).verdict for varying in (steady, thirds, runs)]
    assert found == ["effects", "partial", "effects"]
    nothing: Any = SimpleNamespace(verdict=("unknown", 1.0))
    assert Validated(nothing, None, {}, Options(), thirds).verdict == "unknown"


def test_what_is_named_is_likely_with_what_the_runs_do_not_tell_from_it() -> None:
    """A group of three at 0.2 each is likelier than not, one at 0.07 beside four others is not."""
    named = [Cause(GAIN, 0.2, (), ""), Cause(DELAY, 0.4, (), "")]
    members = [Candidate(t, 0.2, 0.0) for t in (GAIN, RATIO, RADIUS)]
    group = ((GAIN,), (RATIO,), (RADIUS,))
    assert _likely(named, members, [group])
    assert not _likely(named, members, [group[:2]])
    assert not _likely(named, members, []) and _likely([Cause(DELAY, 0.5, (), "")], [], [])


def test_a_cause_has_one_probability() -> None:
    """What a number at its bound takes from a cause is taken from the candidate as well, which may fall in rank."""
    looked_at = (Candidate(DELAY, 0.68, 0.9), Candidate(GAIN, 0.5, 0.8), Candidate(RATIO, 0.1, 0.7))
    found = as_named(looked_at, (Cause(DELAY, 0.34, (), ""), Cause(GAIN, 0.5, (), "")))
    assert [(c.term, c.probability) for c in found] == [(GAIN, 0.5), (DELAY, 0.34), (RATIO, 0.1)]
    assert [c.shrink for c in found] == [0.8, 0.9, 0.7]
