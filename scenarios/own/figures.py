"""Files of a closed-loop run of a user's own robot: the episodes as runs, a figure and an animation."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plants.mujoco_robot.simulation.plant import joint_points
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.symbolic.rigid_joints import rigid_joints
from residual_mpc.closed_loop.compare import Comparison
from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.metrics import h2_over_time, path_error
from residual_mpc.files import write_atomically
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.report.figures.controllers import line_of
from scenarios.closed_loop.page import write_page
from scenarios.closed_loop.results import write_episodes
from scenarios.own.units import unit_of

FRAME, RATE = 0.1, 20  # s of motion per frame, frames per second: at twice the real speed
MOST_FRAMES = 600  # longer runs are shown faster, since each frame takes tens of ms to draw


def write(out: Path, robot: Robot, comparison: Comparison, result: dict[str, Any]) -> list[str]:
    """Fill the folder; returns the names of the files."""
    names = write_episodes(out, comparison)
    write_atomically(out / "result.json", json.dumps(result, indent=2))
    sliding = optional.sliding(robot)
    units = [unit_of((name,), sliding) for name in _first(comparison).poses]
    _picture(out / "tracking.png", comparison, result["unit"], units)
    names += ["result.json", "tracking.png", *write_page(out, robot, comparison, result)]
    seen = {j for j in optional.joints(robot) if f"position.{j}" in _first(comparison).measured}
    if isinstance(robot, CompiledRobot) and seen and set(robot.joints) - seen <= set(rigid_joints(robot)):
        _animation(out / "drive.gif", robot, comparison)
        names.append("drive.gif")
    return names


def _first(comparison: Comparison) -> Episode:
    return next(iter(comparison.episodes.values()))[0]


def _picture(path: Path, comparison: Comparison, unit: str, units: Sequence[str]) -> None:
    from matplotlib.figure import Figure

    first = _first(comparison)
    count = len(first.poses)
    figure = Figure(figsize=(10, 2.2 + 1.1 * count), layout="constrained")
    grid = figure.add_gridspec(count, 2)
    traces = [figure.add_subplot(grid[i, 0]) for i in range(count)]
    half = max(1, count // 2)
    error, norm = figure.add_subplot(grid[:half, 1]), figure.add_subplot(grid[half:, 1] if count > 1 else grid[0, 1])
    for i, axes in enumerate(traces):
        axes.plot(first.t, first.reference[:, i], color="black", lw=0.8, ls="--", label="reference")
        axes.set_ylabel(f"{first.poses[i].partition('.')[2]} ({units[i]})", fontsize=7)
        axes.tick_params(labelsize=7, labelbottom=i == count - 1)
    for name, episodes in comparison.episodes.items():
        style = line_of(name).style()
        for i, axes in enumerate(traces):
            axes.plot(episodes[0].t, episodes[0].truth[:, i], label=name, **style)
        off = np.mean([path_error(e) for e in episodes], axis=0)
        error.plot(episodes[0].t, 1e3 * off, label=name, **style)
        t, _ = h2_over_time(episodes[0])
        norm.plot(t, np.mean([h2_over_time(e)[1] for e in episodes], axis=0), **style)
    traces[-1].set_xlabel("t (s)")
    error.set(ylabel=f"error (m{unit})", title="tracking, mean over seeds")
    error.legend(fontsize=7)
    norm.set(xlabel="t (s)", ylabel=f"H2 norm ({unit}/s)", title="prediction, mean over 10 s")
    for axes in (error, norm):
        axes.set_ylim(bottom=0)
    figure.savefig(path, dpi=110)


def _animation(path: Path, robot: CompiledRobot, comparison: Comparison) -> None:
    """The first seed's arms, from joint to joint, seen from the side."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    episodes = {name: es[0] for name, es in comparison.episodes.items()}
    first = _first(comparison)
    stride = max(1, round(FRAME / float(first.t[1] - first.t[0])), -(-len(first.t) // MOST_FRAMES))
    shapes = {name: joint_points(robot, e.measured, stride)[:, :, [0, 2]] for name, e in episodes.items()}
    points = np.concatenate([s.reshape(-1, 2) for s in shapes.values()])
    low, high = points.min(axis=0) - 0.05, points.max(axis=0) + 0.05
    figure = Figure(figsize=(4.6, 4.6))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="z (m)")
    lines = {
        n: axes.plot([], [], "o-", ms=3, lw=1.5, color=line_of(n).colour_code, label=n, alpha=0.8)[0] for n in shapes
    }
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(lines), frameon=False)

    def draw(frame: int) -> list[Any]:
        for name, line in lines.items():
            line.set_data(shapes[name][frame, :, 0], shapes[name][frame, :, 1])
        return list(lines.values())

    frames = len(next(iter(shapes.values())))
    FuncAnimation(figure, draw, frames=frames, blit=False).save(str(path), writer=PillowWriter(fps=RATE), dpi=80)
