"""The contract of a robot, as checks that an implementation of yours can run on itself."""

from residual_mpc.models.contract.demand import ContractBroken
from residual_mpc.models.contract.robot import check_robot

__all__ = ["ContractBroken", "check_robot"]
