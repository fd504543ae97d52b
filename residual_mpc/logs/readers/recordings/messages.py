"""The samples in a message of each type: a header stamp, named numbers, and their meaning in the log format.

A field has the name of the log format if that has the quantity (`pose.x`), otherwise the name of the message's own
field (`linear_acceleration.x`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import atan2, cos, isfinite, nan, sin
from typing import Any

LONGEST = 128  # numbers in an array; a longer one is a scan or an image
COMMANDS = frozenset(
    "cmd command commands commanded desired target targets goal reference references setpoint setpoints".split()
)
GOALS = frozenset(
    "goal goals initialpose target plan path waypoint waypoints".split()
)  # topics whose pose is not a measurement
FIXED, MOVING = frozenset(("map", "odom", "world")), frozenset(("base_link", "base_footprint"))  # frames of a pose


@dataclass(frozen=True)
class Sample:
    """Attributes:
    stamp: of the header, ns since the clock's zero; None for a message without a header.
    part: distinguishes the samples of one topic, such as by the frames of a transform; usually empty.
    values: field -> number.
    """

    stamp: int | None
    part: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Meaning:
    """name: of the log format. rank: of two columns with the same meaning, the one with the lower rank is used."""

    name: str
    rank: int = 0


@dataclass(frozen=True)
class MessageType:
    """samples: those of a message. meaning: (words of the topic, part, field) -> meaning of the field, or None."""

    samples: Callable[[Any], Iterator[Sample]]
    meaning: Callable[[frozenset[str], str, str], Meaning | None]


def words_of(topic: str) -> frozenset[str]:
    """The words of a topic's name in small letters."""
    return frozenset(re.findall("[a-z]+", re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", topic).lower()))


def _stamp(message: Any) -> int | None:
    header = getattr(message, "header", None)
    return None if header is None else _nanoseconds(header.stamp)


def _nanoseconds(stamp: Any) -> int:
    rest = getattr(stamp, "nanosec", None)
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nsec if rest is None else rest)


def _no_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    return None


# ---- joints


def _joint_state(message: Any) -> Iterator[Sample]:
    yield Sample(_stamp(message), "", _by_joint(message.name, "", message))


def _by_joint(joints: Sequence[str], head: str, point: Any) -> dict[str, float]:
    """The positions, velocities and efforts of joints; a list that does not match the joints is left out."""
    values = {}
    for group, plural in (("position", "positions"), ("velocity", "velocities"), ("effort", "effort")):
        numbers: Sequence[float] = getattr(point, plural if hasattr(point, plural) else group, ())
        if len(numbers) == len(joints) <= LONGEST:
            values.update({f"{head}{group}.{joint}": float(x) for joint, x in zip(joints, numbers, strict=True)})
    return values


def _joint_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    group, _, joint = field.partition(".")
    if not topic & COMMANDS:
        return Meaning(field)
    return Meaning(f"command.{joint}", ("position", "velocity", "effort").index(group))


def _dynamic_joint_state(message: Any) -> Iterator[Sample]:
    values = {
        f"{interface}.{joint}": float(x)
        for joint, each in zip(message.joint_names, message.interface_values, strict=False)
        for interface, x in zip(each.interface_names, each.values, strict=False)
    }
    yield Sample(_stamp(message), "", values)


def _dynamic_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    return Meaning(field, 2) if field.startswith(("position.", "velocity.", "effort.")) else None


def _controller_state(message: Any) -> Iterator[Sample]:
    values: dict[str, float] = {}
    for part, older in (("reference", "desired"), ("feedback", "actual"), ("output", None)):
        point = getattr(message, part, None)
        if older is not None and (point is None or not len(point.positions) + len(point.velocities)):
            point = getattr(message, older, point)  # some controllers still fill in the older fields
        if point is not None:
            values.update(_by_joint(message.joint_names, f"{part}.", point))
    yield Sample(_stamp(message), "", values)


def _controller_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    head, _, rest = field.partition(".")
    group, _, joint = rest.partition(".")
    if head == "reference":
        return Meaning(f"command.{joint}", ("position", "velocity", "effort").index(group))
    return Meaning(rest, 1) if head == "feedback" and group != "effort" else None


def _dof_states(message: Any) -> Iterator[Sample]:
    values = {}
    for each in message.dof_states:
        values[f"reference.{each.name}"] = float(each.reference)
        values[f"feedback.{each.name}"] = float(each.feedback)
        values[f"output.{each.name}"] = float(each.output)
    yield Sample(_stamp(message), "", values)


def _dof_command(message: Any) -> Iterator[Sample]:
    names = message.dof_names
    values = {f"value.{n}": float(x) for n, x in zip(names, message.values, strict=False)}
    yield Sample(_stamp(message), "", values)


def _dof_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    head, _, joint = field.partition(".")
    return Meaning(f"command.{joint}", 1) if head in ("reference", "value") else None


def _array(message: Any) -> Iterator[Sample]:
    data = message.data if len(message.data) <= LONGEST else ()
    yield Sample(None, "", {f"data.{i}": float(x) for i, x in enumerate(data)})


def _number(message: Any) -> Iterator[Sample]:
    yield Sample(None, "", {"data": float(message.data)})


# ---- bodies


def heading(q: Any) -> float:
    """The heading of a quaternion, rad; NaN if it is not a rotation."""
    size = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not isfinite(size) or size < 1e-12:
        return nan
    return atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)


def _planar(pose: Any) -> dict[str, float]:
    return {"pose.x": pose.position.x, "pose.y": pose.position.y, "pose.theta": heading(pose.orientation)}


def _odometry(message: Any) -> Iterator[Sample]:
    """Odometry states the twist in the robot's frame; the log format has it in the world frame."""
    values = _planar(message.pose.pose)
    v, theta = message.twist.twist.linear, values["pose.theta"]
    values["twist.x"] = v.x * cos(theta) - v.y * sin(theta)
    values["twist.y"] = v.x * sin(theta) + v.y * cos(theta)
    values["twist.theta"] = message.twist.twist.angular.z
    values["linear.x"], values["linear.y"] = v.x, v.y
    yield Sample(_stamp(message), "", values)


def _pose_stamped(message: Any) -> Iterator[Sample]:
    pose = message.pose
    yield Sample(_stamp(message), "", _planar(getattr(pose, "pose", pose)))  # one more level with a covariance


def _pose(message: Any) -> Iterator[Sample]:
    yield Sample(None, "", _planar(message))


def _pose_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    return None if topic & GOALS or not field.startswith(("pose.", "twist.")) else Meaning(field)


def _twist(message: Any) -> Iterator[Sample]:
    twist = getattr(message, "twist", message)
    twist = getattr(twist, "twist", twist)
    values = {"linear.x": twist.linear.x, "linear.y": twist.linear.y, "angular.z": twist.angular.z}
    yield Sample(_stamp(message), "", values)


def _twist_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    name = {"linear.x": "command.linear", "angular.z": "command.angular"}.get(field)
    return Meaning(name) if name is not None and topic & COMMANDS else None


def _imu(message: Any) -> Iterator[Sample]:
    rate, push = message.angular_velocity, message.linear_acceleration
    values = {"theta": heading(message.orientation)}
    for name, vector in (("angular_velocity", rate), ("linear_acceleration", push)):
        values.update({f"{name}.{axis}": getattr(vector, axis) for axis in "xyz"})
    yield Sample(_stamp(message), "", values)


def _transforms(message: Any) -> Iterator[Sample]:
    for each in message.transforms:
        yield from _transform(each)


def _transform(message: Any) -> Iterator[Sample]:
    place, turn = message.transform.translation, message.transform.rotation
    part = f"{message.header.frame_id.strip('/')}>{message.child_frame_id.strip('/')}"
    yield Sample(_stamp(message), part, {"pose.x": place.x, "pose.y": place.y, "pose.theta": heading(turn)})


def _transform_meaning(topic: frozenset[str], part: str, field: str) -> Meaning | None:
    parent, _, child = part.partition(">")
    return Meaning(field, 1) if parent in FIXED and child in MOVING else None


_JOINTS = MessageType(_joint_state, _joint_meaning)
_POSES = MessageType(_pose_stamped, _pose_meaning)
_TWISTS = MessageType(_twist, _twist_meaning)
_ARRAYS = MessageType(_array, _no_meaning)
_NUMBERS = MessageType(_number, _no_meaning)
TYPES: Mapping[str, MessageType] = {
    "sensor_msgs/JointState": _JOINTS,
    "control_msgs/DynamicJointState": MessageType(_dynamic_joint_state, _dynamic_meaning),
    "control_msgs/JointTrajectoryControllerState": MessageType(_controller_state, _controller_meaning),
    "control_msgs/MultiDOFStateStamped": MessageType(_dof_states, _dof_meaning),
    "control_msgs/MultiDOFCommand": MessageType(_dof_command, _dof_meaning),
    "std_msgs/Float64MultiArray": _ARRAYS,
    "std_msgs/Float32MultiArray": _ARRAYS,
    "std_msgs/Float64": _NUMBERS,
    "std_msgs/Float32": _NUMBERS,
    "nav_msgs/Odometry": MessageType(_odometry, _pose_meaning),
    "geometry_msgs/PoseStamped": _POSES,
    "geometry_msgs/PoseWithCovarianceStamped": _POSES,
    "geometry_msgs/Pose": MessageType(_pose, _pose_meaning),
    "geometry_msgs/Twist": _TWISTS,
    "geometry_msgs/TwistStamped": _TWISTS,
    "geometry_msgs/TwistWithCovarianceStamped": _TWISTS,
    "sensor_msgs/Imu": MessageType(_imu, _no_meaning),
    "tf2_msgs/TFMessage": MessageType(_transforms, _transform_meaning),
    "geometry_msgs/TransformStamped": MessageType(_transform, _transform_meaning),
}
