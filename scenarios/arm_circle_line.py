"""The arm draws a circle and a line through it (the paper's trajectory A) with worn servos and a load, in MuJoCo."""

from plants.scaler_arm.withheld import Withheld
from scenarios.arm import DT, TRAINING_MOTIONS, arm_twin, circle_line, servo_arm
from scenarios.closed_loop.scenario import ClosedLoop
from scenarios.closed_loop.task import ClosedLoopTask

WITHHELD = Withheld(payload=0.12, gain=0.6, friction=0.4)

SCENARIO = ClosedLoop(
    ClosedLoopTask(
        name="arm_circle_line",
        summary="SCALER arm, circle with a line, in MuJoCo; withheld: payload, servo gain and friction",
        plant="scaler_arm",
        setup=servo_arm,
        simulator=lambda: arm_twin("mujoco", WITHHELD),
        withheld=WITHHELD.effects(),
        reference=circle_line,
        seconds=9.0,
        dt=DT,
        training_motions=TRAINING_MOTIONS,
    )
)
