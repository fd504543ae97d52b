"""How much of the motion the nominal model misses, and a diagnosed or learned one beside it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from residual_mpc.api.display import brief, page
from residual_mpc.api.gap_figures import gap_figures
from residual_mpc.api.given import check_given, check_seconds
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.runs import Runs
from residual_mpc.api.written import Source, written
from residual_mpc.files import write_json
from residual_mpc.models.model_file import model_content
from residual_mpc.models.nominal_numbers import warn_of_differences
from residual_mpc.report import gap_lines

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Gap:
    """document: what `gap --json` prints (contract, sections 3 and 4)."""

    document: dict[str, Any]

    @property
    def nominal(self) -> float:
        """The nominal model's gap at the headline horizon, 1 for a model that stands still."""
        return float(self.document["nominal"])

    @property
    def model(self) -> float | None:
        """Likewise of the other model, None where none was given."""
        value = self.document["model"]
        return None if value is None else float(value)

    @property
    def noise_floor(self) -> float:
        """What a perfect model would have."""
        return float(self.document["noise_floor"])

    def to_frame(self) -> "DataFrame":
        """One row a horizon (s) and channel; the channel is empty for the gap of all of them."""
        import pandas as pd

        rows = []
        for at in self.document["horizons"]:
            named = {"": at, **at["channels"]}
            rows += [
                {"horizon": at["horizon"], "channel": c, **{k: g[k] for k in ("nominal", "model", "noise_floor")}}
                for c, g in named.items()
            ]
        return pd.DataFrame(rows)

    def save(self, file: str | Path) -> Path:
        """Write what `gap --json` prints to a JSON file."""
        write_json(Path(file), self.document)
        return Path(file)

    def lines(self) -> list[str]:
        """The gap in words."""
        return gap_lines(self.document)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def measure_gap(
    robot: NominalRobot,
    runs: Runs,
    *,
    model: Source | None = None,
    held_out_of: Source | None = None,
    horizon: float = 1.0,
    seed: int = 0,
) -> Gap:
    """The gap of the nominal model on these runs.

    Args:
        model: a diagnosis or a learned model, or its file, to measure beside the nominal one.
        held_out_of: a diagnosis, or its file; then only the runs or blocks that it held out are measured.
        horizon: length of a window, s.

    Raises:
        BadInput: runs that cannot be used, a model of another robot, or held-out runs that are not there.
    """
    check_given(robot, runs)
    check_seconds(horizon, "horizon")
    other = None if model is None else written(model)
    if other is not None:
        warn_of_differences(model_content(other), robot.model, other.where)
    held_out = None if held_out_of is None else written(held_out_of)
    return Gap(gap_figures(runs.runs, runs.models, robot.file, horizon, other, held_out, seed))
