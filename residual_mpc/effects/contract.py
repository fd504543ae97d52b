"""The contract of an effect, as checks that a user's own can run on itself.

from residual_mpc.effects.contract import check_effect
check_effect(MY_EFFECT, np.random.default_rng(0))
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter
from residual_mpc.effects.ops import NUMPY, Ops, casadi_ops
from residual_mpc.effects.plugged import fault_of
from residual_mpc.extras import extra

STEPS, DT = 40, 0.01
CLOSE = 1e-9  # relative, between array libraries


class EffectBroken(Exception):
    """An effect does not keep the contract; the message says which law, what came and what was wanted."""


def check_effect(effect: Effect, rng: np.random.Generator) -> None:
    """Raises EffectBroken unless the effect can be hosted, does nothing at its null value bit for bit, does something
    and nothing infinite at its probes, and gives the same numbers in numpy and CasADi."""
    fault = fault_of(effect)
    _demand(not fault, fault)
    for p in effect.parameters:
        inside = all(p.lower <= x <= p.upper for x in p.probes if p.reference == "one")
        _demand(inside, f"parameter {p.name}: probes {p.probes} outside of [{p.lower}, {p.upper}]")
    _demand(any(p.probes for p in effect.parameters), "no parameter has a probe: the search would never look at it")
    signal = 2.0 * rng.standard_normal((STEPS, 3))
    null = {p.name: np.full(3, p.null) for p in effect.parameters}
    quiet = np.array(run_effect(effect, NUMPY, null, list(signal)))
    wanted = np.zeros_like(signal) if effect.port == "friction" else signal
    _demand(np.array_equal(quiet, wanted), f"at its null value it changes a signal by {np.abs(quiet - wanted).max():g}")
    loud = {p.name: np.full(3, _strongest(p)) for p in effect.parameters}
    there = np.array(run_effect(effect, NUMPY, loud, list(signal)))
    _demand(bool(np.isfinite(there).all()), f"at {_said(loud)} it gives {there[~np.isfinite(there)][:1]}")
    _demand(not np.array_equal(there, wanted), f"at {_said(loud)} it changes nothing")
    _same_in_casadi(effect, loud, signal, there)


def run_effect(effect: Effect, ops: Ops, p: dict[str, Any], rows: Sequence[Any]) -> list[Any]:
    """The equation over a sequence of signals, in the library of `ops`; of a friction the torque against the motion."""
    assert effect.step is not None
    if effect.port == "friction":
        return [effect.step(ops, p, w, 0.5 * w) for w in rows]
    assert effect.start is not None
    command = effect.port == "command"
    memory, out = effect.start(ops, p, rows[0], DT) if command else effect.start(ops, p, rows[0]), []
    for k, x in enumerate(rows):
        y, memory = effect.step(ops, p, memory, x, DT) if command else effect.step(ops, p, memory, x, k * DT, DT)
        out.append(y)
    return out


def _same_in_casadi(effect: Effect, p: dict[str, np.ndarray], signal: np.ndarray, there: np.ndarray) -> None:
    with extra("mpc"):
        import casadi as ca

    u = ca.SX.sym("u", len(signal))
    rows = [u[k] for k in range(len(signal))]
    symbols = {n: ca.DM(float(v[0])) for n, v in p.items()}
    try:
        made = run_effect(effect, casadi_ops(), symbols, rows)
        found = np.array(ca.Function("f", [u], [ca.vertcat(*made)])(signal[:, 0])).ravel()
    except Exception as error:  # numpy spelt where `ops` was wanted
        raise EffectBroken(f"it does not run in CasADi ({error}): write it with the operations of `ops`") from error
    apart = np.abs(found - there[:, 0]).max() / max(np.abs(there[:, 0]).max(), 1e-12)
    _demand(apart < CLOSE, f"numpy and CasADi differ by {apart:g} of its size")


def _strongest(p: Parameter) -> float:
    """The probe that is farthest from doing nothing; the null of a parameter without one."""
    null = 0.0 if np.isinf(p.null) else p.null
    return max(p.probes, key=lambda x: abs(x - null)) if p.probes else p.null


def _said(p: dict[str, np.ndarray]) -> str:
    return ", ".join(f"{n} = {v[0]:g}" for n, v in p.items())


def _demand(holds: bool, message: str) -> None:
    if not holds:
        raise EffectBroken(message)
