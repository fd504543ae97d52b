"""The arm of the scenarios: the paper's task-space model of the SCALER arm, localised by its encoders."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from controllers.settings import Limits, MpcSettings, Weights
from plants.scaler_arm.dynamics.step import TASK
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm, Servo
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, Motion, references, tool_path
from plants.scaler_arm.servo_robot import ServoArm
from plants.scaler_arm.twin import ENCODERS, TOOL
from plants.scaler_arm.twin import twin as withheld_twin
from plants.scaler_arm.withheld import Withheld
from plants.sensors import Sensor
from residual_mpc.closed_loop.estimator import EstimatorSettings, Filter, build_filter
from residual_mpc.closed_loop.online import OnlineLearner, OnlineSettings, Row
from residual_mpc.closed_loop.protocols import Reading, Simulator
from residual_mpc.export import Build, augment
from residual_mpc.learning.filter.kalman import FilterSettings
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Values
from scenarios.closed_loop.robot_setup import RobotSetup

DT = 0.01  # s, between commands, as in the paper
NOISE = dict(ENCODERS.sigma)  # rad, rad/s
CAMERA = Sensor(TOOL, period=1 / 30)  # a witness: no controller reads it
LOWER, UPPER = (tuple(limit[i] for limit in SCALER.limits) for i in (0, 1))
CONTROL = MpcSettings(
    # 2 mm off cost as much as 0.05 rad of turn; commands are angles, and no angle costs anything by itself
    weights=Weights((0.002,) * 3 + (0.05,) * 3, command=1e3, change=0.02),
    limits=Limits(LOWER, UPPER, rate=SCALER.speed),
)
ESTIMATOR = EstimatorSettings(noise=(2e-4,) * 6, drift=(0.005,) * 6, disturbance=(0.05,) * 6)
# An update a tenth of a second: weights that predict better than none are in the controller after two of them
ONLINE = OnlineSettings(horizon=10, noise=(1e-4,) * 3, other=(5e-4,) * 3, kalman=FilterSettings(process=1e-6))
# Each pass counts every window as if it were new: a smaller variance keeps the runs from being believed too much
TEACHING = replace(ONLINE, horizon=20, variance=0.01)
# What a network starts from, before any data: rates of slow circles, and a tenth of the tool's speed to learn
TYPICAL = np.full(len(MOTORS), 0.3)  # rad/s
TO_LEARN = np.full(3, 0.01)  # m/s
LIMIT = 6.0  # typical rates
PASSES = 4  # over the training runs, when a network is taught on it
KEPT = 5  # every so-manieth window judges what was taught on the others


@dataclass(frozen=True)
class Path:
    """What the controllers track: the tool on a motion's path, the gripper as at home. The motion's clock starts
    slowly, within `ramp` s, so that an arm at rest can follow it from the start.
    """

    motion: Motion
    ramp: float = 1.0

    def path(self, t: np.ndarray) -> np.ndarray:
        """(n, 6) m and rad at t (n,) s."""
        slow = np.where(t < self.ramp, t * t / (2 * self.ramp), t - 0.5 * self.ramp)
        return np.hstack([tool_path(self.motion, slow), np.zeros((len(t), 3))])

    def begin(self) -> Reading:
        """Motor angles at the path's start."""
        return at_posture(references(self.motion, np.zeros(1))[0])


def arm_twin(engine: str, withheld: Withheld) -> Simulator:
    """The real arm in "mujoco" or "pybullet", seen by its encoders."""
    return withheld_twin(engine, withheld, (ENCODERS, CAMERA))


def circle_line() -> Path:
    """The paper's trajectory A, brisk: a circle in 4 s, the line through it in 4 s."""
    return Path(CircleWithLine(0.04, 4.0, 4.0))


def circle_z() -> Path:
    """The paper's trajectory B, brisk: a circle in 4 s, up and down twice meanwhile."""
    return Path(CircleWithHeight(0.04, 4.0))


# What the nominal controller drives for the log, about as fast as what is scored: a network without memory that is
# taught on motions too fast for it learns to lean against the arm's own lateness, and no controller can drive on that
TRAINING_MOTIONS: tuple[tuple[Callable[[], Path], float], ...] = (
    (circle_line, 9.0),
    (circle_z, 6.0),
    (lambda: Path(CircleWithHeight(0.05, 5.0, 0.03, 1)), 6.0),
    (lambda: Path(CircleWithLine(0.03, 3.0, 3.0)), 7.0),
)


def servo_arm() -> RobotSetup:
    """The arm whose motors are springs and dampers, as in MuJoCo: they give way under its weight."""
    return _setup(ServoArm("scaler_arm_servo"))


def stiff_arm() -> RobotSetup:
    """The arm whose motors hold any load, as PyBullet's do: a thousand times as stiff, and as quick as the others."""
    servo: Servo = SCALER.servo
    stiff: Arm = replace(SCALER, servo=replace(servo, stiffness=1e3 * servo.stiffness, damping=1e3 * servo.damping))
    return _setup(ServoArm("scaler_arm_servo", stiff))


def _setup(robot: ServoArm) -> RobotSetup:
    def teach(runs: tuple[Run, ...], effects: Values, seed: int) -> Residual:
        return train_network(robot, runs, effects, blank_network(seed, DT), seed)

    return RobotSetup(robot, NOISE, ESTIMATOR, CONTROL, teach, blank_network, ONLINE)


def blank_network(seed: int, dt: float) -> Residual:
    """A network of zero output, as before any data: the paper's, six joint rates in and the tool's velocity out."""
    net = Mlp(len(MOTORS))
    inputs = tuple(f"velocity.{m}" for m in MOTORS)
    theta = initial_weights(net, np.random.default_rng(seed))
    at = np.zeros(net.inputs)
    return Residual(net, theta, inputs, TASK, at, TYPICAL, TO_LEARN, "task", dt, "scaler_arm_servo", LIMIT)


def train_network(robot: ServoArm, runs: tuple[Run, ...], effects: Values, blank: Residual, seed: int) -> Residual:
    """The network after `PASSES` over the runs, by the paper's UKF, window by window in random order; blank, where
    windows that it has not learned from are not predicted better by it.
    """
    model = augment(robot, effects, blank, Build(DT))
    estimator = build_filter(model, ESTIMATOR)
    learner = OnlineLearner(estimator, TEACHING)
    windows = [w for run in runs for w in _windows(run, estimator, TEACHING.horizon)]
    seen = [w for i, w in enumerate(windows) if i % KEPT]
    rng = np.random.default_rng(seed)
    for _ in range(PASSES):
        for i in rng.permutation(len(seen)):
            learner.learn(seen[i])
    unseen = windows[::KEPT]
    before, after = (sum(learner.cost(w, p) for w in unseen) for p in (model.p, learner.parameters))
    return blank if after >= before else blank.with_theta(learner.parameters[-blank.net.size :])


def _windows(run: Run, estimator: Filter, horizon: int) -> list[list[Row]]:
    """The run as it was believed while it was driven, cut into windows that share their ends."""
    poses = estimator.model.stepped.poses
    commands = np.stack([run.columns[f"command.{m}"] for m in MOTORS], axis=-1)
    seen = np.stack([run.columns[c] for c in poses], axis=-1)
    belief = estimator.init(dict(zip(poses, seen[0].tolist(), strict=True)))
    rows: list[Row] = []
    sent: np.ndarray | None = None
    for command, pose in zip(commands, seen, strict=True):
        x, belief = estimator.step(belief, sent, dict(zip(poses, pose.tolist(), strict=True)))
        rows.append((x, command, pose))
        sent = command
    return [rows[k : k + horizon + 1] for k in range(0, len(rows) - horizon, horizon)]
