"""The scenario of a user's own robot: nominal against augmented on a plant of the user's choice.

model = rm.augment(robot, "out/model.json", dt=0.02)
result = OwnScenario(robot, model).run(RunOptions(seeds=3))
"""

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from controllers.lqr import build_lqr
from controllers.mpc import build_mpc
from controllers.settings import MpcSettings
from controllers.usual import usual_settings
from residual_mpc.api.model import AugmentedModel
from residual_mpc.api.robot import NominalRobot
from residual_mpc.closed_loop.compare import Comparison, ControlStack, compare, document
from residual_mpc.closed_loop.estimator import EstimatorSettings, build_filter
from residual_mpc.closed_loop.loop import LoopSettings
from residual_mpc.closed_loop.protocols import Reading, Simulator
from residual_mpc.closed_loop.scenario import DoubtfulReference, Progress, RunOptions
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented, augment, augmented_from, settings_from
from residual_mpc.models import optional
from residual_mpc.models.model_file import Written, model_in
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Values
from scenarios.own.demands import dead_steps, fastest_wheel, notes_of
from scenarios.own.guarded import Guarded, check_actuators, guarded
from scenarios.own.inverse import posture_at
from scenarios.own.plant import NoisySensors, plant_of
from scenarios.own.reference import Waypoints, is_of_the_tool, named_motion, read_reference
from scenarios.own.reference_audit import audit_reference, wheel_limit
from scenarios.own.units import mixed, unit_of

# 1-sigma of a sensor without an entry in the robot file: rad or m of an encoder, m and rad of a localisation
NOISE, LOCALISED = 2e-4, {"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006}
DRIFT = 0.01  # rad/sqrt(s) or m/sqrt(s), process noise of the estimator's positions
STACKS = ("nominal", "augmented", "oracle")
LONGEST = 40  # samples of a horizon: with 80, an episode of 1200 samples took more than two minutes

PlantFactory = Callable[[RobotFile, float], Simulator]  # (robot file, s between commands) -> plant


@dataclass(frozen=True, eq=False)
class OwnRun:
    """A comparison, the names of the tracked channels, the augmented model, reference and settings behind it, and what
    is doubtful about the reference."""

    comparison: Comparison
    names: tuple[str, ...]
    model: Augmented
    reference: Waypoints
    settings: MpcSettings
    doubts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class OwnScenario:
    """The plant, its reference and the controllers that are compared on it.

    robot: the nominal robot. model: the augmented model; its dt is the sample time. reference: the name of a motion, a
    CSV file or waypoints, in joint space or, with columns `tool.*`, in tool space. plant: builds the plant; None: the
    robot in MuJoCo at a shorter step, with the effects `withheld`, by default those of the model. settings: of the
    controllers; None for `usual_settings`. noise: 1-sigma of noise that is added to the readings, which the estimators
    expect as well; what is not named here they expect as the robot file says, and a plant of your own gets none.
    controllers: those of "nominal", "augmented" and "oracle" that drive; by default all.

    Raises BadInput for an unknown controller, and for withheld effects beside a plant, which would not have them.
    """

    robot: NominalRobot
    model: AugmentedModel
    reference: str | Path | Waypoints = "sines"
    withheld: Values | None = None
    plant: PlantFactory | None = None
    settings: MpcSettings | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    controllers: tuple[str, ...] = ()

    name: str = "own"
    summary: str = "your own robot: nominal against augmented"

    def __post_init__(self) -> None:
        unknown = [name for name in self.controllers if name not in STACKS]
        if unknown:
            raise BadInput(f"unknown controller {unknown[0]!r}", self.robot.model.name, f"use {', '.join(STACKS)}")
        if self.plant is not None and self.withheld is not None:
            raise BadInput(
                "withheld effects cannot be put into a plant of your own", "`withheld`",
                "leave out `withheld`, or leave out `plant` to drive the robot in MuJoCo",
            )  # fmt: skip

    def run(self, options: RunOptions, progress: Progress = lambda stage, done: None) -> dict[str, Any]:
        """The object that `run --json` prints; with options.out also the episodes, a figure and an animation."""
        driven = self.drive(options, progress)
        comparison, names = driven.comparison, driven.names
        label = self.reference if isinstance(self.reference, str) else "reference"
        plant = "own plant" if self.plant else "mujoco"
        result = document(comparison, Path(label).stem if label else "", plant, np.random.default_rng(options.seed))
        result["robot"] = self.robot.name
        result["controller"] = options.controller
        result["tracked"] = list(names)
        result["unit"] = unit_of(names, optional.sliding(self.robot.model))
        notes = notes_of(driven.model, driven.reference, driven.settings, comparison)
        result["notes"] = [*driven.doubts, *mixed(names, optional.sliding(self.robot.model)), *notes]
        if options.out is not None:
            from scenarios.own.figures import write

            progress("writing episodes and figures", 0.95)
            result["files"] = write(options.out, self.robot.model, comparison, result)
        return result

    def drive(self, options: RunOptions, progress: Progress) -> "OwnRun":
        """The episodes of every controller and seed, and what they were driven with."""
        progress("building the controllers", 0.0)
        models = self._models()
        nominal = models["nominal"]
        reference = self._waypoints(nominal).with_held(nominal)
        reference = reference.ordered(nominal.stepped.tracked, reference.where)
        doubts = self._doubts(reference, models)
        begin = posture_at(nominal, reference.path(np.zeros(1))[0])
        dt = self.model.dt
        simulator = self._simulator(nominal, begin)
        settings = self.settings or self._usual(models, reference)
        settings = replace(settings, budget=options.budget)
        stacks = {}
        chosen = {name: model for name, model in models.items() if name in (self.controllers or models)}
        for i, (name, model) in enumerate(chosen.items()):
            progress(f"building the controllers: {name}", 0.1 * i)
            stacks[name] = self._stack(model, settings, reference, begin, options)
        seeds = tuple(range(options.seed, options.seed + options.seeds))
        comparison = compare(
            simulator, stacks, reference, LoopSettings(reference.seconds, dt), seeds, (),
            lambda stage, done: progress(stage, 0.3 + 0.6 * done), begin,
        )  # fmt: skip
        return OwnRun(comparison, nominal.stepped.tracked, models["augmented"], reference, settings, doubts)

    def _doubts(self, reference: Waypoints, models: Mapping[str, Augmented]) -> tuple[str, ...]:
        """What is doubtful about the reference; warns of it before anything is driven."""
        limits = [wheel_limit(models["augmented"])]
        if self.settings is not None:
            limits.append(float(np.abs(np.hstack([self.settings.limits.lower, self.settings.limits.upper])).max()))
        limit = min((x for x in limits if x is not None), default=None)
        doubts = tuple(audit_reference(reference, models["nominal"], self.model.dt, limit))
        for doubt in doubts:
            warnings.warn(f"{reference.where}: {doubt}", DoubtfulReference, stacklevel=3)
        return doubts

    def _models(self) -> dict[str, Augmented]:
        """The model of each controller; the oracle only if the withheld effects are given."""
        build, source = self.model.build, self.model.source
        robot = self.robot.model
        if self._of_the_tool():
            if not hasattr(robot, "task"):
                raise BadInput(f"{robot.name!r} has no tool to track", robot.name, "give a reference for its poses")
            robot = replace(robot, task=True)  # type: ignore[type-var]
        models = {"nominal": augment(robot, {}, None, build), "augmented": augmented_from(source, robot, build)}
        if self.plant is None and self.withheld is not None:
            models["oracle"] = augment(robot, self.withheld, None, build)
        return models

    def _usual(self, models: Mapping[str, Augmented], reference: Waypoints) -> MpcSettings:
        """The usual settings for the fastest wheel that one of the models needs, with a horizon that begins at the
        longest dead time of the models, at most LONGEST samples in all."""
        usual = usual_settings(models["nominal"], fastest_wheel(models, reference, self.model.dt))
        late = max(dead_steps(model) for model in models.values())
        return replace(usual, horizon=max(usual.horizon, min(usual.horizon + late, LONGEST)))

    def _of_the_tool(self) -> bool:
        if isinstance(self.reference, Waypoints):
            return is_of_the_tool(self.reference.names)
        path = Path(self.reference)
        return is_of_the_tool(read_reference(path).names if path.is_file() else (str(self.reference),))

    def _waypoints(self, nominal: Augmented) -> Waypoints:
        if isinstance(self.reference, Waypoints):
            return self.reference
        path = Path(self.reference)
        if path.is_file() or path.suffix:
            return read_reference(path)
        return named_motion(str(self.reference), nominal)

    def _simulator(self, nominal: Augmented, begin: Reading) -> Simulator:
        """begin: the start of the motion, where a user's own plant is started once before the controllers are built."""
        make = self.plant
        if make is not None:
            own = guarded("--plant", "the factory", lambda: make(self.robot.file, self.model.dt))
            poses = tuple(nominal.stepped.poses)
            check_actuators(own, nominal.stepped.commands, "--plant")
            checked = Guarded(own, poses, "--plant")
            checked.try_out(begin)
            return NoisySensors(checked, {c: self.noise.get(c, 0.0) for c in poses})
        withheld = model_in(self.model.source)[1] if self.withheld is None else self.withheld
        return NoisySensors(plant_of(self.robot.model, withheld, self.model.dt), self._sigma(nominal))

    def _sigma(self, nominal: Augmented) -> dict[str, float]:
        known = {**LOCALISED, **self.robot.file.noise, **self.noise}
        return {c: known.get(c, NOISE) for c in nominal.stepped.poses}

    def _stack(
        self, model: Augmented, settings: MpcSettings, reference: Waypoints, begin: Reading, options: RunOptions
    ) -> ControlStack:
        n, sigma = len(model.stepped.poses), tuple(self._sigma(model).values())
        unknown = (1.0,) * sum(s.startswith("disturbance.") for s in model.stepped.states)
        given = EstimatorSettings(noise=sigma, drift=(DRIFT,) * n)
        if unknown:
            given = replace(given, disturbance=unknown)
        estimator = build_filter(model, given)
        if options.controller == "mpc":
            return ControlStack(estimator, build_mpc(model, settings))
        samples = round(reference.seconds / model.build.dt) + 1 + settings.horizon
        path = reference.path(model.build.dt * np.arange(samples))
        return ControlStack(estimator, build_lqr(model, path, settings, begin))


def drive(
    robot: NominalRobot, model: AugmentedModel, reference: str, plant: PlantFactory | None, withheld: Path | None,
    options: RunOptions, progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Run `residual-mpc run --robot R --model FILE --reference NAME`.

    withheld: a model.json or diagnosis.json with the effects of the plant; None for those of the model.
    """
    values: Values | None = None
    if withheld is not None:
        try:
            written = Written(json.loads(withheld.read_text()), str(withheld))
        except (OSError, ValueError) as error:
            raise BadInput(f"the file cannot be read: {error}", str(withheld), "give a model.json") from error
        settings_from(written, robot.model)  # raises for a file of another robot
        values = model_in(written)[1]
    return OwnScenario(robot, model, reference, values, plant).run(options, progress)
