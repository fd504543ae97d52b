"""Builds a controller from an augmented model in one call; the entry points behind its methods `mpc` and `lqr`."""

from dataclasses import replace

import numpy as np

from controllers.lqr import Lqr, build_lqr
from controllers.mpc import Mpc, build_mpc
from controllers.settings import MpcSettings
from controllers.usual import usual_settings
from residual_mpc.export.augmented import Augmented


def mpc(model: Augmented, horizon: int, settings: MpcSettings | None = None) -> Mpc:
    """An MPC over so many steps; without settings, those of `usual_settings`."""
    return build_mpc(model, replace(settings or usual_settings(model), horizon=horizon))


def lqr(model: Augmented, path: np.ndarray, settings: MpcSettings | None = None) -> Lqr:
    """An LQR along a path (n, ny), whose last row is held; without settings, those of `usual_settings`."""
    chosen = settings or usual_settings(model)
    held = np.concatenate([path, np.repeat(path[-1:], chosen.horizon, axis=0)])
    return build_lqr(model, held, chosen)
