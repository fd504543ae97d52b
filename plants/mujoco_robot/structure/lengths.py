"""How far along a link its next joint sits."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Lengths:
    """The links whose length the robot's motion shows: they move, and exactly one joint comes next.

    A link that is longer by an offset holds the next joint, and all that hangs on it, that much farther along the line
    from its own joint to the next. Its own mass, centre and inertia stay as modelled: `link_mass` changes those.
    """

    model: "mujoco.MjModel"

    @cached_property
    def next(self) -> dict[int, int]:
        """Number of the body that the next joint moves, by the link's own number."""
        m = self.model
        found: dict[int, list[int]] = {}
        for b in range(1, m.nbody):
            held_by = int(m.body_weldid[m.body_parentid[b]])  # 0: by the world, where a shift moves the whole robot
            if m.body_jntnum[b] and held_by:
                found.setdefault(held_by, []).append(b)
        return {link: after[0] for link, after in found.items() if len(after) == 1}

    @cached_property
    def lines(self) -> dict[int, tuple[np.ndarray, float]]:
        """By the link's number: unit vector (3,) towards the next joint, in the frame that the next body's position is
        written in, and the distance of the joints, m."""
        import mujoco

        m, data = self.model, mujoco.MjData(self.model)
        mujoco.mj_kinematics(m, data)
        out = {}
        for link, after in self.next.items():
            own, following = int(m.body_jntadr[link]), int(m.body_jntadr[after])
            line = data.xanchor[following] - data.xanchor[own]
            length = float(np.linalg.norm(line))
            if length > 1e-6:  # two joints in one place have no line between them
                out[link] = (data.xmat[m.body_parentid[after]].reshape(3, 3).T @ line / length, length)
        return out

    @property
    def links(self) -> tuple[int, ...]:
        return tuple(self.lines)
