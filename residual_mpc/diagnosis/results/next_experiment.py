"""What to log or drive next, so that a confounded group comes apart. The table holds measured separations."""

from collections.abc import Iterable

from residual_mpc.diagnosis.results.verdict import Verdict
from residual_mpc.models.settings import Term

ENCODERS = "log the wheel encoders (velocity.left and velocity.right)"
EXPLORE = "drive the motion that shows the gap most, twice, and one that goes where no run has been"
TABLE: tuple[tuple[frozenset[str], str, str], ...] = (
    (frozenset({"command_delay", "sensor_delay"}), ENCODERS, "log stretches with the motor off (enabled.* = 0)"),
    (frozenset({"actuator_gain", "wheel_radius"}), ENCODERS, ""),
    (frozenset({"actuator_gain", "wheel_radius_mismatch"}), ENCODERS, ""),
    (frozenset({"wheel_radius", "slope"}), "drive straight at two headings, both ways", ""),
    (
        frozenset({"wheel_radius", "longitudinal_slip"}),
        "drive at constant speed as well as with hard accelerations",
        "",
    ),
    (frozenset({"lateral_slip", "sensor_mounting"}), "spin in place, and drive arcs at varying speed", ""),
    (
        frozenset({"actuator_lag", "command_delay"}),
        "drive steps and fast multisines of both wheels",
        "send steps and a chirp",
    ),
    (frozenset({"coulomb_friction", "backlash"}), "", "send a chirp"),
    (frozenset({"payload", "joint_compliance"}), "", "log stretches with the motor off (enabled.* = 0)"),
    (frozenset({"viscous_friction", "command_delay"}), "", "send a chirp"),
    (frozenset({"viscous_friction", "actuator_lag"}), "", "send a chirp"),
    (frozenset({"payload", "armature"}), "", "send steps, and hold the arm at several heights"),
    (frozenset({"coulomb_friction", "load_dependent_friction"}), "", "repeat the motion under a second payload"),
    (frozenset({"coulomb_friction", "stribeck_friction"}), "", "move slowly and fast: creep, then chirp"),
    (frozenset({"payload", "link_mass"}), "", "repeat the motion with a known payload"),
)


def next_experiment(
    groups: Iterable[tuple[tuple[Term, ...], ...]], wheeled: bool, verdict: Verdict
) -> dict[str, object] | None:
    """The diagnosis' `next_experiment`: for the first group (or pair of close rivals), else for a gap that is left;
    None otherwise."""
    for group in groups:
        names = {t.effect for member in group for t in member}
        for pair, on_wheels, on_arm in TABLE:
            what = on_wheels if wheeled else on_arm
            if pair <= names and what:
                return {"parts": sorted(pair), "what": what, "commands": None}
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
