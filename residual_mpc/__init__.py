"""Diagnoses the gap between a robot's model and its logged runs: why they disagree, and a model that disagrees less.

    import residual_mpc as rm

    robot = rm.load_robot("robot.toml")
    runs = rm.read_runs(robot, "runs/")
    diagnosis = rm.diagnose(robot, runs)
    model = rm.augment(robot, diagnosis, dt=0.05)

Everything is imported on first use, so that `import residual_mpc` answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from residual_mpc.api.check import Check as Check
    from residual_mpc.api.check import check as check
    from residual_mpc.api.comparison import Comparison as Comparison
    from residual_mpc.api.comparison import compare as compare
    from residual_mpc.api.confirmation import Confirmation as Confirmation
    from residual_mpc.api.confirmation import confirm as confirm
    from residual_mpc.api.diagnosis import Diagnosis as Diagnosis
    from residual_mpc.api.diagnosis import diagnose as diagnose
    from residual_mpc.api.excitation import Excitation as Excitation
    from residual_mpc.api.excitation import excite as excite
    from residual_mpc.api.gap import Gap as Gap
    from residual_mpc.api.gap import measure_gap as measure_gap
    from residual_mpc.api.learning import LearnedModel as LearnedModel
    from residual_mpc.api.learning import learn as learn
    from residual_mpc.api.model import AugmentedModel as AugmentedModel
    from residual_mpc.api.model import augment as augment
    from residual_mpc.api.recording import export_runs as export_runs
    from residual_mpc.api.robot import NominalRobot as NominalRobot
    from residual_mpc.api.robot import load_robot as load_robot
    from residual_mpc.api.runs import Runs as Runs
    from residual_mpc.api.runs import read_runs as read_runs
    from residual_mpc.api.watch import watch as watch
    from residual_mpc.errors import BadInput as BadInput

    __version__: str

_PLACES = {
    "AugmentedModel": "residual_mpc.api.model",
    "BadInput": "residual_mpc.errors",
    "Check": "residual_mpc.api.check",
    "Comparison": "residual_mpc.api.comparison",
    "Confirmation": "residual_mpc.api.confirmation",
    "Diagnosis": "residual_mpc.api.diagnosis",
    "Excitation": "residual_mpc.api.excitation",
    "Gap": "residual_mpc.api.gap",
    "LearnedModel": "residual_mpc.api.learning",
    "NominalRobot": "residual_mpc.api.robot",
    "Runs": "residual_mpc.api.runs",
    "augment": "residual_mpc.api.model",
    "check": "residual_mpc.api.check",
    "compare": "residual_mpc.api.comparison",
    "confirm": "residual_mpc.api.confirmation",
    "diagnose": "residual_mpc.api.diagnosis",
    "excite": "residual_mpc.api.excitation",
    "export_runs": "residual_mpc.api.recording",
    "learn": "residual_mpc.api.learning",
    "load_robot": "residual_mpc.api.robot",
    "measure_gap": "residual_mpc.api.gap",
    "read_runs": "residual_mpc.api.runs",
    "watch": "residual_mpc.api.watch",
}

__all__ = [
    "AugmentedModel",
    "BadInput",
    "Check",
    "Comparison",
    "Confirmation",
    "Diagnosis",
    "Excitation",
    "Gap",
    "LearnedModel",
    "NominalRobot",
    "Runs",
    "__version__",
    "augment",
    "check",
    "compare",
    "confirm",
    "diagnose",
    "excite",
    "export_runs",
    "learn",
    "load_robot",
    "measure_gap",
    "read_runs",
    "watch",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("residual-mpc")
    except PackageNotFoundError:  # a source tree that was never installed
        return "0"
