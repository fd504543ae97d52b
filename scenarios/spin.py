"""Spin in place, both ways (the paper's case A), on tyres that scrub and a wheel too small, in PyBullet."""

from plants.wheeled.motions import spin_in_place
from plants.wheeled.twin import Withheld
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, SmoothStart, in_pybullet
from scenarios.rover import rover

WITHHELD = Withheld(ratio=0.93, track=1.3)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="spin",
        summary="spin in place in PyBullet; withheld: wheel mismatch, track width",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: in_pybullet(WITHHELD),
        withheld=WITHHELD.effects(),
        reference=lambda: SmoothStart(spin_in_place()),
        training_motions=TRAINING_MOTIONS,
    )
)
