"""What a step of an arm costs compiled, beside MuJoCo's own batch: `python -m benchmarks.compiled ROBOT.toml ...`.

One core, in turns, medians of process time; the compiled rows are packed and unpacked within it. Then what it takes to
compile the program, without and with optimisation.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import click
import numpy as np

WARM = 5.0  # s, long after a program is optimised


@click.command()
@click.argument("robots", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path, dir_okay=False))
@click.option("--rows", type=click.IntRange(min=1), default=256, show_default=True)
@click.option("--steps", type=click.IntRange(min=1), default=600, show_default=True)
@click.option("--turns", type=click.IntRange(min=1), default=15, show_default=True, help="Medians are over these.")
def compiled(robots: tuple[Path, ...], rows: int, steps: int, turns: int) -> None:
    """Print a line for each robot file."""
    import residual_mpc as rm

    click.echo("| robot | joints | MuJoCo, us a step | compiled | ratio | text, code, optimised code, s |")
    click.echo("| --- | --- | --- | --- | --- | --- |")
    for path in robots:
        click.echo(_line(rm.load_robot(path).model, path.parent.name, rows, steps, turns))


def _line(robot: Any, name: str, rows: int, steps: int, turns: int) -> str:
    import mujoco
    from mujoco.batch import Batch

    from plants.mujoco_robot.native.arms import native_arm

    native = native_arm(robot)
    if native is None:
        return f"| {name} | no program | | | | |"
    model, rng = robot.model, np.random.default_rng(0)
    batch = Batch(model, rows, nthread=1)
    batch.reset()
    q = model.qpos0 + 0.3 * rng.normal(size=(rows, model.nq))
    t = model.opt.timestep * np.arange(steps)[:, None]
    u = np.ascontiguousarray(0.5 * np.sin(2.0 * np.pi * t + rng.uniform(0.0, 6.0, (rows, 1, model.nu))))

    def by_mujoco() -> None:
        batch.rollout(steps, u, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos", "qvel"))

    def natively() -> None:
        native.rollout(batch, u, (0,), 1, lambda k: None)

    def spent(work: Callable[[], None]) -> float:
        batch.bind("qpos")[:], batch.bind("qvel")[:] = q, 0.0
        begin = process_time()
        work()
        return process_time() - begin

    warm = 0.0
    while warm < WARM:
        warm += spent(natively)
    times = [(spent(by_mujoco), spent(natively)) for _ in range(turns)]
    own, ours = (1e6 * median(s) / (rows * steps) for s in zip(*times, strict=True))
    made = ", ".join(f"{s:.3f}" for s in _made(model))
    return f"| {name} | {model.nv} | {own:.3f} | {ours:.3f} | {own / ours:.0f} | {made} |"


def _made(model: Any) -> tuple[float, float, float]:
    """s: the text of the model's program, its translation, and that with optimisation."""
    from plants.mujoco_robot.native.arm import chain_of
    from plants.mujoco_robot.native.compiled import NAME, engine_of, text_of

    times = [process_time()]
    text = text_of(chain_of(model, bool((model.dof_frictionloss > 0.0).any()), bool(model.jnt_limited.any())))
    times.append(process_time())
    for level in (0, 1):
        engine_of(text, level, NAME)
        times.append(process_time())
    first, second, third = (b - a for a, b in zip(times, times[1:], strict=False))
    return first, second, third


if __name__ == "__main__":
    compiled()
