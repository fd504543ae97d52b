"""The arm's MuJoCo model with the one step that controllers and export take beside it."""

from dataclasses import dataclass

from plants.mujoco_robot.robot import MujocoRobot
from plants.scaler_arm.dynamics.step import RATES, arm_step
from plants.scaler_arm.kinematics.geometry import SCALER, Arm
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import StepOptions, Stepped


@dataclass(frozen=True, eq=False)
class SteppingArm(MujocoRobot):
    """Adds a protocol and overrides nothing: replayed in MuJoCo, stepped without inertia (see `step`)."""

    arm: Arm = SCALER

    @property
    def period(self) -> float:
        """s between commands."""
        return self.arm.period

    @property
    def disturbed(self) -> tuple[str, ...]:
        return RATES

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """See residual_mpc.models.stepping.Stepping."""
        return arm_step(self.arm, self.name, settings, options, self.slots)
