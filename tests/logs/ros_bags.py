"""Bags that the tests of the logs share, written by libraries that the program does not use for reading."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
START = 1_760_000_000_000_000_000  # ns since 1970

Message = tuple[str, int, Any]  # topic, receive stamp in ns, message


def header(stamp: int, frame: str = "") -> Any:
    seconds, rest = divmod(stamp, 1_000_000_000)
    time = T["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    return T["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0, kind: str = "Vector3") -> Any:
    return T[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)


def quaternion(theta: float) -> Any:
    with np.errstate(invalid="ignore"):  # odd headings are wanted by some tests
        z, w = float(np.sin(theta / 2)), float(np.cos(theta / 2))
    return T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=z, w=w)


def pose(x: float, y: float, theta: float) -> Any:
    return T["geometry_msgs/msg/Pose"](position=vector(x, y, kind="Point"), orientation=quaternion(theta))


def twist(linear: float, angular: float) -> Any:
    return T["geometry_msgs/msg/Twist"](linear=vector(linear), angular=vector(z=angular))


def twist_stamped(stamp: int, linear: float, angular: float) -> Any:
    return T["geometry_msgs/msg/TwistStamped"](header=header(stamp), twist=twist(linear, angular))


def odometry(stamp: int, x: float, y: float, theta: float, linear: float = 0.0, angular: float = 0.0) -> Any:
    none = np.zeros(36)
    return T["nav_msgs/msg/Odometry"](
        header=header(stamp, "odom"),
        child_frame_id="base_link",
        pose=T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(x, y, theta), covariance=none),
        twist=T["geometry_msgs/msg/TwistWithCovariance"](twist=twist(linear, angular), covariance=none),
    )


def pose_stamped(stamp: int, x: float, y: float, theta: float) -> Any:
    return T["geometry_msgs/msg/PoseStamped"](header=header(stamp, "map"), pose=pose(x, y, theta))


def transform(stamp: int, parent: str, child: str, x: float, y: float, theta: float) -> Any:
    turn = T["geometry_msgs/msg/Transform"](translation=vector(x, y), rotation=quaternion(theta))
    each = T["geometry_msgs/msg/TransformStamped"](header=header(stamp, parent), child_frame_id=child, transform=turn)
    return T["tf2_msgs/msg/TFMessage"](transforms=[each])


def joint_state(
    stamp: int, names: Sequence[str], position: Sequence[float] = (), velocity: Sequence[float] = ()
) -> Any:
    return T["sensor_msgs/msg/JointState"](
        header=header(stamp),
        name=list(names),
        position=np.array(position, dtype=np.float64),
        velocity=np.array(velocity, dtype=np.float64),
        effort=np.array([], dtype=np.float64),
    )


def array(values: Sequence[float]) -> Any:
    layout = T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return T["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array(values, dtype=np.float64))


def imu(stamp: int, theta: float, rate: float) -> Any:
    none = np.zeros(9)
    return T["sensor_msgs/msg/Imu"](
        header=header(stamp),
        orientation=quaternion(theta),
        orientation_covariance=none,
        angular_velocity=vector(z=rate),
        angular_velocity_covariance=none,
        linear_acceleration=vector(z=9.81),
        linear_acceleration_covariance=none,
    )


def write_bag(folder: Path, messages: Iterable[Message], storage: str = "sqlite3", store: Any = STORE) -> Path:
    """A rosbag2 with the storage plugin "sqlite3" or "mcap", by rosbags."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    connections: dict[str, Any] = {}
    with BagWriter(folder, version=9, storage_plugin=plugin) as writer:
        for topic, receive, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], receive, store.serialize_cdr(message, kind))
    return folder


def write_mcap(path: Path, messages: Iterable[Message], store: Any = STORE, **options: Any) -> Path:
    """An MCAP file by mcap-ros2-support, which shares no code with rosbags."""
    schemas: dict[str, Any] = {}
    with open(path, "wb") as file, McapWriter(file, **options) as writer:
        for topic, receive, message in messages:
            kind = message.__msgtype__
            if kind not in schemas:
                definition, _ = store.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, definition)
            writer.write_message(topic, schemas[kind], _plain(message), log_time=receive)
    return path


def _plain(message: Any) -> Any:
    """A message as a tree of plain objects, lists and numbers."""
    if hasattr(message, "__msgtype__"):
        names = [n for n in message.__dataclass_fields__ if n != "__msgtype__"]
        return SimpleNamespace(**{n: _plain(getattr(message, n)) for n in names})
    if isinstance(message, np.ndarray):
        return message.tolist()
    return [_plain(each) for each in message] if isinstance(message, list) else message
