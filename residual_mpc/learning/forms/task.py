"""A residual on the velocity of an arm's tool: the paper's equation fk_prop.

v_t = (FK(theta + rate dt) - FK(theta)) / dt + delta(rate), six joint rates in, three velocities out. No channel of a
run log is a tool's velocity, so that such a residual is learned from a stream of velocities
(`learning.stream.updates`), and is no form that `gap` could replay.
"""

from collections.abc import Sequence

FORM = "task"
TASK = ("task.x", "task.y", "task.z")  # m/s, in the mount's frame


def task_names(motors: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(inputs, outputs): the motors' rates, rad/s, and the tool's velocity, m/s."""
    return tuple(f"velocity.{m}" for m in motors), TASK
