"""A delivery route between walls that cost something to touch, over a slow radio link, in MuJoCo."""

from plants.wheeled.motions import route
from plants.wheeled.twin import Withheld
from plants.withheld_effects import named
from residual_mpc.effects.command import COMMAND_DELAY
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, DelayedCommands, SmoothStart, in_mujoco
from scenarios.rover import rover

WITHHELD = Withheld(track=1.2)
DELAY = 0.15  # s, of the radio link

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="route",
        summary="a route with soft limits in MuJoCo; withheld: command delay, track width",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: DelayedCommands(in_mujoco(WITHHELD), DELAY),
        withheld=named((COMMAND_DELAY, DELAY)) | WITHHELD.effects(),
        reference=lambda: SmoothStart(route()),
        limits=(("pose.y", -0.01, 0.81),),
        training_motions=TRAINING_MOTIONS,
    )
)
