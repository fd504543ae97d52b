"""Robot files: what they say, and every slip in them as one clear message."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile, for_run, measured_over, noise_over, read_robot_file

GOOD = """
name = "arm"
plant = "mujoco"
model = "arm.xml"
payload_site = "tool"
servo_feedback = "link"
tunable = ["joint.*.damping"]
[parameters]
mass = 1
[noise]
"position.j1" = 0.001
pose.theta = 0.005
[log]
"t" = "stamp"
"position.j1" = "elbow"
[[variant]]
runs = "heavy_*"
model = "heavy.xml"
[variant.parameters]
load = 2.5
"""
VALUES = ("nan", "[]", "{}", "[{}]", '""', '"x"', "1e400", "2020-01-01", "true", "[[1]]", "-1", "[1, 'a']")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    (tmp_path / "heavy.xml").write_text("<mujoco/>")
    return tmp_path


def read(folder: Path, text: str) -> RobotFile:
    path = folder / "robot.toml"
    path.write_text(text)
    return read_robot_file(path)


def test_a_file_is_read_as_it_stands(folder: Path) -> None:
    robot = read(folder, GOOD)
    assert (robot.name, robot.plant, robot.model) == ("arm", "mujoco", folder / "arm.xml")
    assert robot.parameters == {"mass": 1.0} and robot.tunable == ("joint.*.damping",)
    assert robot.noise == {"position.j1": 0.001, "pose.theta": 0.005}  # with and without quotes
    assert robot.log == {"t": "stamp", "position.j1": "elbow"}
    assert (robot.servo_feedback, robot.position_sensor) == ("link", "link")
    assert pickle.loads(pickle.dumps(robot)) == robot


@pytest.mark.parametrize("name", ["heavy_1", "table/heavy_1"])
def test_the_first_matching_variant_is_applied(folder: Path, name: str) -> None:
    robot = read(folder, GOOD + '\n[[variant]]\nruns = "heavy_1"\npayload_site = "other"\n')
    heavy = for_run(robot, name)
    assert heavy.model == folder / "heavy.xml" and heavy.payload_site == "tool"
    assert heavy.parameters == {"mass": 1.0, "load": 2.5}
    assert for_run(robot, "light") is robot


def test_a_name_is_a_robot_of_that_name() -> None:
    assert read_robot_file("diff_drive") == RobotFile("diff_drive", "diff_drive")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('plant = "mujoco"', "", "'plant' is missing"),
        ('plant = "mujoco"', "plant = 3", "plant must be a string, got 3"),
        ("payload_site", "payload_sit", "Did you mean 'payload_site'?"),
        ('"arm.xml"', '"leg.xml"', "not found"),
        ('"heavy.xml"', '"leg.xml"', "[[variant]] 1"),
        ('"link"', '"gear"', '"motor" or "link"'),
        ('["joint.*.damping"]', '"joint"', "a list of strings"),
        ("mass = 1", "mass = true", "a number"),
        ("mass = 1", "mass = inf", "a finite number"),
        ("mass = 1", "mass = 1" + 400 * "0", "a finite number"),
        ("mass = 1", 'tunable = ["a"]', "above the first [table]"),
        ("0.001", "-0.001", "a positive 1-sigma noise"),
        ('"position.j1" = 0.001', '"command.j1" = 0.001', "measured channel"),
        ('"position.j1" = "elbow"', '"postion.j1" = "elbow"', "Did you mean 'position'?"),
        ('"position.j1" = "elbow"', '"pose.z" = "elbow"', "not a name of the log format"),
        ("pose.theta = 0.005", 'pose.theta = 0.005\n"pose.theta" = 0.1', "appears twice"),
        ('runs = "heavy_*"', "", "'runs' is missing"),
        ("[[variant]]", "[variant]", "[[variant]]"),
        ("[log]", "[log", "not valid TOML"),
    ],
)
def test_a_slip_is_named_with_its_place(folder: Path, old: str, new: str, said: str) -> None:
    assert old in GOOD
    with pytest.raises(BadInput) as fault:
        read(folder, GOOD.replace(old, new, 1))
    assert said in str(fault.value) and "robot.toml" in str(fault.value)


@pytest.mark.parametrize("given", ["nowhere.toml", "folder/robot", "nowhere.xml", "", "  "])
def test_what_is_no_robot_file_is_refused(given: str) -> None:
    with pytest.raises(BadInput):
        read_robot_file(given)


def test_a_model_file_is_a_robot_with_defaults(folder: Path) -> None:
    path = folder / "arm.xml"
    assert read_robot_file(path) == RobotFile("arm", "mujoco", folder, path, source=str(path))


def test_bytes_that_are_no_text_are_refused(folder: Path) -> None:
    path = folder / "robot.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(BadInput, match="UTF-8"):
        read_robot_file(path)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_mutated_file_is_read_or_refused(folder: Path, data: st.DataObject) -> None:
    lines = GOOD.strip().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        k = data.draw(st.integers(0, len(lines) - 1))
        change = data.draw(st.sampled_from(["drop", "double", "swap", "value", "cut"]))
        if change == "drop":
            lines[k] = ""
        elif change == "double":
            lines.insert(k, lines[k])
        elif change == "swap":
            other = data.draw(st.integers(0, len(lines) - 1))
            lines[k], lines[other] = lines[other], lines[k]
        elif change == "value":
            value = data.draw(st.sampled_from(VALUES))
            lines[k] = f"{lines[k].split('=')[0]} = {value}"
        else:
            lines[k] = lines[k][: data.draw(st.integers(0, len(lines[k])))]
    try:
        robot = read(folder, "\n".join(lines))
    except BadInput as fault:
        assert str(fault)
    else:
        assert robot.plant and robot.name and isinstance(for_run(robot, "heavy_1"), RobotFile)


def test_a_channel_s_noise_is_that_of_the_runs_that_state_one(tmp_path: Path) -> None:
    text = 'name = "r"\nplant = "diff_drive"\n[noise]\n"pose.x" = 0.003\n'
    text += '[[variant]]\nruns = "night_*"\n[variant.noise]\n"pose.x" = 0.004\n"pose.theta" = 0.02\n'
    path = tmp_path / "robot.toml"
    path.write_text(text)
    robot = read_robot_file(path)
    assert noise_over(robot, ["day_1"]) == {"pose.x": 0.003}
    assert noise_over(robot, ["day_1", "night_1"]) == pytest.approx({"pose.x": (12.5e-6) ** 0.5, "pose.theta": 0.02})


@pytest.mark.parametrize(
    ("log", "measured"),
    [
        ('"command.left" = "velocity.left"\n"command.right" = "velocity.right"', ("left", "right")),
        ('"command.left" = "wheel"\n"velocity.left" = "wheel"', ("left",)),  # one column under both names
        ('"command.left" = "set_speed"\n"velocity.left" = "wheel"', ()),
        ('"command.j1" = "effort.j1"\n"command.j2" = "command.j1"', ("j1",)),
        ('"enabled.left" = "velocity.left"', ()),
    ],
)
def test_a_measured_column_that_drives_the_model_is_no_command(folder: Path, log: str, measured: tuple[str]) -> None:
    assert read(folder, f'plant = "diff_drive"\n[log]\n{log}\n').measured_commands == measured


def test_an_actuator_is_measured_where_it_is_in_every_run(folder: Path) -> None:
    text = 'plant = "diff_drive"\n[log]\n"command.left" = "velocity.left"\n"command.right" = "velocity.right"\n'
    variant = '[[variant]]\nruns = "sent_*"\n[variant.log]\n"command.left" = "left_set"\n'
    robot = read(folder, text + variant)
    assert measured_over(robot, ["a", "b"]) == ("left", "right")
    assert measured_over(robot, ["a", "sent_1"]) == ("right",)
    assert measured_over(read(folder, 'plant = "diff_drive"'), ["a"]) == ()
