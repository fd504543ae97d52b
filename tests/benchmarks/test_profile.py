"""The profile of a diagnosis: stages as they are reported, and the steps of the replays in them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.profile import Clock, table


def test_replays_count_in_the_stage_in_which_they_are_made() -> None:
    clock = Clock()
    block: Any = SimpleNamespace(where=slice(0, 5), drive=SimpleNamespace(steps=100, lead=20))
    replay = clock.counted(lambda data, block, settings, nudge: np.zeros(1))
    clock.progress("searching for effects", 0.1)
    replay(None, block, SimpleNamespace(rows=3), None)
    clock.progress("searching (1 effect so far)", 0.2)  # belongs to the same stage
    replay(None, block, SimpleNamespace(rows=1), None)
    clock.progress("fitting on all windows", 0.75)
    clock.enter(clock.now)
    assert (clock.stages["search"].rows, clock.stages["search"].steps) == (20, 2400)
    assert clock.stages["last fit"].rows == 0
    text = table("arm", clock, ("payload",))
    assert "arm: names payload" in text
    assert text.splitlines()[-1].split()[0] == "all"
    assert "20" in text.splitlines()[-1]
