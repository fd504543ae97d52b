"""The model that is watched: the nominal one of each run, with the effects and the residual that a file adds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from residual_mpc.learning.forms.residual_robot import with_residual
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.network.written import residual_for
from residual_mpc.models.fits import fitting
from residual_mpc.models.logged_laws import at_values
from residual_mpc.models.model_file import Written
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.models.targets import Targets

RobotOf = Callable[[str], Robot]  # the nominal model of a run, by its name


@dataclass(frozen=True, eq=False)
class WatchedModel:
    """values: of the effects; leaves_out: whether samples that jump away are left out; residual: what was learned."""

    nominal_of: RobotOf
    values: Values
    leaves_out: bool
    residual: Residual | None
    where: str

    def robot_of(self, run: str) -> Robot:
        """The robot that predicts a run."""
        nominal = self.nominal_of(run)
        return nominal if self.residual is None else with_residual([nominal], self.residual, self.where)[0]

    def settings(self, robot: Robot) -> Settings:
        return assemble([self.values], Targets(robot))


def watched_model(nominal: Robot, nominal_of: RobotOf, model: Written | None) -> WatchedModel:
    """Raises BadInput for a model of another robot."""
    if model is None:
        return WatchedModel(nominal_of, {}, False, None, "")
    values, leaves_out = fitting(model, nominal)
    residual = residual_for(model, nominal.name)
    return WatchedModel(nominal_of, at_values(values), leaves_out, residual, model.where)
