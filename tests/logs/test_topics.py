"""Which topics are read, what their columns are called and mean, and by which clock they are stamped."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_bags import (
    START,
    Message,
    T,
    array,
    header,
    imu,
    joint_state,
    odometry,
    pose_stamped,
    quaternion,
    transform,
    twist,
    twist_stamped,
    vector,
    write_bag,
    write_mcap,
)  # fmt: skip
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from residual_mpc.errors import BadInput
from residual_mpc.init.mended_logs import write_corrected_logs
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.readers.headers import read_headers
from residual_mpc.logs.readers.read import ReadResult, read_runs
from residual_mpc.logs.readers.recordings.types import CONTROLLER_STATES, STATE
from residual_mpc.logs.run import Run
from residual_mpc.models.robot_file import RobotFile

ROVER = RobotFile("rover", "diff_drive", parameters={"wheel_radius": 0.1, "track_width": 0.5})
ARM = RobotFile("arm", "mujoco")
STAMPS = [START + 10_000_000 * k for k in range(60)]
MS = 1_000_000  # ns


def read(path: Path, robot: RobotFile = ROVER) -> tuple[Run, ReadResult]:
    result = read_runs([path], robot)
    return result.runs[0], result


def finding(result: ReadResult, kind: str) -> Finding:
    (one,) = [f for f in result.findings if f.kind == kind]
    return one


def drive(k: int, t: int) -> list[Message]:
    return [("/cmd_vel", t, twist(0.1 * k, 0.0)), ("/odom", t, odometry(t, 0.1 * k, 0.0, 0.0))]


# ---- types


def test_each_type_has_its_columns(tmp_path: Path) -> None:
    messages: list[Message] = []
    for k, t in enumerate(STAMPS):
        messages += [
            ("/amcl_pose", t, pose_stamped(t, 1.0 + k, 2.0, 3.0)),
            ("/imu", t, imu(t, 0.5, 0.1 * k)),
            ("/speed", t, twist_stamped(t, 0.5, 0.25)),
            ("/gripper/commands", t, array([0.25, k])),
            ("/tf", t, transform(t, "map", "camera", 4.0, 5.0, -1.0)),
            ("/cmd_vel", t, twist(0.2, 0.1)),
            ("/chatter", t, T["std_msgs/msg/String"](data="hello")),
        ]
    (head,) = read_headers(write_bag(tmp_path / "bag", messages))
    assert set(head.names) == {
        "t",
        *(f"/amcl_pose.pose.{a}" for a in ("x", "y", "theta")),
        *(f"/imu.{n}.{a}" for n in ("angular_velocity", "linear_acceleration") for a in "xyz"),
        "/imu.theta",
        *(f"/{n}.{a}" for n in ("speed", "cmd_vel") for a in ("linear.x", "linear.y", "angular.z")),
        *(f"/gripper/commands.data.{i}" for i in (0, 1)),
        *(f"/tf.map>camera.pose.{a}" for a in ("x", "y", "theta")),
    }
    assert dict(head.preferred) == {
        **{f"pose.{a}": f"/amcl_pose.pose.{a}" for a in ("x", "y", "theta")},
        "command.linear": "/cmd_vel.linear.x",
        "command.angular": "/cmd_vel.angular.z",
    }
    columns = head.read(head.names).columns
    for name, value in (("/imu.theta", 0.5), ("/speed.angular.z", 0.25), ("/tf.map>camera.pose.theta", -1.0)):
        np.testing.assert_allclose(columns[name].to_numpy(), value, atol=1e-15)
    np.testing.assert_array_equal(columns["/gripper/commands.data.1"].to_numpy(), np.arange(60))


def test_a_body_twist_is_turned_into_the_world(tmp_path: Path) -> None:
    messages = [m for t in STAMPS for m in (
        ("/odom", t, odometry(t, 0.001 * (t - START) / MS, 0.0, np.pi / 2, linear=0.4, angular=0.2)),
        ("/cmd_vel", t, twist(0.4, 0.2)))]  # fmt: skip
    run, _ = read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_allclose(run.columns["twist.x"], 0.0, atol=1e-15)
    np.testing.assert_allclose(run.columns["twist.y"], 0.4)
    np.testing.assert_allclose(run.columns["twist.theta"], 0.2)


def test_a_twist_that_stays_zero_is_not_measured(tmp_path: Path) -> None:
    run, result = read(write_bag(tmp_path / "bag", [m for k, t in enumerate(STAMPS) for m in drive(k, t)]))
    assert not any(c.startswith("twist") for c in run.measured)
    assert "/odom" in finding(result, "empty twist").message


def test_transforms_stand_in_for_a_pose(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/tf", t, transform(t, "odom", "base_link", 0.1 * k, 0.0, 0.2)),
        ("/tf", t, transform(t, "map", "odom", 9.0, 9.0, 0.0)),
        ("/cmd_vel", t, twist(0.1, 0.0)))]  # fmt: skip
    run, _ = read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_array_equal(run.columns["pose.x"], 0.1 * np.arange(60))
    with_odometry = messages + [("/odom", t, odometry(t, 7.0, 0.0, 0.0)) for t in STAMPS]
    run, _ = read(write_bag(tmp_path / "both", sorted(with_odometry, key=lambda m: m[1])))
    assert (run.columns["pose.x"] == 7.0).all()


def controller_state(t: int, joints: Sequence[str], sent: Sequence[float], seen: Sequence[float]) -> dict[str, Any]:
    nothing = np.array([])
    time = T["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)

    def point(values: Sequence[float]) -> Any:
        return T["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array(values), velocities=nothing, accelerations=nothing, effort=nothing, time_from_start=time
        )

    sent_, seen_ = point(sent), point(seen)
    parts = {"reference": sent_, "desired": sent_, "feedback": seen_, "actual": seen_, "error": point([]),
             "output": point([])}  # fmt: skip
    return {"header": header(t), "joint_names": list(joints), **parts}


@pytest.mark.parametrize("number", range(len(CONTROLLER_STATES)))
@pytest.mark.parametrize("defined", [True, False])
def test_a_controller_says_what_it_commands(tmp_path: Path, number: int, defined: bool) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(CONTROLLER_STATES[number], STATE))
    kind = store.types[STATE]
    messages: list[Message] = []
    for k, t in enumerate(STAMPS):
        fields = controller_state(t, ["a", "b"], [0.1 * k, 0.2], [0.3, 0.4 * k])
        known = {f: v for f, v in fields.items() if f in kind.__dataclass_fields__}
        empty = {f: [] for f in kind.__dataclass_fields__ if f == "multi_dof_joint_names"}
        multi = store.types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
        time = T["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
        for f in kind.__dataclass_fields__:
            if f.startswith("multi_dof_") and f != "multi_dof_joint_names":
                empty[f] = multi(transforms=[], velocities=[], accelerations=[], time_from_start=time)
        messages.append(("/arm/state", t, kind(**known, **empty)))
        messages.append(("/joint_states", t, joint_state(t, ["b", "a"], [1.0, 2.0])))
    bag = write_bag(tmp_path / "bag", messages, store=store)
    if not defined:
        forget_definitions(bag)
    run, _ = read(bag, ARM)
    np.testing.assert_array_equal(run.columns["command.a"], 0.1 * np.arange(60))
    np.testing.assert_array_equal(run.columns["position.a"], np.full(60, 2.0))  # the joints' own topic goes first
    np.testing.assert_array_equal(run.extra_columns["/arm/state.feedback.position.b"], 0.4 * np.arange(60))


def forget_definitions(bag: Path) -> None:
    """A bag as ROS 2 Humble writes it: without the definitions of its types."""
    import sqlite3

    (base,) = bag.glob("*.db3")
    with sqlite3.connect(base) as connection:
        connection.execute("delete from message_definitions")


def test_a_type_that_nobody_defines_is_named(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("string[] dof_names\nfloat64[] values\nfloat64[] values_dot",
                                      "control_msgs/msg/MultiDOFCommand"))  # fmt: skip
    kind = store.types["control_msgs/msg/MultiDOFCommand"]
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/sent", t, kind(dof_names=["a"], values=np.array([0.1 * k]), values_dot=np.array([]))),
        ("/joint_states", t, joint_state(t, ["a"], [1.0])))]  # fmt: skip
    run, _ = read(write_bag(tmp_path / "whole", messages, store=store), ARM)
    np.testing.assert_array_equal(run.columns["command.a"], 0.1 * np.arange(60))
    bag = write_bag(tmp_path / "bag", messages, store=store)
    forget_definitions(bag)
    (head,) = read_headers(bag)
    assert "does not define the type" in head.remarks[0].message and "/sent" in head.remarks[0].message


def test_names_that_the_robot_file_gives(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/position_controller/commands", t, array([k, -k])),
        ("/joint_states", t, joint_state(t, ["one"], [k])))]  # fmt: skip
    log = {"command.a": "/position_controller/commands.data.1", "position.a": "/joint_states.position.one"}
    run, _ = read(write_bag(tmp_path / "bag", messages), RobotFile("arm", "mujoco", log=log))
    np.testing.assert_array_equal(run.columns["command.a"], -np.arange(60.0))
    assert set(run.columns) == {"command.a", "position.a"}
    with pytest.raises(BadInput, match="/joint_states.position.one"):
        read(tmp_path / "bag", RobotFile("arm", "mujoco", log={"position.a": "/joint_states.position.uno"}))


def test_joint_states_of_several_publishers(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/joint_command", t, joint_state(t, ["a", "b"], [0.5, -k])),
        ("/joint_states", t, joint_state(t, ["b", "a"], [k, 2.0])),
        ("/joint_states", t + 5 * MS, joint_state(t + 5 * MS, ["grip"], [3.0])))]  # fmt: skip
    run, _ = read(write_bag(tmp_path / "bag", messages), ARM)
    assert len(run.t) == 120 and run.period == pytest.approx(0.01)
    np.testing.assert_array_equal(run.columns["position.b"][::2], np.arange(60.0))
    assert np.isnan(run.columns["position.b"][1::2]).all() and (run.columns["position.grip"][1::2] == 3.0).all()
    np.testing.assert_array_equal(run.columns["command.b"][::2], -np.arange(60.0))


def test_two_topics_of_one_meaning_need_a_word(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in [*drive(k, t), ("/gps", t, pose_stamped(t, 50.0, 0.0, 0.0))]]
    path = write_bag(tmp_path / "bag", messages)
    with pytest.raises(BadInput, match=r"pose.x may be /odom.pose.x or /gps.pose.x.*\"pose.x\" = \"/odom.pose.x\""):
        read(path)
    log = {f"pose.{a}": f"/gps.pose.{a}" for a in ("x", "y", "theta")}
    run, result = read(path, RobotFile("rover", "diff_drive", parameters=ROVER.parameters, log=log))
    assert (run.columns["pose.x"] == 50.0).all()
    assert not [f for f in result.findings if f.kind == "several topics"]


def test_wheel_speeds_that_drive_the_model(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/joint_states", t, joint_state(t, ["lw", "rw"], [], [1.0, 2.0])),
        ("/odom", t, odometry(t, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    log = {"command.left": "/joint_states.velocity.lw", "command.right": "/joint_states.velocity.rw"}
    robot = RobotFile("rover", "diff_drive", log=log)
    run, _ = read(write_bag(tmp_path / "bag", messages), robot)
    assert run.actuators == ("left", "right") and robot.measured_commands == ("left", "right")


def test_topics_that_no_run_needs_add_no_rows(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in [*drive(k, t), ("/imu", t + 3, imu(t + 3, 0.0, 0.0))]]
    run, result = read(write_bag(tmp_path / "bag", messages))
    assert len(run.t) == 60 and finding(result, "unused topic").message == "topic /imu is not used"


def test_a_recording_without_any_known_topic(tmp_path: Path) -> None:
    chatter = [("/chatter", t, T["std_msgs/msg/String"](data="hello")) for t in STAMPS]
    with pytest.raises(BadInput, match=r"/chatter \(std_msgs/String\)"):
        read(write_bag(tmp_path / "bag", chatter))


def test_ros_1_bags(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(tmp_path / "a.bag") as writer:
        sent = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        seen = writer.add_connection("/pose", "geometry_msgs/msg/Pose2D", typestore=store)
        place = writer.add_connection("/place", "geometry_msgs/msg/Pose", typestore=store)
        for k, t in enumerate(STAMPS):
            writer.write(sent, t, store.serialize_ros1(twist(0.1 * k, 0.0), "geometry_msgs/msg/Twist"))
            flat = T["geometry_msgs/msg/Pose2D"](x=0.0, y=0.0, theta=0.0)
            writer.write(seen, t, store.serialize_ros1(flat, "geometry_msgs/msg/Pose2D"))
            pose = T["geometry_msgs/msg/Pose"](position=vector(0.1 * k, kind="Point"), orientation=quaternion(0.2))
            writer.write(place, t, store.serialize_ros1(pose, "geometry_msgs/msg/Pose"))
    run, _ = read(tmp_path / "a.bag")
    np.testing.assert_array_equal(run.columns["pose.x"], 0.1 * np.arange(60))
    np.testing.assert_allclose(run.columns["command.left"], np.arange(60.0))


# ---- clocks


def test_header_stamps_say_when_and_the_delay_is_reported(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/cmd_vel", t + 4 * MS, twist_stamped(t, 0.1, 0.0)),
        ("/odom", t + (2 + k % 3) * MS, odometry(t, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    run, result = read(write_bag(tmp_path / "bag", sorted(messages, key=lambda m: m[1])))
    assert len(run.t) == 60 and run.start == START / 1e9
    said = finding(result, "clocks")
    assert said.severity == "info"
    assert "/odom: header stamps, received 3 ms later (2 to 4 ms)" in said.message
    assert "/cmd_vel: header stamps, received 4 ms later (4 to 4 ms)" in said.message
    assert not [f for f in result.findings if f.kind.startswith("clock ")]


def test_the_clocks_of_recordings_whose_topics_come_in_another_order_are_one_finding(tmp_path: Path) -> None:
    first = [m for k, t in enumerate(STAMPS) for m in drive(k, t)]
    paths = [write_bag(tmp_path / "a", first), write_bag(tmp_path / "b", first[1:])]
    said = finding(read_runs(paths, ROVER), "clocks")
    assert said.run == "" and said.message.startswith("/cmd_vel: time of receipt (no header); /odom: header stamps")


@pytest.mark.parametrize(
    ("stamp", "fault"),
    [
        (lambda k, t: 0, "header stamps are not set"),
        (lambda k, t: 2 * START - t, "header stamps run backwards"),
        (lambda k, t: START + (k // 10) * 100 * MS, "header stamps repeat"),
    ],
)
def test_unsound_header_stamps_give_way_to_the_time_of_receipt(tmp_path: Path, stamp: Any, fault: str) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/cmd_vel", t, twist(0.1, 0.0)), ("/odom", t, odometry(stamp(k, t), 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    run, result = read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_allclose(run.t, 0.01 * np.arange(60), atol=1e-12)
    assert f"/odom: time of receipt ({fault})" in finding(result, "clocks").message


def test_clocks_that_count_from_other_zeros_are_not_mixed(tmp_path: Path) -> None:
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/cmd_vel", t, twist(0.1, 0.0)), ("/odom", t + MS, odometry(t - START + 1, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    run, result = read(write_bag(tmp_path / "bag", messages))
    assert run.start == pytest.approx(START / 1e9) and np.isfinite(run.columns["pose.x"]).sum() == 60
    said = finding(result, "other clock")
    assert said.severity == "warning" and "/odom" in said.message and "time of receipt" in said.message
    stamped = [m for k, t in enumerate(STAMPS) for m in (
        ("/cmd_vel", t, twist_stamped(t - START + 1, 0.1, 0.0)),
        ("/odom", t, odometry(t - START + 1, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    run, result = read(write_bag(tmp_path / "simulated", stamped))
    assert run.start == pytest.approx(1e-9) and len(run.t) == 60  # one clock, that of the simulation


def test_an_offset_between_clocks_is_reported_and_nothing_is_shifted(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    late = (rng.exponential(3.0, 60) * MS).astype(int)
    messages = [m for k, t in enumerate(STAMPS) for m in (
        ("/cmd_vel", t + MS, twist_stamped(t, 0.1, 0.0)),
        ("/odom", t + int(late[k]), odometry(t - 350 * MS, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    run, result = read(write_mcap(tmp_path / "a.mcap", messages))
    said = finding(result, "clock offset")
    assert said.severity == "warning" and "/odom are 349 ms behind those of /cmd_vel" in said.message
    there = np.isfinite(run.columns["pose.x"])
    assert run.start + run.t[there][0] == pytest.approx((STAMPS[0]) / 1e9, abs=0.02)  # rows before a command are cut
    np.testing.assert_allclose(run.columns["pose.x"][there][0], 0.1 * 35, atol=1e-9)


def test_a_clock_that_drifts_is_reported(tmp_path: Path) -> None:
    stamps = [START + 10 * MS * k for k in range(400)]
    messages = [m for k, t in enumerate(stamps) for m in (
        ("/cmd_vel", t, twist_stamped(t, 0.1, 0.0)),
        ("/odom", t, odometry(t - k * MS // 10, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    _, result = read(write_bag(tmp_path / "bag", messages))
    assert "/odom drifts by" in finding(result, "clock drift").message


def test_stamps_next_to_each_other_do_not_make_the_period(tmp_path: Path) -> None:
    """Three topics that are received within microseconds, twenty times a second."""
    messages = [m for k in range(60) for t in [START + 50 * MS * k] for m in (
        ("/cmd_vel", t, twist(0.1, 0.0)),
        ("/joint_states", t + 2000, joint_state(t + 2000, ["left", "right"], [], [1.0, 1.0])),
        ("/odom", t + 4000, odometry(t + 4000, 0.1 * k, 0.0, 0.0)))]  # fmt: skip
    bag = write_bag(tmp_path / "bag", messages)
    run, _ = read(bag)
    assert len(run.t) == 180 and run.period == pytest.approx(0.05)
    log = {"command.linear": "/cmd_vel.linear.x", "command.angular": "/cmd_vel.angular.z", "pose.x": "/odom.pose.x"}
    (table,) = write_corrected_logs([bag], [], tmp_path / "corrected")  # as `init --mended` writes it
    again, _ = read(table, RobotFile("rover", "diff_drive", parameters=ROVER.parameters, log=log))
    np.testing.assert_allclose(again.t, run.t, atol=1e-9)


@pytest.mark.parametrize("part", [{"sec": 10**12, "nsec": 0}, {"sec": "1", "nsec": None}])
def test_json_that_is_no_message_is_refused(tmp_path: Path, part: dict[str, Any]) -> None:
    import json

    from mcap.writer import Writer

    place = {"x": 0.1, "y": 0.0, "z": 0.0, "w": 1.0}
    message = {"header": {"stamp": part}, "pose": {"position": place, "orientation": place}}
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("geometry_msgs/PoseStamped", "jsonschema", b"{}")
        channel = writer.register_channel("/place", "json", schema)
        for t in STAMPS:
            writer.add_message(channel, log_time=t, publish_time=t, data=json.dumps(message).encode())
        writer.finish()
    with pytest.raises(BadInput, match="the recording is damaged"):
        read(tmp_path / "a.mcap")


def test_mcap_messages_in_json(tmp_path: Path) -> None:
    import json

    from mcap.writer import Writer

    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for topic, kind in (("/cmd_vel", "geometry_msgs/Twist"), ("/place", "geometry_msgs/msg/PoseStamped")):
            schema = writer.register_schema(kind, "jsonschema", b"{}")
            channels[topic] = writer.register_channel(topic, "json", schema)
        for k, t in enumerate(STAMPS):
            sent = {"linear": {"x": 0.1 * k, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": 0}}
            turn = {"x": 0, "y": 0, "z": 0, "w": 1}
            pose = {"position": {"x": 0.2 * k, "y": 0, "z": 0}, "orientation": turn}
            seen = {"header": {"stamp": {"sec": t // 10**9, "nsec": t % 10**9}, "frame_id": "map"}, "pose": pose}
            for topic, message in (("/cmd_vel", sent), ("/place", seen)):
                writer.add_message(channels[topic], log_time=t, publish_time=t, data=json.dumps(message).encode())
        writer.finish()
    run, _ = read(tmp_path / "a.mcap")
    np.testing.assert_array_equal(run.columns["pose.x"], 0.2 * np.arange(60))
    np.testing.assert_allclose(run.columns["command.left"], np.arange(60.0))
