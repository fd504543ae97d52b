"""The verdict of a comparison, and which changes are worth naming."""

from residual_mpc.comparison.records import Change, ComparedGap
from residual_mpc.comparison.settings import ComparisonSettings


def verdict_of(
    named: bool,
    p_left: float,
    unexplained: float,
    gap: ComparedGap,
    lost: bool,
    settings: ComparisonSettings,
) -> str:
    """`same`: nothing beyond what units of one set differ, or no rise of the gap by that, or a small one; `changed`:
    nothing beyond that is left, nor much of the rise of the gap. lost: whether no search found a significant change
    although every run after fits far worse."""
    differs = p_left <= settings.contrast.left
    if not named:
        larger = (lost or differs) and gap.after > settings.rises * gap.before
        risen = gap.rise.visible and gap.after > settings.risen * gap.before
        return "unknown" if larger or (differs and risen) else "same"
    return "partial" if differs or unexplained > settings.unexplained else "changed"


def worth_naming(
    considered: tuple[Change, ...], jumping: tuple[Change, ...], verdict: str, without: str, sure: float,
    settings: ComparisonSettings,
) -> tuple[tuple[Change, ...], str]:  # fmt: skip
    """The changes to name and the verdict. Changes that explain next to nothing of the rise are not named; outliers
    are counted, not explained, and stay. without: the verdict where nothing is named; sure: the largest probability
    that a change may have."""
    if not considered or sure >= settings.named:
        return considered, verdict
    return jumping, verdict if jumping else without


def unexplained_share(gap: ComparedGap, settings: ComparisonSettings) -> float:
    """Share of the rise of the squared gap that the changes leave; 0 where what is left is within two standard errors,
    unless it is more than half of a rise that is beyond two. Where the gap stays far from that of the runs before, more
    than half counts however the windows scatter, and windows whose predictions diverge count in full."""
    far = gap.after_explained > settings.worse * gap.before
    share = max(_left(gap.rise.risen, gap.rise.left), _left_of_gaps(gap) if far else 0.0)
    beyond = gap.rise.left > 2.0 * gap.rise.left_error
    return share if beyond or (share > 0.5 and (gap.rise.visible or far)) else 0.0


def _left(risen: float, left: float) -> float:
    return min(left / risen, 1.0) if risen > 0.0 and left > 0.0 else 0.0


def _left_of_gaps(gap: ComparedGap) -> float:
    """The same by the gaps themselves; all of it where the gap is larger with the changes than it was before, and had
    not risen."""
    if gap.after <= gap.before:
        return 1.0
    return _left(gap.after**2 - gap.before**2, gap.after_explained**2 - gap.before**2)
