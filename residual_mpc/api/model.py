"""The augmented model: nominal robot, diagnosed effects and learned network as one step x+ = f(x, u, p)."""

from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.api.display import page
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.written import Source, written
from residual_mpc.diagnosis.document import Written, model_in, residual_in
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented, Build
from residual_mpc.export.augmented import augment as augment_robot
from residual_mpc.export.casadi_model import CasadiModel, casadi_model
from residual_mpc.export.write import TARGETS, write_mjcf, write_model
from residual_mpc.models.settings import Values

USUAL_STEP = 0.05  # s, the controllers' usual one
CONTROLLERS = "residual_mpc.controllers"  # entry points: "mpc" and "lqr"


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A model to control with. sources: what it was made of, for `export("mjcf", ...)`."""

    robot: NominalRobot
    augmented: Augmented
    source: Written | None

    @property
    def dt(self) -> float:
        """s, over which a command is held."""
        return self.augmented.build.dt

    @property
    def states(self) -> tuple[str, ...]:
        """Names of x: poses or positions, velocities, and what the effects remember."""
        return tuple(self.augmented.stepped.states)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of u."""
        return self._compiled.u_names

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of p: numbers of the effects and the nominal model, then the network's weights."""
        return self.augmented.parameters

    @property
    def p(self) -> np.ndarray:
        """(np,) the parameters as they are now."""
        return self.augmented.p

    @property
    def x0(self) -> np.ndarray:
        """(nx,) the robot at rest at the origin (of a fixed robot: as at home)."""
        return self.augmented.start()

    @cached_property
    def _compiled(self) -> CasadiModel:
        return casadi_model(self.augmented)

    def casadi(self) -> Any:
        """A casadi.Function (x, u, p) -> x_next."""
        return self._compiled.f

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """x+ (..., nx) from x (..., nx) and u (..., nu), in numpy."""
        return self.augmented.numpy_step(x, u)

    def linearize(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A = dx+/dx (nx, nx) and B = dx+/du (nx, nu) at x (nx,), u (nu,), exact but for kinks."""
        _, a, b = self._compiled.stage(x, u, self.p)
        return np.array(a), np.array(b)

    def export(self, to: str, folder: str | Path, seed: int = 0) -> dict[str, Any]:
        """Write the model for others; what `export --json` prints.

        Args:
            to: "casadi", "c", "jax", "onnx" (the network alone) or "mjcf".
            seed: of the points at which the files are compared with their source.

        Raises:
            BadInput: a target that this model cannot have.
        """
        where = Path(folder)
        if to == "mjcf":
            document = write_mjcf(self.source or _nominal(self.robot), self.robot.model, where)
        elif to in TARGETS:
            document = write_model(self.augmented, to, where, np.random.default_rng(seed))
        else:
            raise BadInput(f"unknown export format {to!r}", "--to", f"give one of {', '.join((*TARGETS, 'mjcf'))}")
        return {**document, "folder": str(where)}

    def mpc(self, horizon: int = 20, settings: Any = None) -> Any:
        """A model predictive controller (controllers.mpc.Mpc).

        Args:
            horizon: steps.
            settings: controllers.settings.MpcSettings with the weights and limits of the robot; None for the rover's.
        """
        return _controller("mpc")(self.augmented, horizon, settings)

    def lqr(self, path: np.ndarray, settings: Any = None) -> Any:
        """A linear quadratic regulator along a path (controllers.lqr.Lqr).

        Args:
            path: (n, ny) what is tracked, a row a sample of dt.
            settings: as in `mpc`.
        """
        return _controller("lqr")(self.augmented, path, settings)

    def lines(self) -> list[str]:
        """The model in words."""
        numbers = [n for n in self.parameters if not n.startswith("theta.")]
        weights = len(self.parameters) - len(numbers)
        return [
            f"{self.robot.name}, time step {self.dt:g} s",
            f"  x: {', '.join(self.states)}",
            f"  u: {', '.join(self.commands)}",
            f"  p: {', '.join(numbers)}" + (f", and {weights} network weights" if weights else ""),
        ]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        return page(self.lines())


def augment(
    robot: NominalRobot,
    diagnosis: Source | None = None,
    residual: Source | None = None,
    *,
    dt: float | None = None,
    smooth: float = 0.0,
    disturbances: bool = False,
) -> AugmentedModel:
    """The nominal model with the effects of a diagnosis and a learned network in it.

    Args:
        diagnosis: a diagnosis, or its file; None for the effects that the network was learned on, if any.
        residual: a learned model, or its file; None for no network.
        dt: s, over which a command is held; by default the step at which the network was learned, without one the
            robot's own period between commands, else 0.05.
        smooth: width of rounded kinks, for solvers that need derivatives; 0 is exact.
        disturbances: whether an unknown constant is added to the robot's velocities, for offset-free tracking.

    Raises:
        BadInput: a model of another robot, a network learned on other effects, or a robot that cannot say its step.
    """
    above = None if residual is None else written(residual)
    below = above if diagnosis is None else written(diagnosis)
    network = None if above is None else residual_in(above)
    if above is not None and below is not None and model_in(above)[1] != model_in(below)[1]:
        raise BadInput(
            "the network was learned on other effects than those of the diagnosis",
            above.where,
            "learn it with on=diagnosis",
        )
    usual = float(getattr(robot.model, "period", USUAL_STEP)) if network is None else network.step
    build = Build(dt or usual, smooth, disturbances)
    values: Values = {}
    if below is not None:
        of, values, _ = model_in(below)
        if of != robot.name:
            raise BadInput(
                f"the model must be of {robot.name!r}, got one of {of!r}",
                below.where,
                "give the robot file of that model",
            )
    return AugmentedModel(robot, augment_robot(robot.model, values, network, build), below)


def _nominal(robot: NominalRobot) -> Written:
    from residual_mpc.diagnosis.document import MODEL_SCHEMA

    return Written({"schema": MODEL_SCHEMA, "robot": robot.name, "values": []}, "the nominal model")


def _controller(name: str) -> Any:
    """What builds a controller, from whoever is installed."""
    found = [e for e in entry_points(group=CONTROLLERS) if e.name == name]
    if not found:
        raise BadInput(f"no controller {name!r} is installed", "", "install the package `controllers`")
    return found[0].load()
