"""The verdict of a comparison depends on the named changes, the remaining difference and the unexplained gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.comparison.gaps import rise_of
from residual_mpc.comparison.records import Change, ComparedGap, GapRise
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.verdict import unexplained_share, verdict_of, worth_naming
from residual_mpc.models.settings import Term

RISEN, NOT_RISEN = GapRise(0.16, 0.07, 0.01, 0.01), GapRise(0.01, 0.01, 0.01, 0.01)


def gap(rise: GapRise, after: float = 0.2, explained: float = 0.1) -> ComparedGap:
    """Gaps of 0.1 before, and after without and with the changes."""
    return ComparedGap(0.3, 0.4, 0.1, after, explained, rise, 0.05, 1.0, (40, 40), 4, {}, {})


def share_of(rise: GapRise, after: float = 0.2, explained: float = 0.1) -> float:
    return unexplained_share(gap(rise, after, explained), ComparisonSettings())


@pytest.mark.parametrize(
    ("named", "p_left", "unexplained", "compared", "lost", "verdict"),
    [
        (False, 0.5, 0.0, gap(RISEN), False, "same"),
        (False, 0.5, 0.0, gap(RISEN, 0.4), False, "same"),
        (False, 0.001, 0.0, gap(RISEN), False, "unknown"),
        (False, 0.001, 0.0, gap(RISEN, 0.13), False, "unknown"),
        (False, 0.001, 0.0, gap(RISEN, 0.12), False, "same"),  # as other motions may make it
        (False, 0.001, 0.0, gap(NOT_RISEN), False, "same"),  # errors of another kind, as large as before
        (False, 0.001, 0.0, gap(NOT_RISEN, 0.4), False, "unknown"),  # scattered, but four times as large
        (False, 0.5, 0.0, gap(RISEN, 0.4), True, "unknown"),  # not significant, but every run after fits far worse
        (False, 0.5, 0.0, gap(RISEN), True, "same"),
        (True, 0.5, 0.1, gap(RISEN, 0.4), True, "changed"),
        (True, 0.001, 0.1, gap(RISEN), True, "partial"),
        (True, 0.5, 0.5, gap(RISEN), False, "partial"),  # not significant, but half of the increase remains
    ],
)  # fmt: skip
def test_verdict(
    named: bool, p_left: float, unexplained: float, compared: ComparedGap, lost: bool, verdict: str
) -> None:
    assert verdict_of(named, p_left, unexplained, compared, lost, ComparisonSettings()) == verdict


def test_the_share_that_is_left_is_of_the_rise() -> None:
    assert share_of(GapRise(0.16, 0.07, 0.0, 0.0)) == pytest.approx(0.07 / 0.16)
    assert share_of(GapRise(0.16, -0.05, 0.0, 0.0)) == 0.0
    assert share_of(GapRise(0.16, 0.7, 0.0, 0.0)) == 1.0
    assert share_of(GapRise(-0.05, 0.07, 0.0, 0.0)) == 0.0  # nothing rose


def test_what_is_left_within_the_scatter_of_the_windows_is_not_counted() -> None:
    assert share_of(GapRise(0.010, 0.013, 0.01, left_error=0.01)) == 0.0
    assert share_of(GapRise(0.010, 0.013, 0.01, left_error=0.001)) == 1.0
    assert share_of(GapRise(0.030, 0.009, 0.01, left_error=0.01)) == 0.0


def test_more_than_half_of_a_clear_rise_is_not_explained_however_the_rest_scatters() -> None:
    assert share_of(GapRise(0.0223, 0.0173, 0.01, left_error=0.01)) == pytest.approx(0.0173 / 0.0223)


def test_a_gap_that_stays_far_from_that_before_is_not_explained_by_half_of_the_rise() -> None:
    """Where predictions diverge, they scatter too much for the rise of the gap, or what remains, to be significant."""
    scattered = GapRise(0.28, 0.16, risen_error=0.2, left_error=0.2)
    assert share_of(scattered) == 0.0
    assert share_of(scattered, 0.3, 0.2) == pytest.approx(0.16 / 0.28)
    assert share_of(GapRise(0.28, 0.1, 0.2, 0.2), 0.3, 0.2) == 0.0


def test_changes_with_which_predictions_diverge_explain_nothing() -> None:
    """Of the capped squares nothing rose: the windows that diverge are few."""
    capped = GapRise(-0.01, -0.02, 0.2, 0.2)
    assert share_of(capped, 0.5, 0.6) == 1.0 and share_of(capped, 0.09, 0.16) == 1.0
    assert share_of(capped, 0.5, 0.14) == 0.0  # near the gap before
    assert share_of(capped, 0.5, 0.4) == pytest.approx(0.15 / 0.24)


def test_the_error_of_a_rise_is_that_of_a_mean_of_its_stretches() -> None:
    rng = np.random.default_rng(0)
    each, unit = rng.uniform(0.0, 1.0, size=60), np.repeat(np.arange(60), 4)
    later = unit >= 30
    made = rise_of(np.repeat(each, 4), np.repeat(each, 4), np.zeros(240), later, unit)
    assert made.risen == pytest.approx(each[30:].mean() - each[:30].mean())
    assert made.left == pytest.approx(-each[:30].mean())
    assert made.left_error == pytest.approx(np.std(each[:30], ddof=1) / np.sqrt(30), rel=1e-6)
    assert rise_of(np.repeat(each, 4), np.repeat(each, 4), np.zeros(240), later, later.astype(int)).left_error == 0.0


def test_what_both_sets_teach_about_the_robot_is_credited_to_no_change() -> None:
    """The model of the runs before misses three times as much after; fitted to both sets without a change it misses as
    little as with it."""
    later, unit = np.arange(80) >= 40, np.arange(80) // 4
    before, both = np.where(later, 0.03, 0.01), np.where(later, 0.02, 0.01)
    assert rise_of(before, both, both, later, unit).left == rise_of(before, both, both, later, unit).risen
    assert share_of(rise_of(before, both, both, later, unit)) == 1.0


def test_a_prediction_that_diverges_does_not_hide_what_the_changes_leave() -> None:
    """Of forty windows of ten stretches each set one diverges in the later set. The change explains a third of what
    the others miss; the mean of the squared gaps would be that of the one window."""
    same = np.concatenate([np.full(40, 0.01), np.full(40, 0.16)])
    changed = np.concatenate([np.full(40, 0.01), np.full(40, 0.11)])
    same[77], changed[77] = 90.0, 80.0
    later, unit = np.arange(80) >= 40, np.arange(80) // 4
    assert share_of(rise_of(same, same, changed, later, unit)) == pytest.approx(0.122 / 0.171, abs=0.01)


def test_where_no_change_is_named_none_explains_the_gap() -> None:
    figures = {"before": 0.1, "after": 0.5, "after_explained": 0.6, "noise_floor": 0.05}
    compared = replace(gap(RISEN, 0.5, 0.6), channels={"pose.x": figures}).of_no_change
    assert compared.after_explained == 0.5 and compared.channels["pose.x"]["after_explained"] == 0.5
    assert compared.before == 0.1 and compared.channels["pose.x"]["noise_floor"] == 0.05


def test_changes_that_explain_next_to_nothing_are_not_named() -> None:
    settings = ComparisonSettings()
    one, jumps = (Change(Term(name, None), 0.05, 0.01, (), "", None) for name in ("payload", "sensor_outliers"))
    assert worth_naming((one,), (), "partial", "unknown", 0.05, settings) == ((), "unknown")
    assert worth_naming((one,), (), "partial", "same", 0.05, settings) == ((), "same")
    assert worth_naming((one,), (), "partial", "unknown", 0.29, settings) == ((), "unknown")
    assert worth_naming((one, jumps), (jumps,), "partial", "unknown", 0.05, settings) == ((jumps,), "partial")
    assert worth_naming((one,), (), "partial", "unknown", 0.3, settings) == ((one,), "partial")
    assert worth_naming((), (), "same", "same", 0.05, settings) == ((), "same")
