"""The augmented model: a robot's nominal step, the diagnosed effects in it, and the learned network on top."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.ops import NUMPY, Array, Ops
from residual_mpc.errors import BadInput
from residual_mpc.export.network import corrected, correction, reads, remembered
from residual_mpc.export.soften import kinks
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.network.written import residual_in
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models import optional
from residual_mpc.models.fits import check_fits
from residual_mpc.models.logged_laws import NOTHING, at_values, carriers_of, columns_at, columns_of
from residual_mpc.models.model_file import Written, model_content, model_in, read_written
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.models.stepping import StepOptions, Stepped, Stepping


@dataclass(frozen=True)
class Build:
    """How the step is built.

    dt: s, a command is held over it. smooth: width of rounded kinks, in command units for the effects' and in units
    of the scaled activations for the network's; 0 is exact. disturbances: whether an unknown constant is added to the
    robot's velocities (offset-free tracking). clock: s since the run began at the start. logged: values of the logged
    columns that laws depend on; of others, the mean over the runs that the law was fitted to.
    """

    dt: float
    smooth: float = 0.0
    disturbances: bool = False
    clock: float = 0.0
    logged: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt) and self.dt > 0 and np.isfinite(self.smooth) and self.smooth >= 0):
            raise ValueError(f"dt must be > 0 and smooth >= 0, got {self.dt} s and {self.smooth}")


@dataclass(frozen=True, eq=False)
class Augmented:
    """x+ = f(x, u, p), p = (numbers of the effects and the nominal model, weights of the network).

    robot: the nominal model; settings: the effects, one row; residual: None without a network.
    """

    robot: Robot
    settings: Settings
    residual: Residual | None
    build: Build
    stepped: Stepped

    @property
    def nx(self) -> int:
        return len(self.stepped.states)

    @property
    def nu(self) -> int:
        return len(self.stepped.commands)

    @property
    def p(self) -> np.ndarray:
        """(np,) the parameters as they are now."""
        theta = np.zeros(0) if self.residual is None else self.residual.theta
        return np.concatenate([self.stepped.p, theta])

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of p, such as "command_delay.left.delay" and "theta.0"."""
        theta = 0 if self.residual is None else len(self.residual.theta)
        named = (".".join(filter(None, (n.effect, n.slot, n.parameter))) for n in self.stepped.numbers)
        return (*named, *(f"theta.{i}" for i in range(theta)))

    def step(self, ops: Ops, x: Sequence[Array], u: Sequence[Array], p: Sequence[Array]) -> tuple[Array, ...]:
        """x+ in scalars of whatever library `ops` belongs to; each may be a batch in numpy."""
        n, smooth = len(self.stepped.numbers), self.build.smooth
        add = None if self.residual is None else correction(ops, self.residual, p[n:], smooth)
        return self.stepped.step(kinks(ops, smooth), x, u, p[:n], add)

    def start(self, pose: Mapping[str, float] | None = None) -> np.ndarray:
        """(nx,) the robot at rest at a pose by channel; channels that are not named are 0 (fixed robot: as at home).

        Raises BadInput for a name that is not one of the poses, and for a value that is not finite.
        """
        for name, value in (pose or {}).items():
            if name not in self.stepped.poses:
                raise BadInput(f"unknown pose {name!r}", "", did_you_mean(name, self.stepped.poses))
            if not np.isfinite(value):
                raise BadInput(f"{name} must be finite, got {value}", "", "give a measured value, or leave it out")
        return self.at_rest(pose or {})

    def at_rest(self, pose: Mapping[str, float]) -> np.ndarray:
        """(nx,) as `start`, for a reading, which may contain other channels and NaN."""
        if self.stepped.resting is not None:
            return self.stepped.resting(pose)
        x = self.stepped.rest.copy()
        for name, value in pose.items():
            if name in self.stepped.poses:
                x[self.stepped.states.index(name)] = value
        return x

    def hold(self, x: np.ndarray) -> np.ndarray:
        """(nu,) commands that leave the robot about where it is at x (nx,)."""
        return np.zeros(self.nu) if self.stepped.holding is None else self.stepped.holding(x)

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """(..., ny) what a controller tracks (`stepped.tracked`), from x (..., nx)."""
        at = self.stepped
        if at.output is None:
            return np.asarray(x[..., [at.states.index(c) for c in at.poses]])
        found = at.output(NUMPY, [*np.moveaxis(x, -1, 0)])
        return np.stack([np.broadcast_to(v, x.shape[:-1]) for v in found], axis=-1)

    def numpy_step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """x+ (..., nx) from x (..., nx) and u (..., nu), for checks; compiled functions are faster."""
        batch = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
        with np.errstate(over="ignore"):
            new = self.step(NUMPY, [*np.moveaxis(x, -1, 0)], [*np.moveaxis(u, -1, 0)], [*self.p])
        return np.stack([np.broadcast_to(v, batch) for v in new], axis=-1)


def augment(robot: Robot, values: Values, residual: Residual | None, build: Build) -> Augmented:
    """The model of a robot with the effects of a diagnosis and a learned residual.

    Raises BadInput for a robot that cannot say its step, an effect on a target that it lacks, or a residual of another
    robot or form.
    """
    return _augmented(robot, values, robot.name, "the model", residual, build)


def read_augmented(path: Path, robot: Robot, build: Build) -> Augmented:
    """The model in the file of a diagnosis or of what was learned. Raises BadInput where it is of another robot."""
    return augmented_from(read_written(path), robot, build)


def augmented_from(written: Written, robot: Robot, build: Build) -> Augmented:
    """The model of a diagnosis.json or model.json. Raises BadInput where it is of another robot."""
    name, values, _ = _of_robot(written, robot)
    return _augmented(robot, values, name, written.where, residual_in(written), build)


def settings_from(written: Written, robot: Robot) -> Settings:
    """The effects of a diagnosis.json or model.json on its robot, one row, with laws of logged columns at usual values.

    Raises BadInput where the model is of another robot, or has an effect, target or parameter that this one lacks.
    """
    name, values, _ = _of_robot(written, robot)
    return _settings(robot, values, name, written.where)


def _of_robot(written: Written, robot: Robot) -> tuple[str, Values, bool]:
    name, values, leaves_out = model_in(written)
    if name != robot.name:
        raise BadInput(
            f"the model must be of {robot.name!r}, got one of {name!r}",
            written.where,
            "give the robot file of that model",
        )
    warn_of_differences(model_content(written), robot, written.where)
    return name, values, leaves_out


def with_residual(model: Augmented, residual: Residual | None) -> Augmented:
    """The same robot and effects with another network, or none."""
    return _build(model.robot, model.settings, residual, model.build)


def _augmented(robot: Robot, values: Values, of: str, where: str, residual: Residual | None, build: Build) -> Augmented:
    """The model of these values, whose build says at which values of the logged columns it holds."""
    unknown = set(build.logged) - set(columns_of(values))
    if unknown:
        known = ", ".join(columns_of(values)) or "none"
        raise BadInput(
            f"no law of the model depends on {', '.join(sorted(unknown))}", where, f"its laws depend on: {known}"
        )
    strange = {c: x for c, x in build.logged.items() if not np.isfinite(x)}
    if strange:
        raise BadInput(f"the value of a logged column must be finite, got {strange}", where, "give a measured value")
    settings = _settings(robot, values, of, where, build.logged)
    return _build(robot, settings, residual, replace(build, logged=columns_at(values, build.logged)))


def _settings(robot: Robot, values: Values, of: str, where: str, logged: Mapping[str, float] = NOTHING) -> Settings:
    check_fits(values, robot, of, where)
    plain = at_values(values, logged)
    settings = assemble([plain], {k.effect: robot.slots(k.effect) for k in plain})
    # a law may do nothing at one value of its column: its carrier stays a parameter all the same
    idle = {e: robot.slots(e) for e in carriers_of(values) - settings.effects.keys()}
    null = {e: {p.name: np.full((1, len(s)), p.null) for p in BY_NAME[e].parameters} for e, s in idle.items()}
    return replace(settings, effects={**settings.effects, **null}) if null else settings


def _build(robot: Robot, settings: Settings, residual: Residual | None, build: Build) -> Augmented:
    if not isinstance(robot, Stepping):
        raise BadInput(
            f"the plant of {robot.name!r} has no symbolic step",
            robot.name,
            "implement residual_mpc.models.stepping.Stepping for it, as plants/diff_drive.py and "
            "plants/scaler_arm/dynamics/step.py do",
        )
    if residual is not None:
        reads(residual)  # refuses a form that no step hosts
    disturbances = optional.disturbed(robot) if build.disturbances else ()
    options = StepOptions(build.dt, remembered(residual), corrected(residual), disturbances, build.clock)
    return Augmented(robot, settings, residual, build, robot.one_step(settings, options))
