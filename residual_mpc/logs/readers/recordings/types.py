"""Decode a message into an object with its fields, by the type definition in the recording."""

from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from residual_mpc.extras import extra

Decode = Callable[[bytes], Any]

POINT = "trajectory_msgs/JointTrajectoryPoint"
MULTI = "trajectory_msgs/MultiDOFJointTrajectoryPoint"
STATE = "control_msgs/msg/JointTrajectoryControllerState"


def _controller_state(*parts: str, multi: bool = True) -> str:
    lines = ["std_msgs/Header header", "string[] joint_names", *(f"{POINT} {part}" for part in parts)]
    if multi:
        lines += ["string[] multi_dof_joint_names", *(f"{MULTI} multi_dof_{part}" for part in parts)]
    return "\n".join(lines)


# SQLite bags of ROS 2 Humble and older contain no definitions. This message is not among the common ones, and its
# fields differ between ROS versions; the first definition that fits a message is used.
NEWER, OLDER = ("reference", "feedback", "error", "output"), ("desired", "actual")
CONTROLLER_STATES = (
    _controller_state(*NEWER, *OLDER),  # Humble and Iron
    _controller_state(*NEWER),  # Jazzy and newer
    _controller_state(*OLDER, "error", multi=False),  # Foxy and Galactic
)


def plain_name(kind: str) -> str:
    """`sensor_msgs/msg/JointState` and `sensor_msgs/JointState` -> `sensor_msgs/JointState`."""
    return kind.replace("/msg/", "/")


def full_name(kind: str) -> str:
    """`sensor_msgs/JointState` -> `sensor_msgs/msg/JointState`."""
    package, _, name = plain_name(kind).partition("/")
    return f"{package}/msg/{name}"


def decoder(kind: str, encoding: str, definition: str, language: str, first: bytes | None) -> Decode | None:
    """The decoder of a topic's messages, or None if there is none.

    Args:
        kind: the type of the messages.
        encoding: of the messages: "cdr", "ros1" or "json".
        definition: of the type; empty if the recording contains none.
        language: of the definition: "msg" or "idl".
        first: a message by which to choose among known definitions if the recording contains none.
    """
    if encoding == "json":
        return lambda raw: json.loads(raw, object_hook=lambda fields: SimpleNamespace(**fields))
    if encoding not in ("cdr", "ros1"):
        return None
    with extra("rosbag"):
        from rosbags.typesys import Stores, get_typestore
    name = full_name(kind)
    if definition:
        store = get_typestore(Stores.EMPTY)
        store.register(_types(definition, language, name))
    else:
        store = get_typestore(Stores.ROS2_HUMBLE)
        if name == STATE and first is not None:
            return _that_fits(first, name)
        if name not in store.types:
            return None
    if encoding == "ros1":
        return lambda raw: store.deserialize_ros1(raw, name)
    return lambda raw: store.deserialize_cdr(raw, name)


def _that_fits(first: bytes, name: str) -> Decode | None:
    """The decoder of the first known definition that fits a message."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for definition in CONTROLLER_STATES:
        store = get_typestore(Stores.ROS2_HUMBLE)
        store.register(get_types_from_msg(definition, name))
        try:
            message = store.deserialize_cdr(first, name)
            joints = len(message.joint_names)  # type: ignore[attr-defined]
            points = [getattr(message, part) for part in (*NEWER, *OLDER) if hasattr(message, part)]
            if all(len(point.positions) in (0, joints) for point in points):
                return lambda raw, store=store: store.deserialize_cdr(raw, name)  # type: ignore[misc]
        except Exception:  # bytes read by another definition fail in any way
            continue
    return None


def _types(definition: str, language: str, name: str) -> Any:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if language == "msg":
        return get_types_from_msg(definition, name)
    types: dict[str, Any] = {}
    line = "=" * 80 + "\n"
    for part in definition.split(line):  # one definition after another, each under a line of its own
        text = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if text.strip():
            types.update(get_types_from_idl(text))
    return types
