"""What a scenario leaves behind: episodes as runs, the diagnosis, a picture and an animation."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.closed_loop.compare import Comparison
from residual_mpc.closed_loop.metrics import h2_over_time, path_error
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.files import write_atomically
from residual_mpc.models.protocol import Robot
from residual_mpc.report.figures.controllers import line_of
from scenarios.closed_loop.page import write_page
from scenarios.closed_loop.task import ClosedLoopTask
from scenarios.closed_loop.training_runs import TrainingOutcome


def write_episodes(out: Path, comparison: Comparison) -> list[str]:
    """Write every episode as a run into the folder, which is made; returns the names of the files."""
    out.mkdir(parents=True, exist_ok=True)
    names = []
    for episodes in comparison.episodes.values():
        for e in episodes:
            names.append(f"{e.name}.csv")
            e.table().to_csv(out / names[-1], index=False, lineterminator="\n")
    return names


def write(
    out: Path, task: ClosedLoopTask, robot: Robot, comparison: Comparison, learned: TrainingOutcome,
    result: dict[str, Any],
) -> list[str]:  # fmt: skip
    """Fill the folder; returns the names of the files."""
    names = write_episodes(out, comparison)
    write_atomically(out / "diagnosis.json", json.dumps(to_document(learned.made.diagnosis), indent=2))
    write_atomically(out / "result.json", json.dumps(result, indent=2))
    _picture(out / "tracking.png", task, comparison)
    _animation(out / "drive.gif", task, comparison)
    pages = write_page(out, robot, comparison, result)
    return [*names, "diagnosis.json", "result.json", "tracking.png", "drive.gif", *pages]


def _animation(path: Path, task: ClosedLoopTask, comparison: Comparison) -> None:
    """The first seed's robots side by side on the wanted path, four times as fast as it was."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = {n: es[0] for n, es in comparison.episodes.items() if n in ("nominal", "effects", "oracle")}
    first = next(iter(shown.values()))
    figure = Figure(figsize=(5.2, 4.2))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(first.reference[:, 0], first.reference[:, 1], color="black", lw=0.8, ls="--")
    everything = np.concatenate([e.truth[:, :2] for e in shown.values()] + [first.reference[:, :2]])
    room = 0.1 * np.ptp(everything)
    low, high = everything.min(axis=0) - room, everything.max(axis=0) + room
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, m", ylabel="y, m")
    drives = "pose.theta" in first.poses
    tails = {n: axes.plot([], [], label=n, **line_of(n).style())[0] for n in shown}
    noses = {n: axes.plot([], [], color=line_of(n).colour_code, lw=4.0, solid_capstyle="round")[0] for n in shown}
    (wanted,) = axes.plot([], [], "x", color="black", ms=8)
    axes.legend(fontsize=8, loc="upper right")
    per_frame = max(1, round(0.2 / task.dt))

    def draw(frame: int) -> list[Any]:
        k = min(frame * per_frame, len(first.t) - 1)
        for n, e in shown.items():
            since = max(0, k - round(3.0 / task.dt))
            x, y, theta = e.truth[k, :3]
            tails[n].set_data(e.truth[since : k + 1, 0], e.truth[since : k + 1, 1])
            nose = 0.06 if drives else 0.0  # a tool is a dot
            noses[n].set_data([x, x + nose * np.cos(theta)], [y, y + nose * np.sin(theta)])
        wanted.set_data(first.reference[k : k + 1, 0], first.reference[k : k + 1, 1])
        return [*tails.values(), *noses.values(), wanted]

    moving = FuncAnimation(figure, draw, frames=len(first.t) // per_frame + 1, blit=False)
    moving.save(str(path), writer=PillowWriter(fps=20), dpi=80)


def _picture(path: Path, task: ClosedLoopTask, comparison: Comparison) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    plane, error, norm = figure.subplots(1, 3, width_ratios=[1.2, 1, 1])
    first = next(iter(comparison.episodes.values()))[0]
    plane.plot(first.reference[:, 0], first.reference[:, 1], color="black", lw=0.8, ls="--", label="wanted")
    for name, episodes in comparison.episodes.items():
        e, style = episodes[0], line_of(name).style()
        plane.plot(e.truth[:, 0], e.truth[:, 1], label=name, **style)
        error.plot(e.t, 1e3 * np.mean([path_error(x) for x in episodes], axis=0), **style)
        t, _ = h2_over_time(e)
        norm.plot(t, np.mean([h2_over_time(x)[1] for x in episodes], axis=0), **style)
    plane.set(aspect="equal", xlabel="x, m", ylabel="y, m", title=f"{task.name}, first seed")
    plane.legend(fontsize=7)
    error.set(xlabel="t, s", ylabel="distance from the reference (mm)", title="tracking, mean over seeds")
    norm.set(xlabel="t, s", ylabel="H2 norm of the prediction", title="model, mean over 10 s")
    for axes in (error, norm):
        axes.set_ylim(bottom=0)
    figure.savefig(path, dpi=110)
