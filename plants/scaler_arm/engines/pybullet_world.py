"""One PyBullet world with one arm in it: the urdf loaded, the loop closed by the constraint solver."""

import tempfile
from pathlib import Path

import numpy as np

from plants.pybullet_import import import_pybullet
from plants.scaler_arm.engines.urdf import urdf
from plants.scaler_arm.kinematics.geometry import MOTORS, PASSIVE, Arm
from plants.scaler_arm.kinematics.loop_closure import Joints

LOOP_FORCE = 1e4  # N: the constraint never gives way
# By default the solver (50 sweeps, a fifth of the error mended a step) lets the loop open by 1.5 mm at 0.01 s a step,
# and the tool is 4 mm off; so set, it is 0.1 mm and 0.25 mm, for two to three times the time.
SWEEPS, MENDED = 200, 0.8


class World:
    """A leaf: owns a connection. Angles rad, rates rad/s, in the order of MOTORS + PASSIVE."""

    def __init__(self, arm: Arm, friction: bool = True, gravity: bool = True) -> None:
        p = self._p = import_pybullet()
        self._client = p.connect(p.DIRECT)
        self._arm = arm
        p.setGravity(0, 0, -9.81 if gravity else 0.0, physicsClientId=self._client)
        p.setPhysicsEngineParameter(numSolverIterations=SWEEPS, erp=MENDED, physicsClientId=self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scaler_arm.urdf"
            path.write_text(urdf(arm, friction))
            self._body = p.loadURDF(
                str(path), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=self._client
            )
        count = p.getNumJoints(self._body, physicsClientId=self._client)
        info = [p.getJointInfo(self._body, i, physicsClientId=self._client) for i in range(count)]
        self._index = {i[1].decode(): i[0] for i in info}
        self._all = [self._index[n] for n in MOTORS + PASSIVE]
        for i in range(-1, count):  # Bullet damps every body by default
            p.changeDynamics(self._body, i, linearDamping=0, angularDamping=0, physicsClientId=self._client)
        for i in self._all:  # and brakes every joint
            p.setJointMotorControl2(self._body, i, p.VELOCITY_CONTROL, force=0, physicsClientId=self._client)
        self._close_loop()

    def _close_loop(self) -> None:
        """Hold the rods' points together; PyBullet wants them from each link's centre of mass."""
        p = self._p
        b, e = self._arm.joint("b").body.com, self._arm.joint("e").body.com
        held = p.createConstraint(
            self._body,
            self._index["b"],
            self._body,
            self._index["e"],
            p.JOINT_POINT2POINT,
            (0, 0, 0),
            [x - c for x, c in zip(self._arm.on_b, b, strict=True)],
            [x - c for x, c in zip(self._arm.on_e, e, strict=True)],
            physicsClientId=self._client,
        )
        p.changeConstraint(held, maxForce=LOOP_FORCE, physicsClientId=self._client)

    def put(self, joints: Joints) -> None:
        """Every joint set as told."""
        angles, rates = np.append(joints.motors, joints.passive), np.append(joints.motor_rates, joints.rates)
        for i, q, v in zip(self._all, angles, rates, strict=True):
            self._p.resetJointState(self._body, i, float(q), float(v), physicsClientId=self._client)

    def joints(self) -> tuple[np.ndarray, np.ndarray]:
        """(angles (8,), rates (8,))."""
        states = self._p.getJointStates(self._body, self._all, physicsClientId=self._client)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def torques(self) -> np.ndarray:
        """(6,) N m that the motors gave in the last step."""
        states = self._p.getJointStates(self._body, self._all[: len(MOTORS)], physicsClientId=self._client)
        return np.array([s[3] for s in states])

    def point(self, link: str) -> np.ndarray:
        """(3,) m: the origin of one of the links tool, loop_b and loop_e."""
        state = self._p.getLinkState(
            self._body, self._index[f"to_{link}"], computeForwardKinematics=True, physicsClientId=self._client
        )
        return np.array(state[4])

    def servo(self, command: np.ndarray, dt: float, torque: np.ndarray | None = None) -> None:
        """Position control towards command (6,) rad within torque (6,) N m (the arm's by default), for steps of dt s.

        Bullet's motor is a constraint on the speed: it asks for gain * error / dt, within its torque. The gain is set
        so that the error decays as that of the spring and damper would without any load.
        """
        p, s = self._p, self._arm.servo
        n = len(MOTORS)
        p.setTimeStep(dt, physicsClientId=self._client)
        p.setJointMotorControlArray(
            self._body,
            self._all[:n],
            p.POSITION_CONTROL,
            targetPositions=[float(u) for u in command],
            forces=[s.torque] * n if torque is None else [float(x) for x in torque],
            positionGains=[min(1.0, s.stiffness / s.damping * dt)] * n,
            velocityGains=[1.0] * n,
            physicsClientId=self._client,
        )

    def step(self) -> None:
        self._p.stepSimulation(physicsClientId=self._client)

    def set_step(self, dt: float) -> None:
        self._p.setTimeStep(dt, physicsClientId=self._client)

    def close(self) -> None:
        self._p.disconnect(physicsClientId=self._client)
