"""The first-order recursion y_k = a y_(k-1) + x_k over many sequences at once.

scipy.signal.lfilter does the same, but loading scipy.signal takes longer than many a diagnosis spends in it.
"""

import numpy as np


def first_order(a: float, x: np.ndarray, before: np.ndarray) -> np.ndarray:
    """(..., K) y of x (..., K), from y before the first sample (...): forward substitution in a bidiagonal system
    (LAPACK dtbtrs; Anderson et al., LAPACK Users' Guide, 1999, section 2.4.1)."""
    from scipy.linalg.lapack import dtbtrs

    count = x.shape[-1]
    if not x.size:
        return np.zeros(x.shape)
    right = np.array(x, dtype=float, order="C").reshape(-1, count)
    right[:, 0] += a * np.broadcast_to(before, x.shape[:-1]).ravel()
    if count == 1:
        return right.reshape(x.shape)
    band = np.empty((2, count))
    band[0], band[1] = 1.0, -a
    y, info = dtbtrs(band, right.T, uplo="L", diag="U", overwrite_b=1)
    if info != 0:
        raise ArithmeticError(f"first_order: dtbtrs returned {info}")
    return np.ascontiguousarray(np.asarray(y).T).reshape(x.shape)
