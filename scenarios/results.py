"""What a scenario leaves behind: episodes as runs, the diagnosis, a picture and an animation."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.cli.common import write_atomically
from residual_mpc.closed_loop.compare import Comparison
from residual_mpc.closed_loop.metrics import h2_over_time, path_error
from residual_mpc.diagnosis.document import to_document
from scenarios.practice import Learned
from scenarios.scenario import DriveScenario

COLOURS = {
    "nominal": "#c0392b",
    "effects": "#2471a3",
    "network": "#b9770e",
    "augmented": "#1e8449",
    "online": "#7d3c98",
    "oracle": "#7f8c8d",
}


def write(
    out: Path, scenario: DriveScenario, comparison: Comparison, learned: Learned, result: dict[str, Any]
) -> list[str]:
    """Fill the folder; returns the names of the files."""
    from residual_mpc.report.figures import traces  # noqa: F401  the house's matplotlib settings

    out.mkdir(parents=True, exist_ok=True)
    names = []
    for episodes in comparison.episodes.values():
        for e in episodes:
            names.append(f"{e.name}.csv")
            e.table().to_csv(out / names[-1], index=False, lineterminator="\n")
    write_atomically(out / "diagnosis.json", json.dumps(to_document(learned.made.diagnosis), indent=2))
    write_atomically(out / "result.json", json.dumps(result, indent=2))
    _picture(out / "tracking.png", scenario, comparison)
    return [*names, "diagnosis.json", "result.json", "tracking.png"]


def _picture(path: Path, scenario: DriveScenario, comparison: Comparison) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    plane, error, norm = figure.subplots(1, 3, width_ratios=[1.2, 1, 1])
    first = next(iter(comparison.episodes.values()))[0]
    plane.plot(first.reference[:, 0], first.reference[:, 1], color="black", lw=0.8, ls="--", label="wanted")
    for name, episodes in comparison.episodes.items():
        e, colour = episodes[0], COLOURS.get(name)
        plane.plot(e.truth[:, 0], e.truth[:, 1], color=colour, lw=1.2, label=name)
        error.plot(e.t, 1e3 * np.mean([path_error(x) for x in episodes], axis=0), color=colour, lw=1.0)
        t, _ = h2_over_time(e)
        norm.plot(t, np.mean([h2_over_time(x)[1] for x in episodes], axis=0), color=colour, lw=1.0)
    plane.set(aspect="equal", xlabel="x, m", ylabel="y, m", title=f"{scenario.name}: seed of the first episode")
    plane.legend(fontsize=7)
    error.set(xlabel="t, s", ylabel="distance from the path, mm", title="tracking, mean over seeds")
    norm.set(xlabel="t, s", ylabel="H2 norm of the prediction", title="model, mean over 10 s and seeds")
    for axes in (error, norm):
        axes.set_ylim(bottom=0)
    figure.savefig(path, dpi=110)
