"""The augmented model (nominal, effects, network) handed on: as a CasADi function, C, JAX, ONNX, MJCF."""

from residual_mpc.export.augmented import Augmented, Build, augment, read_augmented
from residual_mpc.export.casadi_model import CasadiModel, casadi_model

__all__ = ["Augmented", "Build", "CasadiModel", "augment", "casadi_model", "read_augmented"]
