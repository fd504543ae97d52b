"""What `excite` says of a plan for several explanations."""

from residual_mpc.api.excitation import _lines


def plan(separates, motions, told_apart, pairs=3):
    return {
        "purpose": "tell apart", "parts": ["a", "b", "c"], "sensors": [], "switches": False,
        "played": [name for name, _ in motions], "told_apart": told_apart, "pairs": pairs, "separates": separates,
        "motions": [{"name": name, "ratio": 0.1, "separates": count} for name, count in motions],
    }  # fmt: skip


def test_pairs_are_counted_where_there_are_several():
    said = _lines(plan(3, [("spins", 3), ("steps", 1)], True))
    assert said[2:] == ["    spins: separates 3 of 3 pairs", "    steps: separates 1 of 3 pairs"]


def test_a_plan_that_leaves_pairs_says_how_many():
    said = _lines(plan(2, [("spins", 2)], False))[-1]
    assert said.startswith("  it separates 2 of 3 pairs; no motion is expected to separate the others reliably")
    both = _lines(plan(2, [("spins", 1), ("steps", 1)], False))[-1]
    assert both.startswith("  together they separate 2 of 3 pairs; ")


def test_a_plan_in_vain_says_so():
    said = _lines(plan(0, [("spins", 0)], False, pairs=1))
    assert said[2] == "    spins: expected likelihood-ratio statistic in favour of the true cause 0.1"
    assert said[3].startswith("  no motion is expected to separate them reliably")


def test_what_cannot_be_revealed_is_told_by_effect_and_by_target():
    """An effect that shows at some joints is not said to be hidden at all."""
    unseen = [("end_stop", j, True) for j in ("a", "b")] + [("link_mass", "base", False), ("armature", "finger", False)]
    unseen += [(f"law{k}", "finger", False) for k in range(6)] + [("viscous_friction", "a", False)]
    said = _lines({
        "purpose": "protocol", "parts": [], "motions": [{"name": "chirp"}],
        "not_testable": [{"effect": e, "target": t, "nowhere": n} for e, t, n in unseen],
    })  # fmt: skip
    assert said == [
        "1 motion: chirp",
        "  these motions cannot reveal: end_stop",
        "  these motions cannot reveal: link_mass at base",
        "  these motions cannot reveal: most effects at finger",
        "  these motions cannot reveal: viscous_friction at a",
    ]
