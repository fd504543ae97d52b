"""LQR: about a point, and along a trajectory that the model itself can drive.

About a point the Riccati equation is python-control's. Along a trajectory the finite recursion runs backwards over the
exact linearisations (Anderson and Moore, Optimal Control, 1990, chapter 2), the network's derivative in them. The input
is the change of the command, so that lag and delay of the model and the last command are all part of the state.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from controllers.mpc import MpcInfo, build_mpc
from controllers.riccati import controlled, slopes, stage_cost, with_last_command
from controllers.settings import Limits, MpcSettings
from controllers.shapes import wrong_state
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.export.casadi_model import casadi_model


def backwards(
    A: Sequence[np.ndarray],
    B: Sequence[np.ndarray],
    Q: np.ndarray | Sequence[np.ndarray],
    R: np.ndarray,
    end: np.ndarray,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """K_k (nu, nx), k = 0 to n - 1, and P_k (nx, nx), k = 0 to n, of x_{k+1} = A_k x_k + B_k u_k, u_k = -K_k x_k.

    x_0'P_0 x_0 is the least cost, Q (one, or one a step) and R a step and `end` at the end.
    """
    each = [Q] * len(A) if isinstance(Q, np.ndarray) else Q
    P, gains, costs = end, [], [end]
    for a, b, q in zip(reversed(A), reversed(B), reversed(each), strict=True):
        K = np.linalg.solve(R + b.T @ P @ b, b.T @ P @ a)
        P = q + a.T @ P @ (a - b @ K)
        P = 0.5 * (P + P.T)
        gains.append(K)
        costs.append(P)
    return gains[::-1], costs[::-1]


@dataclass(frozen=True, eq=False)
class LqrState:
    """sample: number of the next one; sent (nu,): the last command."""

    sample: int
    sent: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Lqr:
    """Feedback about a trajectory. x (n + 1, nx), u (n, nu): what the model drives; K (n, nu, states + nu)."""

    model: Augmented
    limits: Limits
    x: np.ndarray
    u: np.ndarray
    K: np.ndarray
    states: np.ndarray
    horizon: int = 1

    def init(self) -> LqrState:
        """At rest, nothing sent yet."""
        return LqrState(0, np.clip(self.model.hold(self.x[0]), *self.limits.box(self.model.nu)))

    def step(self, state: LqrState, x: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, LqrState, MpcInfo]:
        """Command (nu,) from the estimate x (nx,). `reference` is not used: the trajectory was planned ahead.

        Raises BadInput if the estimate has the wrong shape.
        """
        import time

        if np.shape(x) != (self.model.nx,):
            raise wrong_state(self.model, np.shape(x))
        begin = time.perf_counter()
        k = min(state.sample, len(self.u) - 1)
        before = self.u[k - 1] if k else self.model.hold(self.x[0])
        off = x - self.x[k]
        if "pose.theta" in self.model.stepped.states:
            i = self.model.stepped.states.index("pose.theta")
            off[i] = np.remainder(off[i] + np.pi, 2 * np.pi) - np.pi
        change = self.u[k] - before - self.K[k] @ np.concatenate([off[self.states], state.sent - before])
        good = bool(np.isfinite(change).all())
        wanted = state.sent + change if good else state.sent
        most = self.limits.most(self.model.nu, self.model.build.dt)
        command = np.clip(wanted, state.sent - most, state.sent + most)
        command = np.clip(command, *self.limits.box(self.model.nu))
        outcome = "solved" if good else "shifted"
        info = MpcInfo(outcome, time.perf_counter() - begin, float("nan"), 0)  # type: ignore[arg-type]
        return command, LqrState(state.sample + 1, command), info

    def __repr__(self) -> str:
        seconds = len(self.u) * self.model.build.dt
        return f"<Lqr of {self.model.robot.name}: along a path of {seconds:.4g} s>"

    def with_parameters(self, p: np.ndarray) -> "Lqr":
        """Raises BadInput: gains along a trajectory are worked out beforehand."""
        raise BadInput("LQR does not support online learning", self.model.robot.name, "use MPC")


def build_lqr(model: Augmented, path: np.ndarray, settings: MpcSettings, at: Mapping[str, float] | None = None) -> Lqr:
    """Gains along `path` (n + horizon, ny), what is tracked a sample apart, from rest at its first row; at: the poses
    there, where they are not what is tracked.

    The trajectory is the one that the MPC drives on the model itself: it keeps the limits, and the model can follow it.
    """
    mpc = build_mpc(model, replace(settings, budget=math.inf))
    n = len(path) - settings.horizon
    begin = at if at is not None else dict(zip(model.stepped.poses, path[0].tolist(), strict=True))
    x, state = model.start(begin), mpc.init()
    c = casadi_model(model)
    xs, us, A, B, Q = [x], [], [], [], []
    states = controlled(model)
    for k in range(n):
        u, state, _ = mpc.step(state, x, path[k + 1 : k + 1 + settings.horizon])
        new, a, b = (np.array(v) for v in c.through(x, u, model.p))
        bigger = with_last_command(a[np.ix_(states, states)], b[states])
        A.append(bigger[0])
        B.append(bigger[1])
        cost, R = stage_cost(settings.weights, model, states, slopes(c, model, x, states))
        Q.append(cost)
        x = new.ravel()
        xs.append(x)
        us.append(u)
    gains, _ = backwards(A, B, Q, R, 10.0 * Q[-1])
    return Lqr(model, settings.limits, np.array(xs), np.array(us), np.array(gains), states)
