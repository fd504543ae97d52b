"""MuJoCo's soft constraints in numbers: impedance and reference acceleration, from solimp and solref."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco

MINIMUM = 1e-15  # MuJoCo's mjMINVAL
IMPEDANCE = (1e-4, 0.9999)  # between which MuJoCo clips impedances


def clipped(solimp: np.ndarray) -> np.ndarray:
    """(..., 5) the parameters of an impedance, within what MuJoCo takes."""
    out = np.array(solimp, dtype=float)
    out[..., :2] = np.clip(out[..., :2], *IMPEDANCE)
    out[..., 3] = np.clip(out[..., 3], *IMPEDANCE)
    out[..., 2], out[..., 4] = np.maximum(out[..., 2], 0.0), np.maximum(out[..., 4], 1.0)
    return out


def reference(model: mujoco.MjModel, solref: np.ndarray, high: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of the reference acceleration, from MuJoCo's time constant and damping ratio, or from the
    two themselves where they are negative; high: the impedance's upper end."""
    import mujoco

    one, two = np.asarray(solref[..., 0]), np.asarray(solref[..., 1])
    safe = not int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE)
    constant = np.maximum(one, 2.0 * model.opt.timestep) if safe else one
    with np.errstate(divide="ignore", invalid="ignore"):
        stiff = np.where(
            one > 0.0, 1.0 / np.maximum(MINIMUM, (high * constant * two) ** 2), -one / np.maximum(MINIMUM, high**2)
        )
        damp = np.where(one > 0.0, 2.0 / np.maximum(MINIMUM, high * constant), -two / np.maximum(MINIMUM, high))
    return stiff, damp


def dry_friction(
    model: mujoco.MjModel, solimp: np.ndarray, solref: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """1/R of dry friction and B of its reference acceleration."""
    solimp = clipped(solimp)
    low, high, width = solimp[..., 0], solimp[..., 1], solimp[..., 2]
    imp = np.where((low == high) | (width <= MINIMUM), 0.5 * (low + high), low)
    _, damp = reference(model, solref, high)
    return 1.0 / np.maximum(MINIMUM, (1.0 - imp) * weight / imp), damp
