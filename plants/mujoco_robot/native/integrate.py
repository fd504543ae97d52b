"""One step of MuJoCo's for a chain of hinges and slides, by the integrators that it has for them.

Semi-implicit Euler, with implicit damping, and the classical Runge-Kutta method (MuJoCo's documentation, Computation,
"Numerical integration"; engine_forward.c).
"""

from __future__ import annotations

from plants.mujoco_robot.native.chain import Chain, Row
from plants.mujoco_robot.native.lanes import load, store
from plants.mujoco_robot.native.program import VECTOR, Program, Value
from plants.mujoco_robot.native.step import accelerations

# Runge-Kutta's stages: how far the next stage lies along this one's rates, and their weight in the step
STAGES = ((0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0))


def trace(
    p: Program, chain: Chain, numbers: Value, state: Value, controls: Value, outputs: Value, failed: Value
) -> None:
    """Add one step to the program, from arrays of vectors. state: positions, velocities, then the accelerations that
    the solver begins with; outputs (nu): written; failed (1): 1 where the constraints' solver has not converged."""
    n, row = len(chain.joints), Row(p, numbers, chain)
    if chain.integrator == "RK4":
        _in_stages(p, chain, row, state, controls, outputs, failed)
        return
    h = row.step
    q, v = ([load(p, state, k * n + i) for i in range(n)] for k in (0, 1))
    a, keep = accelerations(p, chain, row, q, v, state, controls, outputs, failed)
    for i in range(n):
        after = v[i] + h * a[i]
        store(p, q[i] + h * after, state, i)
        store(p, after, state, n + i)
        store(p, keep[i], state, 2 * n + i)


def _in_stages(
    p: Program, chain: Chain, row: Row, state: Value, controls: Value, outputs: Value, failed: Value
) -> None:
    """A step by the classical Runge-Kutta method. The stages are rounds of a loop, which is as short as one of them."""
    n = len(chain.joints)
    along, sums, begun = p.memory(VECTOR, 2 * len(STAGES)), p.memory(VECTOR, 2 * n), p.memory(VECTOR, 2 * n)
    for k, numbers in enumerate(STAGES):
        for j, x in enumerate(numbers):
            store(p, x, along, 2 * k + j)
    for i in range(2 * n):
        store(p, load(p, state, i), begun, i)
        store(p, 0.0, sums, i)

    def stage(k: Value) -> None:
        q, v = ([load(p, state, j * n + i) for i in range(n)] for j in (0, 1))
        a, keep = accelerations(p, chain, row, q, v, state, controls, outputs, failed)
        here = p.place(VECTOR, along, p.pure(f"mul i64 {k}, 2"))
        reach, weight = row.step * load(p, here, 0), load(p, here, 1)
        for i, rate in enumerate([*v, *a]):
            store(p, load(p, sums, i) + weight * rate, sums, i)
            store(p, load(p, begun, i) + reach * rate, state, i)
        for i in range(n):
            store(p, keep[i], state, 2 * n + i)

    p.loop(str(len(STAGES)), stage)
    h = row.step
    for i in range(2 * n):
        store(p, load(p, begun, i) + h * load(p, sums, i), state, i)
