"""One loop for every pairing of plant, estimator, controller and reference, and what its episodes say."""

from residual_mpc.closed_loop.compare import Comparison, ControlStack, compare
from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import EstimatorSettings, Filter, build_filter
from residual_mpc.closed_loop.loop import LoopSettings, run_closed_loop

__all__ = [
    "Comparison",
    "ControlStack",
    "Episode",
    "EstimatorSettings",
    "Filter",
    "LoopSettings",
    "build_filter",
    "compare",
    "run_closed_loop",
]
