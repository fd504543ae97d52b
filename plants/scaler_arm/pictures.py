"""Pictures of the arm's motions, to be held against the paper's figure of the manipulator's trajectories.

python -m plants.scaler_arm.pictures docs/reference/images
"""

import sys
from pathlib import Path

import numpy as np

from plants.scaler_arm.kinematics.forward import forward_kinematics
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER
from plants.scaler_arm.kinematics.skeleton import links
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, Motion, references, tool_path

SNAPSHOTS = 4
ROUND = 16.0  # s, what is drawn of a motion


def draw(motion: Motion, path: Path) -> None:
    """Snapshots of the arm with the tool's path in red, the path from above, and tool and motors over time; a PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    t = np.arange(0.0, ROUND, 0.02)
    q = references(motion, t)
    tool, _ = forward_kinematics(q)
    wanted = tool_path(motion, t)
    figure = plt.figure(figsize=(12.0, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, SNAPSHOTS, height_ratios=(1.3, 1.0))
    for i in range(SNAPSHOTS):
        k = round((i + 1) / SNAPSHOTS * (len(t) - 1))
        axes = figure.add_subplot(grid[0, i], projection="3d")
        for line in links(SCALER, q[k]):
            axes.plot(*line.T, color="0.25", lw=2.0, marker="o", ms=3)
        axes.plot(*tool[: k + 1].T, color="tab:red", lw=1.5)
        axes.set(xlim=(-0.05, 0.3), ylim=(-0.2, 0.15), zlim=(-0.42, 0.0), title=f"t = {t[k]:.0f} s")
        axes.set_box_aspect((0.35, 0.35, 0.42))
        axes.view_init(elev=28, azim=-60)
        axes.tick_params(labelsize=6, pad=-2)
        axes.set_xticks((0.0, 0.1, 0.2, 0.3))
        axes.set_yticks((-0.1, 0.0, 0.1))
        axes.set_zticks((-0.4, -0.3, -0.2, -0.1, 0.0))
    above = figure.add_subplot(grid[1, 0])
    above.plot(1e3 * wanted[:, 0], 1e3 * wanted[:, 1], color="tab:red")
    above.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title="from above")
    above.set_xticks(range(140, 221, 40))
    over = figure.add_subplot(grid[1, 1:3])
    for axis, name in enumerate("xyz"):
        over.plot(t, 1e3 * (tool[:, axis] - wanted[:, axis].mean()), label=name)
    over.set(xlabel="t (s)", ylabel="tool, about its mean (mm)")
    over.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=8, frameon=False)
    angles = figure.add_subplot(grid[1, 3])
    for i, name in enumerate(MOTORS):
        angles.plot(t, q[:, i], label=name)
    angles.set(xlabel="t (s)", ylabel="motor (rad)")
    angles.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=7, ncols=3, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    draw(CircleWithLine(), folder / "scaler-circle-with-line.png")
    draw(CircleWithHeight(), folder / "scaler-circle-with-height.png")
