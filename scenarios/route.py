"""A delivery route between walls that cost something to touch, over a slow radio link, in MuJoCo."""

from plants.wheeled.motions import route
from plants.wheeled.twin import Withheld
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.robots import TRAINING_MOTIONS, DelayedCommands, SmoothStart, in_mujoco
from scenarios.rover import rover

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="route",
        summary="a route with soft limits in MuJoCo; withheld: command delay, track width",
        plant="diff_drive",
        setup=rover,
        simulator=lambda: DelayedCommands(in_mujoco(Withheld(track=1.2)), 0.15),
        withheld={("command_delay", None, "delay"): 0.15, ("track_width", None, "scale"): 1.2},
        reference=lambda: SmoothStart(route()),
        limits=(("pose.y", -0.01, 0.81),),
        training_motions=TRAINING_MOTIONS,
    )
)
