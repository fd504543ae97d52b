"""The few operations whose spelling differs between numpy, JAX and CasADi.

An effect's equation is written once against this table (style: one dynamics function for every array library).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.extras import extra

Array = Any  # an ndarray, a jax.Array or a casadi matrix, whichever table is in use


@dataclass(frozen=True)
class Ops:
    """Elementwise operations; each takes and returns arrays of the library it belongs to."""

    where: Callable[[Array, Array, Array], Array]
    minimum: Callable[[Array, Array], Array]
    maximum: Callable[[Array, Array], Array]
    exp: Callable[[Array], Array]
    absolute: Callable[[Array], Array]
    cos: Callable[[Array], Array]
    sin: Callable[[Array], Array]
    sign: Callable[[Array], Array]
    sqrt: Callable[[Array], Array]
    arctan2: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Kinks:
    """How an optimiser sees what is not smooth: the tables of operations for signals of one unit.

    exact: for parameters, and for signals where nothing is smoothed; rough(scale): for signals in a unit that is
    `scale` times a command's. width: of the smoothing, command units; 0 where nothing is smoothed.
    """

    exact: Ops
    rough: Callable[[float], Ops]
    width: float


def clip(ops: Ops, x: Array, low: Array, high: Array) -> Array:
    """x held between low and high."""
    return ops.minimum(ops.maximum(x, low), high)


NUMPY = Ops(
    where=np.where,
    minimum=np.minimum,
    maximum=np.maximum,
    exp=np.exp,
    absolute=np.abs,
    cos=np.cos,
    sin=np.sin,
    sign=np.sign,
    sqrt=np.sqrt,
    arctan2=np.arctan2,
)


def jax_ops() -> Ops:
    """The table for JAX. Raises BadInput where JAX is not installed."""
    with extra("jax"):
        import jax.numpy as jnp
    return Ops(
        where=jnp.where,
        minimum=jnp.minimum,
        maximum=jnp.maximum,
        exp=jnp.exp,
        absolute=jnp.abs,
        cos=jnp.cos,
        sin=jnp.sin,
        sign=jnp.sign,
        sqrt=jnp.sqrt,
        arctan2=jnp.arctan2,
    )


def casadi_ops(sign_width: float = 0.0) -> Ops:
    """The table for CasADi; sign_width > 0 replaces sgn(w) by tanh(w / sign_width) for an optimiser (unit of w)."""
    with extra("mpc"):
        import casadi

    def sign(x: Array) -> Array:
        return casadi.tanh(x / sign_width) if sign_width > 0 else casadi.sign(x)

    return Ops(
        where=casadi.if_else,
        minimum=casadi.fmin,
        maximum=casadi.fmax,
        exp=casadi.exp,
        absolute=casadi.fabs,
        cos=casadi.cos,
        sin=casadi.sin,
        sign=sign,
        sqrt=casadi.sqrt,
        arctan2=casadi.atan2,
    )
