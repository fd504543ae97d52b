"""The verdict of a comparison, and which changes are worth naming."""

from residual_mpc.comparison.records import Change, ComparedGap, GapRise
from residual_mpc.comparison.settings import ComparisonSettings


def verdict_of(
    named: bool,
    p_left: float,
    unexplained: float,
    gap: ComparedGap,
    lost: bool,
    settings: ComparisonSettings,
) -> str:
    """`same`: nothing beyond what units of one set differ, or no rise of the gap by that; `changed`: nothing beyond
    that is left, nor much of the rise of the gap. lost: whether no search found a significant change although every run
    after fits far worse."""
    differs = p_left <= settings.contrast.left
    if not named:
        larger = (lost or differs) and gap.after > settings.rises * gap.before
        return "unknown" if larger or (differs and gap.rise.visible) else "same"
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


def unexplained_share(rise: GapRise, far_from_before: bool = False) -> float:
    """Share of the rise that the changes leave; 0 where what is left is within two standard errors, unless it is more
    than half of a rise that is beyond two, or more than half where the gap stays far from that of the runs before."""
    if not rise.risen > 0.0 or rise.left <= 0.0:
        return 0.0
    share = min(rise.left / rise.risen, 1.0)
    beyond = rise.left > 2.0 * rise.left_error
    return share if beyond or (share > 0.5 and (rise.visible or far_from_before)) else 0.0
