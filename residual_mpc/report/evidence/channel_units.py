"""The units of measured channels."""

from collections.abc import Collection

from residual_mpc.models.sliding_units import sliding_unit

IN_THE_PLANE = {
    "pose.theta": "rad", "pose.x": "m", "pose.y": "m", "twist.theta": "rad/s", "twist.x": "m/s", "twist.y": "m/s",
}  # fmt: skip


def channel_unit(channel: str, sliding: Collection[str]) -> str:
    """The unit of a channel such as "position.elbow". sliding: the joints that slide."""
    kind, _, joint = channel.partition(".")
    unit = IN_THE_PLANE.get(channel, "rad/s" if kind == "velocity" else "rad")
    return sliding_unit(unit) if joint in sliding else unit
