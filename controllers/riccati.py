"""Linearise, and solve the Riccati equation: what LQR and the MPC's terminal cost share."""

import numpy as np

from controllers.settings import Weights
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.export.casadi_model import CasadiModel, casadi_model
from residual_mpc.extras import extra
from residual_mpc.models import optional

# states that no command moves, that only the network reads or writes, or where a motor is in its play
UNCONTROLLED = ("clock", "disturbance.", "last.", "offset.", "play.")
REACHED, BELOW = 0.9, 0.8  # share of the wanted speed that will do, and of its highest at which a robot is not limited
SETTLED = 3.0  # s, after which a lag or delay of a steady command has settled


def dlqr(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K (nu, nx) and P (nx, nx) of u = -K x, minimal cost x0'P x0, by python-control.

    Raises BadInput where no stabilising solution exists.
    """
    with extra("mpc"):
        import control

    try:
        P, _, K = control.dare(A, B, Q, R)
    except (ValueError, control.ControlArgument, np.linalg.LinAlgError) as error:
        raise BadInput(
            f"the Riccati equation has no stabilising solution: {error}",
            "linearisation",
            "linearise about a motion: a robot at rest cannot move sideways",
        ) from error
    if not np.isfinite(P).all():
        raise BadInput("the Riccati equation has no finite solution", "linearisation", "linearise about a motion")
    return np.asarray(K), np.asarray(P)


def steady_motion(model: Augmented, cruise: float) -> tuple[np.ndarray, np.ndarray]:
    """(x (nx,), u (nu,)): straight on along x at about `cruise` m/s, all memory settled, at the origin; a fixed robot:
    held at home.

    Equal commands to all actuators, as large as the model needs: found by secant steps over a settled drive; below its
    limit where the robot is not that fast.
    """
    if model.stepped.holding is not None:
        u = model.hold(model.start())
        return _settle(model, u), u
    u, speed = np.full(model.nu, 1.0), 0.0
    for _ in range(4):
        x = _settle(model, u)
        there = model.numpy_step(x, u)
        speed = float(np.hypot(*(there - x)[:2])) / model.build.dt
        if speed < 1e-6:  # a dead zone: push harder
            u = 3.0 * u
            continue
        u = u * np.clip(cruise / speed, 0.2, 8.0)
    if 0.0 < speed < REACHED * cruise:
        return steady_motion(model, BELOW * speed)
    x = _settle(model, u)
    for name in model.stepped.poses:
        x[model.stepped.states.index(name)] = 0.0
    return x, u


def linearise(model: Augmented, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (nx, nx), B (nx, nu) of the step, the network's exact derivative in it; no dead zone, play or dry friction."""
    _, a, b = casadi_model(model).through(x, u, model.p)
    return np.array(a), np.array(b)


def controlled(model: Augmented) -> np.ndarray:
    """Indices of the states that a command moves and a cost may see."""
    held = {f"{of}.{joint}" for joint in optional.held_joints(model.robot) for of in ("position", "velocity")}
    states = enumerate(model.stepped.states)
    return np.array([i for i, s in states if s not in held and not s.startswith(UNCONTROLLED)])


def with_last_command(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The system whose input is the change of the command: state (x, u), A = [[A, B], [0, I]], B = [[B], [I]]."""
    n, m = B.shape
    bigger = np.block([[A, B], [np.zeros((m, n)), np.eye(m)]])
    return bigger, np.vstack([B, np.eye(m)])


def slopes(c: CasadiModel, model: Augmented, x: np.ndarray, states: np.ndarray) -> np.ndarray:
    """(ny, states) of what is tracked, by the states of these indices, at x (nx,)."""
    if c.output is None:
        tracked = [model.stepped.states.index(name) for name in model.stepped.tracked]
        return np.asarray(np.eye(model.nx)[tracked][:, states])
    return np.array(c.output(x)[1])[:, states]


def stage_cost(
    weights: Weights, model: Augmented, states: np.ndarray, C: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Q over (states, last command) and R over the change. C (ny, states): slopes of what is tracked, by default those
    of a robot at its rest.
    """
    if C is None:
        C = slopes(casadi_model(model), model, model.start(), states)
    Q = np.zeros((len(states) + model.nu,) * 2)
    root = C / np.array(weights.error)[:, None]
    Q[: len(states), : len(states)] = root.T @ root
    command, change = weights.of_commands(model.nu)
    Q[len(states) :, len(states) :] = np.diag(command)
    return Q, np.diag(change)


def terminal_cost(model: Augmented, weights: Weights, cruise: float) -> np.ndarray:
    """(ny, ny) cost of an error at the horizon's end, a planar one in the reference's own frame: the Riccati solution
    at a steady motion, its block of poses, brought to what is tracked.
    """
    states = controlled(model)
    x, u = steady_motion(model, cruise)
    A, B = linearise(model, x, u)
    A, B = with_last_command(A[np.ix_(states, states)], B[states])
    C = slopes(casadi_model(model), model, x, states)
    Q, R = stage_cost(weights, model, states, C)
    Q = Q + 1e-9 * np.eye(len(Q))  # memory that no error sees is still to be detectable
    _, P = dlqr(A, B, Q, R)
    poses = [model.stepped.states.index(c) for c in model.stepped.poses]
    where = np.flatnonzero(np.isin(states, poses))
    back = np.linalg.pinv(C[:, where], rcond=1e-3)  # the least move of the poses that makes an error
    block = back.T @ P[np.ix_(where, where)] @ back
    return 0.5 * (block + block.T)


def root_of(cost: np.ndarray) -> np.ndarray:
    """R (n, n) with R'R = cost (n, n), which may lack directions in which the robot cannot move what it tracks."""
    try:
        return np.asarray(np.linalg.cholesky(cost).T)
    except np.linalg.LinAlgError:
        values, axes = np.linalg.eigh(cost)
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T)


def _settle(model: Augmented, u: np.ndarray) -> np.ndarray:
    x = model.start()
    for _ in range(int(np.ceil(SETTLED / model.build.dt))):
        x = model.numpy_step(x, u)
    # turned back to straight on: unequal wheels drive an arc, and its heading says nothing here
    if "pose.theta" in model.stepped.states:
        x[model.stepped.states.index("pose.theta")] = 0.0
    return x
