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
