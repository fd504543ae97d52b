"""Weighted least squares polynomials of many short windows at once."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.run import FloatArray


def quadratic(powers: FloatArray, values: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The weighted least squares quadratic of every window: at its samples (n, k), and its slope at tau = 0 (n,).

    Args:
        powers: (5, n, k) tau^0 to tau^4.
        values, weight: (n, k).
    """
    m0, m1, m2, m3, m4 = np.einsum("nk,pnk->pn", weight, powers)
    r0, r1, r2 = np.einsum("nk,nk,pnk->pn", weight, values, powers[:3])
    # the symmetric 3 x 3 normal equations by cofactors: thousands of tiny systems at once
    c00, c01, c02 = m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2
    c11, c12, c22 = m0 * m4 - m2 * m2, m1 * m2 - m0 * m3, m0 * m2 - m1 * m1
    scale = 1.0 / (m0 * c00 + m1 * c01 + m2 * c02 + 1e-300)
    a = (c00 * r0 + c01 * r1 + c02 * r2) * scale
    b = (c01 * r0 + c11 * r1 + c12 * r2) * scale
    c = (c02 * r0 + c12 * r1 + c22 * r2) * scale
    return a[:, None] + b[:, None] * powers[1] + c[:, None] * powers[2], b


def line_at_zero(powers: FloatArray, values: FloatArray, weight: FloatArray) -> FloatArray:
    """The weighted least squares line of every window at tau = 0, (n,)."""
    m0, m1, m2 = np.einsum("nk,pnk->pn", weight, powers[:3])
    r0, r1 = np.einsum("nk,nk,pnk->pn", weight, values, powers[:2])
    return (m2 * r0 - m1 * r1) / (m0 * m2 - m1 * m1 + 1e-300)
