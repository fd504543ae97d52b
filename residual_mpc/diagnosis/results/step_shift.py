"""What the model's own time step does to the numbers that are fitted with it."""

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem, part_of, whitened
from residual_mpc.diagnosis.predict.step_error import WINDOWS, finer_prediction
from residual_mpc.models import optional
from residual_mpc.models.settings import Knob


def finely_stepped(problem: Problem, fit: Fit) -> dict[Knob, float]:
    """The fit's numbers as the same fit would have them with an infinitely small time step, to first order: one
    Gauss-Newton step on what the step changes of the prediction, on some of the windows. A model with an integrator of
    order 1 is late or early by half a step, which a fitted delay takes up. Empty where no model has another step."""
    data, free = problem.data, np.flatnonzero(~fit.held)
    if not len(free) or any(optional.with_half_step(block.robot) is None for block in data.blocks):
        return {}
    keep = np.isin(np.arange(data.count), np.linspace(0, data.count - 1, min(data.count, WINDOWS)).astype(int))
    few = problem if keep.all() else part_of(problem, keep)
    apart = finer_prediction(few.data, few.space.settings([fit.values]))
    assert apart is not None
    seen = np.isfinite(few.data.y) & np.isfinite(apart)
    column = np.where(seen, np.clip(np.nan_to_num(apart), -1e6, 1e6), 0.0).reshape(len(apart), -1, 1)
    jacobian = fit.jacobian[keep].reshape(-1, len(fit.knobs))[:, free]
    change = np.linalg.lstsq(jacobian, whitened(few, column)[:, 0], rcond=1e-9)[0]
    return {
        fit.knobs[i]: float(fit.values[fit.knobs[i]] + fit.scales[i] * x) for i, x in zip(free, change, strict=True)
    }
