"""The arm draws a circle while it goes up and down (the paper's trajectory B) over a slow bus, in PyBullet."""

from plants.scaler_arm.withheld import Withheld
from scenarios.arm import DT, TRAINING_MOTIONS, arm_twin, circle_z, stiff_arm
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask

WITHHELD = Withheld(delay=0.04)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="arm_circle_z",
        summary="SCALER arm, circle up and down, in PyBullet; withheld: command delay",
        plant="scaler_arm",
        setup=stiff_arm,
        simulator=lambda: arm_twin("pybullet", WITHHELD),
        withheld=WITHHELD.effects(),
        reference=circle_z,
        seconds=9.0,
        dt=DT,
        training_motions=TRAINING_MOTIONS,
    )
)
