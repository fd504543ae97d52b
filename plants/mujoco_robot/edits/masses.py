"""Rigid-body bookkeeping: a body's mass, centre and inertia after mass is added or its centre moved; batched."""

import numpy as np


def quat_to_matrix(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) from unit quaternions (..., 4), w first."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)


def parallel_axis(mass: np.ndarray, r: np.ndarray) -> np.ndarray:
    """mass (|r|^2 I - r r'), kg m^2, (n, 3, 3), for masses (n,) at r (n, 3) from the reference point."""
    eye = np.eye(3)
    square = np.einsum("ni,ni->n", r, r)
    return mass[:, None, None] * (square[:, None, None] * eye - r[:, :, None] * r[:, None, :])


def add_point_mass(
    mass: np.ndarray, com: np.ndarray, inertia: np.ndarray, added: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass (n,) kg, centre (n, 3) m and inertia about it (n, 3, 3) kg m^2 after a point mass is added at `at` (n,
    3).
    """
    total = mass + added
    centre = (mass[:, None] * com + added[:, None] * at) / total[:, None]
    about = inertia + parallel_axis(mass, com - centre) + parallel_axis(added, at - centre)
    return total, centre, about


def principal(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments (n, 3) kg m^2 and the axes' quaternions (n, 4), w first."""
    from scipy.spatial.transform import Rotation

    moments, axes = np.linalg.eigh(inertia)
    axes = axes * np.where(np.linalg.det(axes) < 0, -1.0, 1.0)[:, None, None]
    return np.maximum(moments, 1e-9), Rotation.from_matrix(axes).as_quat(scalar_first=True)
