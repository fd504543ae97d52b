"""Back and forth (the paper's case B) with slow motors and a wheel too large, in MuJoCo."""

from plants.wheeled.motions import back_and_forth
from plants.wheeled.twin import Withheld
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, SmoothStart, in_mujoco
from scenarios.rover import rover

WITHHELD = Withheld(ratio=1.06, lag=0.25)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="back_and_forth",
        summary="back and forth in MuJoCo; withheld: motor lag, wheel mismatch",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: in_mujoco(WITHHELD),
        withheld=WITHHELD.effects(),
        reference=lambda: SmoothStart(back_and_forth()),
        training_motions=TRAINING_MOTIONS,
    )
)
