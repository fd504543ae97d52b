"""The paper's filter written down line by line, in loops: slow, and nothing shared with the code that it checks."""

import numpy as np


def network(y: np.ndarray, z: np.ndarray, nodes: int, outputs: int) -> np.ndarray:
    """Equation nn for two hidden layers of `nodes`: y flat, z (inputs,)."""
    cut, at = [], 0
    for a, b in ((len(z), nodes), (nodes, nodes), (nodes, outputs)):
        cut.append((y[at : at + a * b].reshape(b, a), y[at + a * b : at + a * b + b]))
        at += a * b + b
    (w_in, b_in), (w_lay, b_lay), (w_out, b_out) = cut
    first = [max(0.01 * v, v) for v in w_in @ z + b_in]
    second = [max(0.01 * v, v) for v in w_lay @ np.array(first) + b_lay]
    return w_out @ np.array(second) + b_out


def update(y, p, predict, x_ref, c_theta, c_v, reach, w_a0, w_ai, w_c0, w_ci):
    """Equations UKF a to h and learning_law: (y_t, P_t|t). predict: weights (L,) -> stacked x_pred (m,)."""
    size = len(y)
    p_pred = c_theta + p  # f, whose sum over sigma points of the identity is P
    a = np.linalg.cholesky(p_pred)
    points = [y] + [y + reach * a[:, i] for i in range(size)] + [y - reach * a[:, i] for i in range(size)]
    w_a = [w_a0] + 2 * size * [w_ai]
    w_c = [w_c0] + 2 * size * [w_ci]
    y_hat = sum(w * point for w, point in zip(w_a, points, strict=True))  # g
    x = [predict(point) for point in points]  # e
    x_hat = sum(w * xi for w, xi in zip(w_a, x, strict=True))  # d
    c_sz = np.zeros((size, len(x_ref)))
    s = c_v.copy()
    for w, point, xi in zip(w_c, points, x, strict=True):
        c_sz += w * np.outer(point - y_hat, xi - x_hat)  # c
        s += w * np.outer(xi - x_hat, xi - x_hat)  # b
    k = c_sz @ np.linalg.inv(s)  # a
    return y + k @ (x_ref - x_hat), p_pred - k @ s @ k.T  # learning_law, h
