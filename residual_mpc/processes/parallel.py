"""Many calls at once, their outcomes in turn, and a word on how far they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

Progress = Callable[[str, float], None]  # what came last, and the share that is done


def silent(text: str, done: float) -> None:
    """For who wants no progress."""


def run_in_parallel(calls: Iterable[Any], names: Sequence[str], progress: Progress, **parallel: Any) -> list[Any]:
    """The outcomes of joblib's delayed calls, in their order; parallel: how joblib's Parallel is to run them."""
    from joblib import Parallel

    outcomes = []
    for name, outcome in zip(names, Parallel(return_as="generator", **parallel)(calls), strict=True):
        outcomes.append(outcome)
        progress(f"{name} ({len(outcomes)} of {len(names)})", len(outcomes) / len(names))
    return outcomes
