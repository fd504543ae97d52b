"""A delivery route between walls that cost something to touch, over a slow radio link, in MuJoCo."""

from plants.wheeled.motions import route
from plants.wheeled.twin import Withheld
from scenarios.robots import PRACTICE, Gently, Late, in_mujoco
from scenarios.rover import rover
from scenarios.scenario import ClosedLoop

SCENARIO = ClosedLoop(
    name="route",
    summary="a route with soft limits in MuJoCo; withheld: command delay, track width",
    plant="diff_drive",
    kit=rover,
    simulator=lambda: Late(in_mujoco(Withheld(track=1.2)), 0.15),
    withheld={("command_delay", None, "delay"): 0.15, ("track_width", None, "scale"): 1.2},
    reference=lambda: Gently(route()),
    limits=(("pose.y", -0.01, 0.81),),
    practice=PRACTICE,
)
