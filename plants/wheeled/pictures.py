"""Pictures of the wheeled robot's motions, in the colours of the paper's figure of its results.

    python -m plants.wheeled.pictures docs/reference/images

Orange is what the camera reports of the twin, dark blue what the paper's equation says of the same commands, light blue
the paper's H2 norm of their difference: before anything is learned.
"""

import sys
from pathlib import Path

import numpy as np

from plants.simulator import Recording, record
from plants.wheeled.motions import MOTIONS, Reference, policy
from plants.wheeled.simulators import TURTLEBOT, bullet_drive
from plants.wheeled.twin import FRAME, camera, draw_withheld, encoders, twin

SECONDS = 32.0
TWIN = 1  # its seed
MARGIN = 0.1  # m, shown around the reference and the path
SPIKES = 0.2  # 1/s, as in the paper's noisiest case
ORANGE, DARK, LIGHT, GREY = "#e08214", "#08306b", "#6baed6", "#888888"
COMPONENTS = (("twist.x", "x velocity (m/s)"), ("twist.y", "y velocity (m/s)"), ("twist.theta", "yaw rate (rad/s)"))


def predicted(command: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(n, 3) world velocities by the paper's wheel_prop at wheel speeds (n, 2) rad/s and headings (n,) rad."""
    rims = TURTLEBOT.left.radius * command
    forward = rims.mean(axis=1)
    return np.stack(
        [forward * np.cos(theta), forward * np.sin(theta), (rims[:, 1] - rims[:, 0]) / TURTLEBOT.track], axis=1
    )


def draw(motion: Reference, seed: int, path: Path) -> None:
    """The path from above, the three velocities and the H2 norm over time; a PNG."""
    from matplotlib.figure import Figure

    robot = twin(bullet_drive(), draw_withheld(np.random.default_rng(TWIN)), (camera(SPIKES), encoders()))
    run = record(robot, policy(motion, TURTLEBOT, FRAME), Recording(SECONDS, FRAME, {}), np.random.default_rng(seed))
    t = run["t"].to_numpy()
    seen = run[[c for c, _ in COMPONENTS]].to_numpy()
    model = predicted(run[["command.left", "command.right"]].to_numpy(), run["pose.theta"].ffill().to_numpy())
    wanted = motion.path(np.linspace(0.0, SECONDS, 1500))
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.5))
    above = figure.add_subplot(grid[:, 0])
    above.plot(wanted[:, 0], wanted[:, 1], color=GREY, lw=3.0, alpha=0.6, label="reference")
    above.plot(run["pose.x"], run["pose.y"], ".", color=ORANGE, ms=2.5, label="twin, by its camera")
    above.set(xlabel="x (m)", ylabel="y (m)", title=motion.name.replace("_", " "))
    shown = np.nanpercentile(run[["pose.x", "pose.y"]].to_numpy(), (2.0, 98.0), axis=0)  # spikes go beyond
    low, high = np.minimum(shown[0], wanted[:, :2].min(axis=0)), np.maximum(shown[1], wanted[:, :2].max(axis=0))
    middle, reach = 0.5 * (low + high), 0.5 * float((high - low).max()) + MARGIN
    above.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach), aspect="equal")
    above.legend(loc="upper right", fontsize=9)
    axes = [figure.add_subplot(grid[k, 1]) for k in range(4)]
    for k, (_, label) in enumerate(COMPONENTS):
        axes[k].plot(t, seen[:, k], color=ORANGE, lw=0.9)
        axes[k].plot(t, model[:, k], color=DARK, lw=1.2)
        axes[k].set_ylabel(label.replace(" (", "\n("), fontsize=9)
        axes[k].tick_params(labelbottom=False)
        most = 1.4 * max(float(np.abs(model[:, k]).max()), 0.1)
        axes[k].set_ylim(-most, most)  # spikes go beyond
    axes[3].plot(t, np.linalg.norm(seen - model, axis=1), color=LIGHT, lw=0.9)
    axes[3].set(xlabel="time (s)", ylim=(0.0, 1.0))
    axes[3].set_ylabel("H2 norm", fontsize=9)
    for a in (above, *axes):
        a.tick_params(labelsize=9)
        a.grid(alpha=0.3)
    figure.savefig(path, dpi=90, metadata={"Software": None})


def main(folder: Path) -> None:
    """One picture a motion, `wheeled-<motion>.png`."""
    for seed, motion in enumerate(MOTIONS):
        draw(motion, seed, folder / f"wheeled-{motion.name.replace('_', '-')}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
