"""A figure-eight on slow motors, a wheel too large and tyres that scrub in turns, in MuJoCo."""

from plants.wheeled.twin import Withheld
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, brisk_eight, in_mujoco
from scenarios.rover import rover

WITHHELD = Withheld(ratio=1.04, track=1.25, lag=0.2)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="figure_eight",
        summary="figure-eight in MuJoCo; withheld: motor lag, wheel mismatch, track width",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: in_mujoco(WITHHELD),
        withheld=WITHHELD.effects(),
        reference=brisk_eight,
        training_motions=TRAINING_MOTIONS,
    )
)
