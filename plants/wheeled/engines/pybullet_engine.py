"""The two-wheeled robot in PyBullet."""

import tempfile
from pathlib import Path

import numpy as np

from plants.pybullet_import import import_pybullet
from plants.wheeled.engines.engine import SETTLE, Motion
from plants.wheeled.engines.geometry import Geometry, wheel_inertia
from plants.wheeled.engines.urdf import urdf

JOINTS = (0, 1)  # left, right: the order of the URDF
CHASSIS = -1


class BulletEngine:
    """See Engine. `step` is the longest step, s. The motors' law is MuJoCo's, evaluated at each step's beginning."""

    def __init__(self, geometry: Geometry, step: float) -> None:
        p = self._p = import_pybullet()
        self._client = client = p.connect(p.DIRECT)
        self._wheels = geometry.wheels
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        # by default the solver stops at a residual that shows as 0.02 % of false slip
        p.setPhysicsEngineParameter(
            fixedTimeStep=step, solverResidualThreshold=1e-12, enableConeFriction=1, physicsClientId=client
        )
        ground = p.createMultiBody(
            0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client
        )
        self._dynamics(ground, CHASSIS, lateralFriction=1.0)
        self._body = self._load(geometry)
        self._centre = geometry.centre
        self._step = step
        self.advance(np.zeros(2), step, int(SETTLE / step) + 1)
        place, turn = p.getBasePositionAndOrientation(self._body, physicsClientId=client)
        self._height, self._turn = place[2], turn
        self._settled = p.saveState(physicsClientId=client)

    def _load(self, geometry: Geometry) -> int:
        p = self._p
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(urdf(geometry))
            body = p.loadURDF(
                str(path),
                [0, 0, geometry.left.radius],
                flags=p.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self._client,
            )
        for link in (CHASSIS, *JOINTS):
            # one at a time: together with a damping, PyBullet gives the friction to the wrong link
            for name in ("rollingFriction", "spinningFriction", "linearDamping", "angularDamping", "jointDamping"):
                self._dynamics(body, link, **{name: 0.0})
            self._dynamics(body, link, lateralFriction=0.0 if link == CHASSIS else geometry.wheels[link].grip)
        for joint, wheel in zip(JOINTS, geometry.wheels, strict=True):
            about, across = wheel_inertia(wheel)
            # the rotor's inertia; a URDF with it is refused, for no solid body has such moments
            self._dynamics(body, joint, localInertiaDiagonal=[across, about + wheel.armature, across])
            p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=wheel.kinetic, physicsClientId=self._client)
        return int(body)

    def _dynamics(self, body: int, link: int, **one: object) -> None:
        self._p.changeDynamics(body, link, physicsClientId=self._client, **one)

    def place(self, motion: Motion) -> None:
        p, client = self._p, self._client
        p.restoreState(self._settled, physicsClientId=client)
        own = p.getEulerFromQuaternion(self._turn)[2]
        turn = p.getQuaternionFromEuler([0, 0, motion.theta - own])
        _, whole = p.multiplyTransforms([0, 0, 0], turn, [0, 0, 0], self._turn)
        arm = self._arm(whole)
        at = (motion.x + arm[0], motion.y + arm[1], self._height)
        p.resetBasePositionAndOrientation(self._body, at, whole, physicsClientId=client)
        velocity = (motion.vx - motion.yaw * arm[1], motion.vy + motion.yaw * arm[0], 0.0)
        p.resetBaseVelocity(self._body, velocity, (0.0, 0.0, motion.yaw), physicsClientId=client)
        for joint, speed in zip(JOINTS, motion.wheel, strict=True):
            p.resetJointState(self._body, joint, 0.0, speed, physicsClientId=client)

    def _arm(self, turn: tuple[float, ...]) -> tuple[float, float, float]:
        """m from the robot's frame to its chassis' centre of mass, in the world. Without numpy: it costs more here."""
        a, (x, y, z) = self._p.getMatrixFromQuaternion(turn), self._centre
        return (
            a[0] * x + a[1] * y + a[2] * z,
            a[3] * x + a[4] * y + a[5] * z,
            a[6] * x + a[7] * y + a[8] * z,
        )

    def motion(self) -> Motion:
        p, client = self._p, self._client
        place, turn = p.getBasePositionAndOrientation(self._body, physicsClientId=client)
        velocity, spin = p.getBaseVelocity(self._body, physicsClientId=client)
        ax, ay, az = self._arm(turn)
        vx = velocity[0] - (spin[1] * az - spin[2] * ay)
        vy = velocity[1] - (spin[2] * ax - spin[0] * az)
        yaw = p.getEulerFromQuaternion(turn)[2]
        return Motion(place[0] - ax, place[1] - ay, yaw, vx, vy, spin[2], self._speeds())

    def _speeds(self) -> tuple[float, float]:
        left, right = self._p.getJointStates(self._body, JOINTS, physicsClientId=self._client)
        return float(left[1]), float(right[1])

    def resist(self, torque: np.ndarray) -> None:
        """As Bullet's own joint motor that holds a speed of 0 with no more than this torque."""
        for joint, level in zip(JOINTS, torque.tolist(), strict=True):
            self._p.setJointMotorControl2(
                self._body, joint, self._p.VELOCITY_CONTROL, force=level, physicsClientId=self._client
            )

    def grip(self, grip: np.ndarray) -> None:
        for joint, value in zip(JOINTS, grip.tolist(), strict=True):
            self._dynamics(self._body, joint, lateralFriction=value)

    def advance(self, set_point: np.ndarray, dt: float, steps: int) -> None:
        p, client = self._p, self._client
        if dt != self._step:
            p.setTimeStep(dt, physicsClientId=client)
            self._step = dt
        wanted = set_point.tolist()
        for _ in range(steps):
            for joint, wheel, goal, speed in zip(JOINTS, self._wheels, wanted, self._speeds(), strict=True):
                torque = min(max(wheel.gain * (goal - speed), -wheel.torque), wheel.torque)
                p.setJointMotorControl2(self._body, joint, p.TORQUE_CONTROL, force=torque, physicsClientId=client)
            p.stepSimulation(physicsClientId=client)

    def close(self) -> None:
        self._p.disconnect(physicsClientId=self._client)
