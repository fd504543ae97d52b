"""Windows on a grid of longer steps."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive


def shorter_steps(data: Dataset, own: Dataset) -> Iterator[Dataset]:
    """The windows with the steps that they have, then with half of them and so on, all longer than those of `own`."""
    times = max(b.own for b in data.blocks)
    yield data
    while (times := times // 2) > 1:
        halved = with_longer_steps(own, times)
        if halved is not None:
            yield halved


def with_longer_steps(data: Dataset, times: int) -> Dataset | None:
    """The windows with steps that are `times` as long; None where a robot has no other step."""
    blocks = [_longer(b, times) for b in data.blocks]
    found = tuple(b for b in blocks if b is not None)
    return replace(data, blocks=found) if len(found) == len(blocks) else None


def _longer(block: Block, times: int) -> Block | None:
    robot = optional.with_longer_step(block.robot, times)
    return None if robot is None else replace(block, robot=robot, drive=_coarser(block.drive, times), own=times)


def _coarser(drive: Drive, times: int) -> Drive:
    """The drive on steps that are `times` as long, each with the mean of what was sent in it. A window that ends within
    a step holds its last command to the step's end; a warm-up that is no multiple begins within one."""
    lead, steps = drive.lead // times, -(-drive.steps // times)
    begin, end = drive.lead - lead * times, drive.lead + steps * times

    def mean(x: np.ndarray, a: int, b: int) -> np.ndarray:
        """(B, n, nu) of x (B, N, nu) from a to b, the last held beyond its end."""
        held = x[:, np.minimum(np.arange(a, b), x.shape[1] - 1)]
        return np.asarray(held.reshape(len(x), (b - a) // times, times, -1).mean(axis=2))

    before, later, off = drive.enabled_before, drive.command_after, drive.enabled_after
    after = 0 if later is None else later.shape[1] // times * times  # an end within a step hardly shifts what follows
    return replace(
        drive,
        dt=drive.dt * times,
        lead=lead,
        command=mean(drive.command, begin, end),
        enabled=None if drive.enabled is None else mean(drive.enabled, 0, steps * times),
        enabled_before=None if before is None else mean(before, begin, drive.lead),
        command_after=None if later is None else mean(later, 0, after),
        enabled_after=None if off is None else mean(off, 0, after),
    )
