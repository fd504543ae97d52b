"""A robot as its scenarios share it: model, sensors' noise, settings, and how a network is taught on its runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from controllers.settings import MpcSettings
from residual_mpc.closed_loop.estimator import EstimatorSettings
from residual_mpc.closed_loop.online import OnlineSettings
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values

Teach = Callable[[tuple[Run, ...], Values, int], Residual]  # runs, effects underneath, seed


@dataclass(frozen=True, eq=False)
class RobotSetup:
    """robot: the nominal model. noise: what a robot file would say of the sensors, 1-sigma by channel. control:
    weights, limits and horizon, equal for all controllers. blank_network(seed, dt): a network of zero output, as
    before any data.
    """

    robot: Robot
    noise: Mapping[str, float]
    estimator: EstimatorSettings
    control: MpcSettings
    teach: Teach
    blank_network: Callable[[int, float], Residual]
    online: OnlineSettings
