"""PyBullet's two-wheeled robot as the nominal model. PyBullet has no batch: row after row, in processes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plants.outline import box_with_nose
from plants.wheeled.engines.engine import CHANNELS, Motion
from plants.wheeled.engines.geometry import WHEELS, Geometry
from plants.wheeled.engines.pybullet_engine import BulletEngine
from plants.wheeled.simulators import TURTLEBOT
from residual_mpc.effects.library import BY_NAME, Sites, changes, present, slots_of
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.speed_chain import speed_chain
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.settings import Settings

AXES = ("x", "y", "theta")
WORTH = 20_000  # rows times nodes, about a second: below that a second process costs more than it brings


@dataclass(frozen=True)
class BulletRobot:
    """Commands are wheel speeds in rad/s. step_inside: s, the longest step of the engine."""

    name: str
    geometry: Geometry = TURTLEBOT
    step_inside: float = 0.004
    actuators: tuple[str, ...] = WHEELS
    command_kinds: tuple[str, ...] = ("speed", "speed")
    channels: tuple[str, ...] = CHANNELS
    step: float | None = None

    @property
    def states(self) -> tuple[State, ...]:
        planar = tuple(State(f"pose.{a}", f"twist.{a}") for a in AXES)
        return (*planar, *(State(f"velocity.{w}", None) for w in WHEELS))

    @property
    def outline(self) -> np.ndarray:
        """See residual_mpc.models.drawing.Outlined: as wide as its track, from the castor to the wheels' front."""
        g = self.geometry
        half = 0.5 * g.track
        return box_with_nose((g.castor[0] - g.castor[1], -half), (g.left.radius, half))

    @property
    def sites(self) -> Sites:
        """Where effects can act."""
        return {
            **dict.fromkeys(("command", "strength", "limit", "output", "dry friction"), WHEELS),
            **dict.fromkeys(("rolling", "point", "samples"), (self.name,)),
            **dict.fromkeys(("delay", "filter", "clock"), ("pose",)),
            **dict.fromkeys(("offset", "range"), ("pose.theta",)),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        friction = BY_NAME[effect].parameter(parameter).quantity == "dry friction"
        return (0.0, np.inf) if friction else (-np.inf, np.inf)

    def reference(self, kind: str, slot: str | None) -> float:
        wheel = self.geometry.left
        inertia = wheel.armature + 0.5 * self.geometry.mass * wheel.radius**2
        return {"length": self.geometry.track, "inertia": inertia, "mass": self.geometry.mass}.get(kind, 1.0)

    def nominal(self) -> Mapping[str, float]:
        return {"wheel_radius": self.geometry.left.radius, "track_width": self.geometry.track}

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        """See Robot.replay. An encoder that nobody read starts as exactly 0: that wheel rolls with the robot."""
        figures, friction = _figures(self, settings), _friction(settings)
        work = [np.stack([start[c] for c in CHANNELS], axis=1), _set_points(settings, drive), figures, friction]
        order = np.lexsort(figures.T)  # rows of one geometry side by side: each needs an engine of its own
        rows = settings.rows
        parts = np.array_split(order, _processes() if rows * drive.steps > WORTH else 1)
        jobs = [(self, *(w[part] for w in work), drive.dt) for part in parts if len(part)]
        nodes = np.empty((rows, drive.steps + 1, len(CHANNELS)))
        nodes[order] = np.concatenate(_in_processes(jobs))
        out = {}
        for channel in wanted:
            kind, _, name = channel.partition(".")
            out[channel] = nodes[:, :, CHANNELS.index(f"velocity.{name}" if kind == "output" else channel)]
        return out


def _set_points(settings: Settings, drive: Drive) -> np.ndarray:
    """(B, K, 2) rad/s that the motors are asked for; a motor that is off is asked for 0."""
    y = speed_chain(settings.effects, drive.command, drive.on, drive.clock_at_steps, drive.dt)[:, drive.lead :]
    return np.asarray(np.broadcast_to(y, (settings.rows, drive.steps, 2)))


def _figures(robot: BulletRobot, settings: Settings) -> np.ndarray:
    """(B, 3) of each row: left radius, right radius, track, m."""
    one = np.ones(settings.rows)
    left = settings.tuned.get("wheel_radius", robot.geometry.left.radius * one)
    track = settings.tuned.get("track_width", robot.geometry.track * one)
    effects = settings.effects
    both, ratio = changes(effects, "wheel radius"), changes(effects, "right wheel radius")
    scale = changes(effects, "track width")
    if both is not None:
        left = left * both[:, 0]
    # the nominal wheels may differ already
    right = left * (robot.geometry.right.radius / robot.geometry.left.radius)
    if ratio is not None:
        right = right * ratio[:, 0]
    if scale is not None:
        track = track * scale[:, 0]
    return np.stack([left, right, track], axis=1)


def _friction(settings: Settings) -> np.ndarray:
    """(B, 2) N m of dry friction on the wheels."""
    level = np.zeros((settings.rows, 2))
    for effect, p in present(settings.effects, "dry friction"):
        assert effect.step is not None
        level = level + effect.step(NUMPY, p, level, level)
    return level


def _processes() -> int:
    from joblib import cpu_count

    return max(1, int(cpu_count()))


def _in_processes(jobs: list[tuple[object, ...]]) -> list[np.ndarray]:
    if len(jobs) == 1:
        return [_run(*jobs[0])]  # type: ignore[arg-type]
    from joblib import Parallel, delayed

    return list(Parallel(n_jobs=len(jobs))(delayed(_run)(*job) for job in jobs))


def _run(
    robot: BulletRobot,
    start: np.ndarray,
    set_points: np.ndarray,
    figures: np.ndarray,
    friction: np.ndarray,
    dt: float,
) -> np.ndarray:
    """(b, K + 1, channels) from starts (b, channels), set points (b, K, 2), figures (b, 3), frictions (b, 2)."""
    out = np.empty((len(start), set_points.shape[1] + 1, len(CHANNELS)))
    out[:, 0] = start
    bounds = [0, *(np.flatnonzero(np.any(np.diff(figures, axis=0) != 0, axis=1)) + 1).tolist(), len(start)]
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        _run_one_geometry(robot, start[a:b], set_points[a:b], figures[a], friction[a:b], dt, out[a:b])
    theta = out[:, :, 2]
    # the engine's headings are wrapped, the start's is not
    step = (np.diff(theta, axis=1) + np.pi) % (2 * np.pi) - np.pi
    theta[:, 1:] = theta[:, :1] + np.cumsum(step, axis=1)
    return out


def _run_one_geometry(
    robot: BulletRobot,
    start: np.ndarray,
    set_points: np.ndarray,
    figures: np.ndarray,
    friction: np.ndarray,
    dt: float,
    out: np.ndarray,
) -> None:
    """Fill out[:, 1:]; headings are wrapped."""
    inside = max(1, int(np.ceil(dt / robot.step_inside - 1e-9)))
    engine = BulletEngine(_with(robot.geometry, figures), dt / inside)
    try:
        for i in range(len(start)):
            engine.place(_rolling(start[i], figures))
            engine.resist(friction[i] + [w.kinetic for w in robot.geometry.wheels])
            for k in range(set_points.shape[1]):
                engine.advance(set_points[i, k], dt / inside, inside)
                motion = engine.motion()
                out[i, k + 1] = (motion.x, motion.y, motion.theta, motion.vx, motion.vy, motion.yaw, *motion.wheel)
    finally:
        engine.close()


def _with(geometry: Geometry, figures: np.ndarray) -> Geometry:
    """The robot with other wheels at another distance. Wheels of two sizes tilt it, by their difference over the
    track, which changes its path by that squared.
    """
    left, right, track = figures.tolist()
    return replace(
        geometry, left=replace(geometry.left, radius=left), right=replace(geometry.right, radius=right), track=track
    )


def _rolling(start: np.ndarray, figures: np.ndarray) -> Motion:
    x, y, theta, vx, vy, yaw, left, right = start.tolist()
    radius_left, radius_right, track = figures.tolist()
    forward = vx * np.cos(theta) + vy * np.sin(theta)
    left = left if left != 0.0 else (forward - 0.5 * track * yaw) / radius_left
    right = right if right != 0.0 else (forward + 0.5 * track * yaw) / radius_right
    return Motion(x, y, theta, vx, vy, yaw, (left, right))
