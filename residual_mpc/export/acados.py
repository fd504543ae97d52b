"""The expressions that acados wants; acados itself is not needed for it."""

from typing import Any

from residual_mpc.export.casadi_model import CasadiModel


def fill_acados(target: Any, model: CasadiModel, name: str = "augmented") -> Any:
    """Fill an `acados_template.AcadosModel`: name, x, u, p and the discrete dynamics; returns it.

    In the options: `integrator_type = "DISCRETE"`; in the problem: `parameter_values = model.p0`.
    """
    target.name = name
    target.x, target.u, target.p = model.x, model.u, model.p
    target.disc_dyn_expr = model.step
    return target
