"""Model predictive control by real-time iteration: one linearisation, one quadratic program a sample.

Diehl, Bock and Schloeder, SIAM J. Control Optim. 43(5), 2005. Single shooting: the plan of the last sample, shifted, is
driven through the model from the estimated state, and the program improves it. Where the program fails, or
takes longer than a budget that was set, the shifted plan is sent, which keeps every limit on the commands.

    mpc = build_mpc(model, MpcSettings())
    state = mpc.init()
    command, state, info = mpc.step(state, x, reference)      # reference: poses at the next `horizon` samples

Delay, lag and play of the model are states of it, so the plan counts with commands that are still on their way.
"""

import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from controllers.qp import Qp, QpSolver, qp_solver
from controllers.riccati import root_of, terminal_cost
from controllers.rollout import Rollout, rollout
from controllers.settings import MpcSettings
from controllers.shapes import nothing_to_hold, wrong_state
from controllers.soft import SoftRows, softened
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented

EFFORT = "effort."  # before an actuator's name: a soft limit of its force
Along = tuple[np.ndarray, np.ndarray]  # (N, k) along the plan, (N, k, m) its derivative by the plan
Outcome = Literal["solved", "inaccurate", "shifted"]


@dataclass(frozen=True, eq=False)
class PlanState:
    """plan (N, nu) of the last sample; sent (nu,) command of the last sample; samples and failures so far; the solver's
    engine, which remembers its last solution and belongs to one run alone.
    """

    plan: np.ndarray
    sent: np.ndarray
    samples: int
    failures: int
    engine: QpSolver = field(repr=False)


@dataclass(frozen=True)
class MpcInfo:
    """What one sample came to. seconds: wall time of the step; cost: change of the linearised cost, NaN if shifted."""

    outcome: Outcome
    seconds: float
    cost: float
    failures: int


@dataclass(frozen=True, eq=False)
class Mpc:
    """A built controller. p (np,) are the model's parameters: `with_parameters` swaps them without building anew."""

    model: Augmented
    settings: MpcSettings
    p: np.ndarray
    roll: Rollout
    low: np.ndarray  # (nu,) of the commands
    high: np.ndarray  # (nu,)
    roots: tuple[np.ndarray, np.ndarray]  # (ny, ny) each: square roots of the cost of a stage and of the end
    change: np.ndarray  # (N nu, N nu): changes of the command, from the plan; the first against what was sent last
    fixed: np.ndarray  # (N nu, N nu): what commands and their changes cost, the part of H that never changes

    @property
    def most(self) -> np.ndarray:
        """(nu,) largest change of a command from one sample to the next."""
        return self.settings.limits.most(self.model.nu, self.model.build.dt)

    @property
    def horizon(self) -> int:
        return self.settings.horizon

    @property
    def poses(self) -> np.ndarray:
        """(ny,) places of the model's poses in x."""
        return np.array([self.model.stepped.states.index(c) for c in self.model.stepped.poses])

    def init(self) -> PlanState:
        """At rest, nothing sent yet."""
        plan = np.clip(np.tile(self.model.hold(self.model.start()), (self.horizon, 1)), self.low, self.high)
        engine = qp_solver(self.settings.solver, self._pattern(), self.settings.budget)
        return PlanState(plan, plan[0].copy(), 0, 0, engine)

    def with_parameters(self, p: np.ndarray) -> "Mpc":
        """The same controller with other numbers or weights (np,), for learning while driving."""
        return replace(self, p=np.asarray(p, dtype=np.float64))

    def step(self, state: PlanState, x: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, PlanState, MpcInfo]:
        """Command (nu,) from the estimated state x (nx,) and the outputs wanted at the next N samples (N, ny).

        Where x or the reference is not finite, the shifted plan is sent; at the first sample with a finite x, the
        command that holds the robot there. Raises BadInput for arrays of the wrong shape, and for an x that is not
        finite at the first sample: no command is known to be safe then, least of all 0 for an arm that would fall.
        """
        begin = time.perf_counter()
        if np.shape(x) != (self.model.nx,) or np.shape(reference) != (self.horizon, len(self.model.stepped.tracked)):
            raise self._misshapen(np.shape(x), np.shape(reference))
        if not (state.samples or np.isfinite(x).all()):
            raise nothing_to_hold(self.model, x)
        state = self._begun(state, x)
        plan = self._within(np.concatenate([state.plan[1:], state.plan[-1:]]), state.sent)
        outcome: Outcome = "shifted"
        cost = float("nan")
        if np.isfinite(x).all() and np.isfinite(reference).all():
            for _ in range(self.settings.iterations if state.samples else self.settings.first):
                with np.errstate(over="ignore", invalid="ignore"):  # values that are not finite are caught below
                    qp, soft = self._program(x, plan, state.sent, reference)
                if not (np.isfinite(qp.H).all() and np.isfinite(qp.g).all()):
                    break
                z, status = state.engine.solve(qp)
                if soft is not None and (status != "solved" or not soft.kept(z)):
                    qp = softened(qp, soft)
                    z, status = state.engine.solve(qp)
                late = time.perf_counter() - begin > self.settings.budget
                better = status == "solved" or (status == "inaccurate" and qp.cost(z) < qp.cost(self._idle(qp)))
                if late or not better:
                    break
                plan = self._within(plan + z[: plan.size].reshape(plan.shape), state.sent)
                outcome = "solved" if status == "solved" else "inaccurate"
                cost = qp.cost(z)
        failures = state.failures + (outcome == "shifted")
        command = plan[0].copy()
        info = MpcInfo(outcome, time.perf_counter() - begin, cost, failures)
        return command, PlanState(plan, command, state.samples + 1, failures, state.engine), info

    def _misshapen(self, x: tuple[int, ...], reference: tuple[int, ...]) -> BadInput:
        """The error for a state or a reference of the wrong shape."""
        at = self.model.stepped
        if x != (self.model.nx,):
            return wrong_state(self.model, x)
        n, wanted = self.horizon, (self.horizon, len(at.tracked))
        what = f"the reference must have shape {wanted}, a row for each of the next {n} samples, got {reference}"
        return BadInput(what, "", f"give {', '.join(at.tracked)} in each row")

    def __repr__(self) -> str:
        at = self.model.stepped
        return (
            f"<Mpc of {self.model.robot.name}: {self.horizon} steps of {at.dt:g} s, tracks {', '.join(at.tracked)}, "
            f"commands {', '.join(at.commands)}>"
        )

    def _begun(self, state: PlanState, x: np.ndarray) -> PlanState:
        """Before the first sample a robot is held where it is."""
        if state.samples:
            return state
        plan = np.clip(np.tile(self.model.hold(x), (self.horizon, 1)), self.low, self.high)
        return replace(state, plan=plan, sent=plan[0].copy())

    def _idle(self, qp: Qp) -> np.ndarray:
        """The z of the shifted plan itself: no change, and the slacks that it needs."""
        z, m = np.zeros(len(qp.g)), self.horizon * self.model.nu
        for j in range(len(qp.g) - m):
            column = qp.A[m:, m + j]
            rows = column > 0
            z[m + j] = max(0.0, float((qp.row_low[m:][rows] / column[rows]).max()))
        return z

    def _within(self, plan: np.ndarray, sent: np.ndarray) -> np.ndarray:
        """The plan with every limit on commands kept to the last bit, whatever a solver's tolerance is."""
        most = self.most
        plan = np.clip(plan, self.low, self.high)
        if not np.isfinite(most).any():
            return plan
        steps = np.diff(plan, axis=0, prepend=sent[None])
        if (np.abs(steps) <= most).all():
            return plan
        out, last = np.empty_like(plan), sent
        for k in range(len(plan)):
            last = np.clip(plan[k], last - most, last + most)
            out[k] = last
        return out

    def _program(
        self, x: np.ndarray, plan: np.ndarray, sent: np.ndarray, reference: np.ndarray
    ) -> tuple[Qp, SoftRows | None]:
        """The Gauss-Newton program about the plan; z = (change of the plan, one slack a soft limit).

        Soft limits rarely bind, so they are returned separately and added if needed. OSQP's programs must all have one
        sparsity pattern and always contain them.
        """
        s, n, m = self.settings, self.horizon, plan.size
        states = self.roll.drive(x, plan, self.p)  # (N, nx)
        slopes = self.roll.condense()  # (N, nx, m)
        y, S = self.roll.task(states, slopes)  # (N, ny), (N, ny, m)
        e = y - reference
        roots = self._in_frame(reference, e)
        M = np.matmul(roots, S).reshape(-1, m)
        r = np.matmul(roots, e[:, :, None])[:, :, 0].ravel()
        v, w = (np.tile(part, n) for part in s.weights.of_commands(self.model.nu))
        u = plan.ravel()
        steps = u.copy()
        steps[len(sent) :] -= u[: -len(sent)]
        steps[: len(sent)] -= sent
        H = M.T @ M
        H += self.fixed
        g = M.T @ r + (w * steps) @ self.change + v * u
        low, high = (self.low - plan).ravel(), (self.high - plan).ravel()
        most = np.tile(np.minimum(self.most, 1e20), n)
        qp = Qp(H, g, low, high, self.change, -most - steps, most - steps)
        if not s.limits.soft:
            return qp, None
        forces = None if self.roll.efforts is None else self.roll.forces()
        found = [self._channel(limit.channel, (y, S), (states, slopes), forces) for limit in s.limits.soft]
        soft = SoftRows(s.limits.soft, tuple(value for value, _ in found), tuple(slope for _, slope in found))
        return (softened(qp, soft), None) if s.solver == "osqp" else (qp, soft)

    def _channel(self, name: str, tracked: Along, states: Along, forces: Along | None) -> tuple[np.ndarray, np.ndarray]:
        """(N,) a tracked quantity, a state or an actuator's force along the plan, and its derivative (N, m)."""
        at = self.model.stepped
        if name.startswith(EFFORT) and forces is not None:
            (value, slope), i = forces, at.commands.index(name.removeprefix(EFFORT))
        elif name in at.tracked:
            (value, slope), i = tracked, at.tracked.index(name)
        else:
            (value, slope), i = states, at.states.index(name)
        return value[:, i], slope[:, i]

    def _in_frame(self, reference: np.ndarray, e: np.ndarray) -> np.ndarray:
        """(N, ny, ny) roots of the cost, turned from the reference's frame into the world's; wraps e's heading."""
        stage, end = self.roots
        n, ny = reference.shape
        out = np.broadcast_to(stage, (n, ny, ny)).copy()
        out[-1] = end
        if "pose.theta" not in self.model.stepped.tracked:
            return out
        e[:, 2] = np.remainder(e[:, 2] + np.pi, 2 * np.pi) - np.pi
        c, s = np.cos(reference[:, 2, None]), np.sin(reference[:, 2, None])
        x, y = out[:, :, 0].copy(), out[:, :, 1].copy()
        out[:, :, 0], out[:, :, 1] = x * c - y * s, x * s + y * c
        return out

    def _pattern(self) -> np.ndarray:
        m, extra, n = self.horizon * self.model.nu, len(self.settings.limits.soft), self.horizon
        rows = [np.hstack([self.change != 0, np.zeros((m, extra), dtype=bool)])]
        rows += [np.ones((n, m + extra), dtype=bool)] * (2 * extra)
        return np.vstack(rows)


def build_mpc(model: Augmented, settings: MpcSettings) -> Mpc:
    """Compile the stages and work out the terminal cost; a second or two.

    Raises BadInput where weights or limits do not fit the model, or a soft limit names an unknown channel.
    """
    at = model.stepped
    ny, n, nu = len(at.tracked), settings.horizon, model.nu
    if len(settings.weights.error) != ny:
        what = f"weights.error must have {ny} entries, got {len(settings.weights.error)}"
        raise BadInput(what, model.robot.name, f"give one each for {', '.join(at.tracked)}")
    for soft in settings.limits.soft:
        efforts = () if at.effort is None else tuple(f"{EFFORT}{a}" for a in at.commands)
        if soft.channel not in (*at.tracked, *at.states, *efforts):
            known = ", ".join(dict.fromkeys((*at.tracked, *at.poses, *at.rates, *efforts)))
            raise BadInput(f"a soft limit must be on one of {known}, got {soft.channel!r}", model.robot.name)
    try:
        low, high = settings.limits.box(nu)
        settings.limits.most(nu, model.build.dt)
        weights = settings.weights.of_commands(nu)
    except ValueError as error:
        raise BadInput(
            f"limits and weights must be one number or one for each of {nu} commands: {error}", model.robot.name
        ) from None
    stage = np.diag(1.0 / np.array(settings.weights.error))
    end = root_of(terminal_cost(model, settings.weights, settings.cruise))
    change = np.eye(n * nu) - np.eye(n * nu, k=-nu)
    v, w = (np.tile(part, n) for part in weights)
    fixed = (change.T * w) @ change + np.diag(v)
    forces = any(soft.channel.startswith(EFFORT) for soft in settings.limits.soft)
    roll = rollout(model, n, settings.compile, forces)
    return Mpc(model, settings, model.p, roll, low, high, (stage, end), change, fixed)
