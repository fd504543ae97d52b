"""A robot file for the built-in rover, from a log that names and measures things its own way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run

from residual_mpc.init.built_in import draft_built_in

NAMES = {
    "command.left": "wl_set", "command.right": "wr_set", "velocity.left": "wl_enc", "velocity.right": "wr_enc",
    "pose.x": "mocap_x_mm", "pose.y": "mocap_y_mm", "pose.theta": "mocap_yaw_deg",
}  # fmt: skip


def written(folder: Path, turned: bool = False, lag: float = 0.1) -> Path:
    """turned: the encoders count angles, not speeds; lag: s, of the motors."""
    run = rover_run("one", {"actuator_lag": {"time_constant": lag}}, 20.0, seed=1)
    columns = dict(run.columns)
    for side in ("left", "right"):
        u = columns[f"command.{side}"]
        speed = np.concatenate([[0.0], u[:-1]])
        columns[f"velocity.{side}"] = np.cumsum(speed) * run.period if turned else speed
    columns |= {c: 1e3 * columns[c] for c in ("pose.x", "pose.y")}
    columns["pose.theta"] = np.degrees((columns["pose.theta"] + np.pi) % (2 * np.pi) - np.pi)
    table = {"timestamp": run.t + 37.2, **{name: columns[c] for c, name in NAMES.items()}}
    pd.DataFrame(table).to_csv(folder / "one.csv", index=False)
    return folder / "one.csv"


def test_wheels_places_and_units_are_found(tmp_path: Path) -> None:
    found = draft_built_in("diff_drive", [written(tmp_path)])
    assert {g.what: g.value for g in found.guesses if g.what in NAMES} == NAMES
    factors = {m.column: m.factor for m in found.mends}
    assert factors == pytest.approx({"mocap_yaw_deg": np.pi / 180, "mocap_x_mm": 1e-3, "mocap_y_mm": 1e-3})


def test_encoders_that_count_angles_are_no_speeds(tmp_path: Path) -> None:
    found = draft_built_in("diff_drive", [written(tmp_path, turned=True)])
    assert not {"wl_enc", "wr_enc"} & {g.value for g in found.guesses}


def test_speeds_whose_names_say_rpm_are_converted(tmp_path: Path) -> None:
    table = pd.read_csv(written(tmp_path))
    speeds = {"wl_set": "wl_set_rpm", "wr_set": "wr_set_rpm", "wl_enc": "wl_enc_rpm", "wr_enc": "wr_enc_rpm"}
    table[list(speeds)] *= 30.0 / np.pi
    table.rename(columns=speeds).to_csv(tmp_path / "one.csv", index=False)
    found = draft_built_in("diff_drive", [tmp_path / "one.csv"])
    assert {m.column: m.factor for m in found.mends if m.column.endswith("rpm")} == pytest.approx(
        dict.fromkeys(speeds.values(), np.pi / 30.0)
    )
    (radius,) = (g for g in found.guesses if g.what == "parameters.wheel_radius")
    assert float(radius.why.split("about ")[1].split(" m)")[0]) == pytest.approx(WHEEL_RADIUS, rel=0.2)


@pytest.mark.parametrize("lag", [0.01, 0.1])
def test_the_motion_hints_at_the_geometry_and_does_not_set_it(tmp_path: Path, lag: float) -> None:
    """The rover of the log is the built-in one, in millimetres and degrees, behind slow motors."""
    found = draft_built_in("diff_drive", [written(tmp_path, lag=lag)])
    for name, value in (("wheel_radius", WHEEL_RADIUS), ("track_width", TRACK_WIDTH)):
        (guess,) = (g for g in found.guesses if g.what == f"parameters.{name}")
        hint = float(guess.why.split("about ")[1].split(" m)")[0])
        assert hint == pytest.approx(value, rel=0.2) and guess.sure == 0.1
        assert found.parameters[name] == float(guess.value)
