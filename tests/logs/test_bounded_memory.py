"""A bag that is much larger than what is read of it takes no more memory than a small one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from ros_bags import START, Message, T, header, joint_state, odometry, twist, write_bag

CAMERA = 480 * 640 * 3  # bytes of an image
PICTURES = 300
LIMIT = 120  # MB beyond what the libraries themselves take; the bag has 276 MB

READ = """
import resource, sys
import pyarrow, rosbags.rosbag2, mcap.reader
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.models.robot_file import RobotFile

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

before = peak()
robot = RobotFile("rover", "diff_drive", parameters={"wheel_radius": 0.1, "track_width": 0.5})
(run,) = read_runs([sys.argv[1]], robot).runs
print(len(run.t), peak() - before)
"""


def messages() -> Iterator[Message]:
    rng = np.random.default_rng(0)
    for k in range(PICTURES * 10):
        t = START + 10_000_000 * k
        if k % 10 == 0:
            pixels = rng.integers(0, 255, CAMERA, dtype=np.uint8)  # noise, which no compression shrinks
            kind = T["sensor_msgs/msg/Image"]
            image = kind(header(t), 480, 640, "rgb8", 0, 1920, pixels)
            yield "/camera", t, image
        yield "/cmd_vel", t, twist(0.1, 0.0)
        yield "/odom", t, odometry(t, 0.001 * k, 0.0, 0.0)
        yield "/joint_states", t, joint_state(t, ["left", "right"], [], [1.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_large_bag_streams(tmp_path: Path, storage: str) -> None:
    bag = write_bag(tmp_path / "bag", messages(), storage)
    assert sum(file.stat().st_size for file in bag.iterdir()) > 250e6
    for path in [bag, *bag.glob("*.mcap")]:  # an MCAP file is read by another library than the folder
        words = [sys.executable, "-c", READ, str(path)]
        ended = subprocess.run(words, capture_output=True, text=True, check=True)
        rows, megabytes = ended.stdout.split()
        assert int(rows) == PICTURES * 10
        assert float(megabytes) < LIMIT, (path.name, megabytes)
