"""What the writers of all formats are given: the traces of some runs and the figures that hold for all of them."""

from collections.abc import Mapping
from dataclasses import dataclass

from residual_mpc.export.recording.trace import Trace


@dataclass(frozen=True, eq=False)
class Recording:
    """horizon: s, length of a window; noise_floor: the gap of a perfect model, unitless; model: name of the file that
    the corrected predictions are from."""

    robot: str
    model: str
    horizon: float
    noise_floor: float
    traces: tuple[Trace, ...]

    def notes(self, trace: Trace) -> Mapping[str, str]:
        """What a file says of itself."""
        return {
            "robot": self.robot, "run": trace.run, "model": self.model, "horizon": f"{self.horizon:g} s",
            "noise_floor": f"{self.noise_floor:.6g}",
        }  # fmt: skip
