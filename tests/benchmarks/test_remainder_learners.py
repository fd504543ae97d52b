"""The table of what learners remove of the gaps that diagnoses leave."""

from typing import Any

from benchmarks.remainder_learners import row


def diagnosis(by: str | None, asked: tuple[str, ...], shrink: float) -> dict[str, Any]:
    return {"learned": {"by": by, "asked": list(asked)}, "unexplained": {"learned_residual_shrink": shrink}}


def test_a_row_counts_what_was_chosen_and_lists_what_it_removed() -> None:
    both = ("ridge", "network")
    cases = [diagnosis(None, (), 0.0), diagnosis(None, both, 0.0), diagnosis("network", both, 0.827)]
    assert row("one_sided_turning", cases) == "| one_sided_turning | 3 | 1 | 1 | 0 | 1 | 83 |"
