"""A circle at a constant yaw rate (the paper's case E, driving) with a wrong track and wheel, in PyBullet."""

from plants.wheeled.motions import constant_yaw_rate
from plants.wheeled.twin import Withheld
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, SmoothStart, in_pybullet
from scenarios.rover import rover

WITHHELD = Withheld(ratio=0.95, track=1.35)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="constant_yaw_rate",
        summary="circle at a constant yaw rate in PyBullet; withheld: track width, wheel mismatch",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: in_pybullet(WITHHELD),
        withheld=WITHHELD.effects(),
        reference=lambda: SmoothStart(constant_yaw_rate(1.0, 0.2)),
        training_motions=TRAINING_MOTIONS,
    )
)
