"""The model driven along a plan, with its derivatives: every stage in one compiled call."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.export.augmented import Augmented
from residual_mpc.export.casadi_model import casadi_model
from residual_mpc.export.compiled import Buffered, buffered, compiled, compiler
from residual_mpc.extras import extra


@dataclass(frozen=True, eq=False)
class Rollout:
    """Fixed arrays that one call fills. Single shooting: the states are those of the plan, so no stage has a defect."""

    nx: int
    nu: int
    steps: int
    call: Buffered
    sensitivity: np.ndarray  # (steps + 1, nx, steps * nu) dx_k / dU, filled below the diagonal
    tracked: np.ndarray | None  # (ny,) places in x of what is tracked; None where it is a function of the state
    efforts: int | None = None  # index of the first result of the actuators' forces; None without them

    def drive(self, x: np.ndarray, plan: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(steps, nx) states after each step, from x (nx,) under plan (steps, nu) and parameters p (np,)."""
        a = self.call.arguments
        a[0][:], a[1][:], a[2][:] = x, plan.ravel(), p
        self.call.run()
        return self.call.results[0].reshape(self.steps, self.nx)

    def condense(self) -> np.ndarray:
        """(steps, nx, steps * nu) dx_k / dU along the plan driven last, by the chain rule over the stages."""
        n, m, s = self.nx, self.nu, self.sensitivity
        a = self.call.results[1].reshape(self.steps, n, n).transpose(0, 2, 1)
        b = self.call.results[2].reshape(self.steps, m, n).transpose(0, 2, 1)
        s[1, :, :m] = b[0]
        for k in range(1, self.steps):
            np.matmul(a[k], s[k, :, : k * m], out=s[k + 1, :, : k * m])
            s[k + 1, :, k * m : (k + 1) * m] = b[k]
        return s[1:]

    def task(self, states: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(y (steps, ny), dy / dU (steps, ny, steps * nu)) of what is tracked, from what `drive`, `condense` gave."""
        if self.tracked is not None:
            return states[:, self.tracked], slopes[:, self.tracked]
        y = self.call.results[3].reshape(self.steps, -1)
        c = self.call.results[4].reshape(self.steps, self.nx, -1).transpose(0, 2, 1)
        return y, np.matmul(c, slopes)


    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """(F (steps, nu), dF / dU (steps, nu, steps * nu)): the actuators' forces at the beginning of each step, after
        `drive` and `condense`.
        """
        assert self.efforts is not None
        n, m, found = self.nx, self.nu, self.call.results[self.efforts :]
        by_x = found[1].reshape(self.steps, n, m).transpose(0, 2, 1)
        by_u = found[2].reshape(self.steps, m, m).transpose(0, 2, 1)
        slopes = np.matmul(by_x, self.sensitivity[: self.steps])
        for k in range(self.steps):
            slopes[k, :, k * m : (k + 1) * m] += by_u[k]
        return found[0].reshape(self.steps, m), slopes


def rollout(model: Augmented, steps: int, compile: bool, efforts: bool = False) -> Rollout:
    """Build it; a second or two where it is compiled, the first time in a process. efforts: whether with `forces`."""
    with extra("mpc"):
        import casadi as ca

    c = casadi_model(model)
    stage, output = c.through, c.output
    x, plan, p = ca.MX.sym("x", model.nx), ca.MX.sym("plan", model.nu, steps), ca.MX.sym("p", len(model.p))
    states, a, b, forces = [], [], [], []
    at = x
    for k in range(steps):
        forces.append(c.effort(at, plan[:, k], p) if efforts else ())
        at, ak, bk = stage(at, plan[:, k], p)
        states.append(at)
        a.append(ak)
        b.append(bk)
    outputs = [ca.horzcat(*states), ca.horzcat(*a), ca.horzcat(*b)]
    n, m, ny = model.nx, model.nu, len(model.stepped.tracked)
    lengths = [n * steps, n * n * steps, n * m * steps]
    tracked = None
    if output is None:
        tracked = np.array([model.stepped.states.index(name) for name in model.stepped.tracked])
    else:
        found = [output(x) for x in states]
        outputs += [ca.horzcat(*[y for y, _ in found]), ca.horzcat(*[slope for _, slope in found])]
        lengths += [ny * steps, ny * n * steps]
    first = len(outputs) if efforts else None
    if efforts:
        outputs += [ca.horzcat(*part) for part in zip(*forces, strict=True)]
        lengths += [m * steps, m * n * steps, m * m * steps]
    function = compiled(ca.Function("rollout", [x, plan, p], outputs), compiler() if compile else None)
    call = buffered(function, (n, m * steps, len(model.p)), lengths)
    return Rollout(n, m, steps, call, np.zeros((steps + 1, n, m * steps)), tracked, first)
