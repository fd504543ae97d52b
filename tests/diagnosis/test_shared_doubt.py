"""What makes a named effect doubtful makes the other members of its group doubtful as well."""

from residual_mpc.diagnosis.phases.describe import shared
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
