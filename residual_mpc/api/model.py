"""The augmented model: nominal robot, diagnosed effects and learned network as one step x+ = f(x, u, p)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.controllers import controller
from residual_mpc.api.display import brief, page
from residual_mpc.api.given import check_apart, check_robot, check_time_step
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.shapes import check_batches, check_last
from residual_mpc.api.written import Source, placed, written
from residual_mpc.errors import BadInput
from residual_mpc.export.actuators import write_actuators
from residual_mpc.export.augmented import Augmented, Build, augmented_from, settings_from
from residual_mpc.export.casadi_model import CasadiModel, casadi_model
from residual_mpc.export.servo_table import write_servo_table
from residual_mpc.export.sysid import write_sysid
from residual_mpc.export.urdf import write_urdf
from residual_mpc.export.write import TARGETS, write_mjcf, write_model, write_network
from residual_mpc.files import write_json
from residual_mpc.learning.network.residual import KEY
from residual_mpc.learning.network.written import kept_nothing, residual_in
from residual_mpc.models import optional
from residual_mpc.models.model_file import MODEL_SCHEMA, Written, diagnosis_in, model_content, model_in
from residual_mpc.models.nominal_numbers import KEY as NOMINAL
from residual_mpc.models.parameter_units import parameter_unit
from residual_mpc.models.settings import TUNE

if TYPE_CHECKING:
    from pandas import DataFrame

MODELS = ("mjcf", "urdf", "sysid", "actuators", "servo-table")  # targets that are models or tables for other tools


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A nominal robot with effects and a network. source: the content of model.json; build: how its step is made;
    explanation: of the diagnosis that it was made of, with intervals; found: that diagnosis, None without one.

    The step is made when it is first needed. What needs it raises BadInput for a robot that has no symbolic step.
    """

    robot: NominalRobot
    source: Written
    build: Build
    explanation: tuple[Mapping[str, Any], ...] = ()
    found: Mapping[str, Any] | None = None

    @cached_property
    def augmented(self) -> Augmented:
        """The step, for functions of `residual_mpc.export` and controllers of your own."""
        return augmented_from(self.source, self.robot.model, self.build)

    @property
    def dt(self) -> float:
        """s, over which a command is held."""
        return self.build.dt

    @property
    def states(self) -> tuple[str, ...]:
        """Names of x: poses or positions, velocities, and what the effects remember."""
        return tuple(self.augmented.stepped.states)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of u."""
        return tuple(f"command.{a}" for a in self.robot.model.actuators)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of p: numbers of the effects and the nominal model, then the network's weights."""
        return self.augmented.parameters

    @property
    def p(self) -> np.ndarray:
        """(np,) the parameters as they are now."""
        return self.augmented.p

    def p_at(self, logged: Mapping[str, float]) -> np.ndarray:
        """(np,) the parameters where these logged columns, which laws depend on, have other values than in `p`, such as
        today's supply voltage.

        Raises BadInput for a column that no law depends on, or a value that is not finite.
        """
        build = replace(self.build, logged={**self.build.logged, **logged})
        return augmented_from(self.source, self.robot.model, build).p

    @property
    def logged(self) -> Mapping[str, float]:
        """The logged columns that laws of the model depend on, and their values in `p`."""
        return self.augmented.build.logged

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
        """x+ (..., nx) from x (..., nx) and u (..., nu), in numpy. Raises BadInput for arrays of another size."""
        for name, given, names in (("x", x, self.states), ("u", u, self.commands)):
            check_last(name, given, names)
        check_batches(x, u)
        return self.augmented.numpy_step(np.asarray(x, dtype=float), np.asarray(u, dtype=float))

    def linearize(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A = dx+/dx (nx, nx) and B = dx+/du (nx, nu) at x (nx,), u (nu,), exact but for kinks. Raises BadInput for
        arrays of another size."""
        for name, given, names in (("x", x, self.states), ("u", u, self.commands)):
            check_last(name, given, names, most=1)
        _, a, b = self._compiled.stage(x, u, self.p)
        return np.array(a), np.array(b)

    def export(
        self, to: str, folder: str | Path, seed: int = 0, physics_dt: float | None = None,
        beside: Sequence[Source] = (),
    ) -> dict[str, Any]:  # fmt: skip
        """Write the model for others; what `export --json` prints.

        Args:
            to: "casadi", "c", "jax", "onnx" (the network alone), "mjcf", "urdf", "sysid",
                "actuators" or "servo-table".
            seed: of the points at which the files are compared with their source.
            physics_dt: s, step of the simulation that "actuators" are for; by default the model's own.
            beside: other diagnoses of this robot, from other runs, that "servo-table" pools.

        Raises:
            BadInput: a target that this model cannot have.
        """
        where = Path(folder)
        if to == "mjcf":
            document = write_mjcf(self.source, self.robot.model, where)
        elif to == "urdf":
            document = write_urdf(self.source, self.robot.model, self.robot.file, where)
        elif to == "sysid":
            document = write_sysid(self.source, self.explanation, self.robot.model, where)
        elif to == "actuators":
            document = write_actuators(self.source, self.explanation, self.robot.model, physics_dt, where)
        elif to == "servo-table":
            document = self._servo_table(where, beside)
        elif to == "onnx":
            document = write_network(residual_in(self.source), self.robot.name, where)
        elif to in TARGETS:
            document = write_model(self.augmented, to, where, np.random.default_rng(seed))
        else:
            raise BadInput(f"unknown export format {to!r}", "`to`", f"give one of {', '.join((*TARGETS, *MODELS))}")
        return {**document, "folder": str(where)}

    def _servo_table(self, where: Path, beside: Sequence[Source]) -> dict[str, Any]:
        others = [written(source) for source in beside]
        for other in others:
            _check_robot(other, self.robot)
        contents = [diagnosis_in(other) for other in others]
        check_apart([(self.source.where, self.found or {}), *((o.where, o.content) for o in others)])
        return write_servo_table(self.source, self.found, self.robot.model, self.robot.file, where, contents)

    def mpc(self, horizon: int = 20, settings: Any = None) -> Any:
        """A model predictive controller (controllers.mpc.Mpc).

        Args:
            horizon: steps.
            settings: controllers.settings.MpcSettings with the weights and limits of the robot; None for
                `controllers.usual.usual_settings`: of a robot that drives those of a small rover, 12 rad/s at most.

        Raises:
            BadInput: a horizon of fewer than two steps.
        """
        if not isinstance(horizon, Integral) or horizon < 2:
            raise BadInput(f"the horizon must be at least two steps, got {horizon!r}", "horizon", "give a whole number")
        return controller("mpc")(self.augmented, horizon, settings)

    def lqr(self, path: np.ndarray, settings: Any = None) -> Any:
        """A linear quadratic regulator along a path (controllers.lqr.Lqr).

        Args:
            path: (n, ny) what is tracked, one row per sample of dt.
            settings: as in `mpc`.

        Raises:
            BadInput: a path of another width, or with values that are not finite.
        """
        tracked = self.augmented.stepped.tracked
        check_last("path", path, tracked)
        if np.ndim(path) != 2 or not len(path) or not np.isfinite(path).all():
            raise BadInput(
                f"the path must have one row per sample and finite values, got {np.shape(path)} with "
                f"{np.count_nonzero(~np.isfinite(path))} that are not", "path", f"give (n, {len(tracked)}) values",
            )  # fmt: skip
        return controller("lqr")(self.augmented, path, settings)

    def to_frame(self) -> "DataFrame":
        """One row a number in which the model differs from the nominal one, without the network's weights."""
        import pandas as pd

        values = model_in(self.source)[1].items()
        units = [parameter_unit(self.robot.model, k) or None for k, _ in values]
        effects = [None if k.effect == TUNE else k.effect for k, _ in values]
        rows = [(e, *k[1:3], x, u) for e, (k, x), u in zip(effects, values, units, strict=True)]
        return pd.DataFrame(rows, columns=["effect", "target", "parameter", "value", "unit"])

    def save(self, folder: str | Path) -> Path:
        """Write model.json, for `export`, `measure_gap` and `learn`; dt, smooth and disturbances are not kept."""
        out = Path(folder)
        made = self.source.content  # what is of another file has the nominal numbers that it states, or none
        other = {NOMINAL: None} if made["values"] or KEY in made else {}
        write_json(out / "model.json", placed({**other, **made}, self.robot, out))
        return out

    def as_written(self) -> Written:
        return self.source

    @property
    def _effects(self) -> str:
        return ", ".join(dict.fromkeys(k.effect for k in model_in(self.source)[1])) or "none"

    def lines(self) -> list[str]:
        """The model in words."""
        try:
            names = self.parameters
        except BadInput as fault:
            return [
                f"{self.robot.name}, without a step: {fault.what}",
                f"  u: {', '.join(self.commands)}",
                f"  effects: {self._effects}",
            ]
        numbers = [n for n in names if not n.startswith("theta.")]
        weights = len(names) - len(numbers)
        return [
            f"{self.robot.name}, time step {self.dt:g} s",
            f"  x: {', '.join(self.states)}",
            f"  u: {', '.join(self.commands)}",
            f"  p: {', '.join(numbers)}" + (f", and {weights} network weights" if weights else ""),
        ]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        network = "" if residual_in(self.source) is None else ", with a network"
        return brief(self, f"{self.robot.name}, time step {self.dt:g} s, effects: {self._effects}{network}")

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
    logged: Mapping[str, float] | None = None,
) -> AugmentedModel:
    """The nominal model with the effects of a diagnosis and a learned network in it.

    Args:
        diagnosis: a diagnosis, or its file; None for the effects that the network was learned on, if any. A model file
            that holds a network is used whole, effects and network.
        residual: a learned model, or its file; None for no network.
        dt: s, over which a command is held; by default the step at which the network was learned, without one the
            robot's own period between commands, else 0.05.
        smooth: width of rounded kinks, for solvers that need derivatives; 0 is exact.
        disturbances: whether an unknown constant is added to the robot's velocities, for offset-free tracking.
        logged: values of logged columns that laws of the model depend on; of others, the mean over the diagnosed runs.

    Raises:
        BadInput: a time step that is not positive or longer than half a second, a model of another robot, a column that
            no law depends on, a network learned on other effects, or a residual that contains no network.
    """
    check_robot(robot)
    above = None if residual is None else written(residual)
    below = above if diagnosis is None else written(diagnosis)
    for source in (below, above):
        _check_robot(source, robot)
    given = above or below
    network = None if given is None else residual_in(given)
    if above is not None and network is None and not kept_nothing(above):
        remedy = "give the model.json of `learn`, or leave the residual out"
        raise BadInput("it contains no network", above.where, remedy)
    if above is not None and below is not None and model_in(above)[1] != model_in(below)[1]:
        fault = "the network was learned on other effects than those of the diagnosis"
        raise BadInput(fault, above.where, "learn it with on=diagnosis")
    usual = optional.period(robot.model) if network is None else network.step
    source = _source(robot, given)
    settings_from(source, robot.model)  # refuses what is of another robot
    explanation = () if below is None else tuple(below.content.get("explanation", ()))
    found = below.content if below is not None and "explanation" in below.content else None
    if dt is not None:
        check_time_step(dt)
    build = Build(usual if dt is None else float(dt), smooth, disturbances, logged=dict(logged or {}))
    return AugmentedModel(robot, source, build, explanation, found)


def _check_robot(source: Written | None, robot: NominalRobot) -> None:
    if source is not None and (of := model_in(source)[0]) != robot.name:
        raise BadInput(
            f"the model must be of {robot.name!r}, got one of {of!r}", source.where, "give the robot file of that model"
        )


def _source(robot: NominalRobot, given: Written | None) -> Written:
    """The content of model.json."""
    if given is None:
        return Written({"schema": MODEL_SCHEMA, "robot": robot.name, "values": []}, "the nominal model")
    return Written({k: v for k, v in model_content(given).items() if k != "robot_file"}, given.where)
