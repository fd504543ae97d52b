"""What to log or drive next, so that a confounded group comes apart."""

from collections.abc import Iterable

from residual_mpc.diagnosis.results.verdict import Verdict
from residual_mpc.effects.equivalents import SEPARATIONS
from residual_mpc.models.settings import Term

EXPLORE = "repeat the motion with the largest gap twice, and add one that reaches where no run has been"


def next_experiment(
    groups: Iterable[tuple[tuple[Term, ...], ...]], wheeled: bool, verdict: Verdict
) -> dict[str, object] | None:
    """The diagnosis' `next_experiment`: for the first group (or pair of close rivals), else for a gap that is left;
    None otherwise."""
    for group in groups:
        names = {t.effect for member in group for t in member}
        for separation in SEPARATIONS:
            what = separation.wheeled if wheeled else separation.arm
            if separation.pair <= names and what:
                return {"parts": sorted(separation.pair), "what": what, "commands": None}
        if len(group) > 1:
            what = (
                "drive spins, straights both ways at two headings, and both signs of speed times a multisine of turning"
                if wheeled
                else "send a chirp, steps and a slow loaded sweep, with the motor off for a while"
            )
            return {"parts": sorted(names), "what": what, "commands": None}
    if verdict in ("unknown", "partial"):
        return {"parts": [], "what": EXPLORE, "commands": None}
    return None
