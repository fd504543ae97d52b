"""Cases that outside checks found wrong in 0.1.0, diagnosed through the command line (../shared/cases, where it is)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from residual_mpc.cli.main import cli

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CASES.is_dir(), reason="the folder ../shared/cases is absent"),
]


def diagnosed(name: str, out: Path) -> dict[str, Any]:
    case = CASES / name
    runs = [str(p) for p in sorted(case.glob("run*.csv.gz"))]
    result = CliRunner().invoke(cli, ["diagnose", "--robot", str(case / "robot.toml"), *runs, "--out", str(out)])
    assert result.exit_code == 0, result.output
    document: dict[str, Any] = json.loads((out / "diagnosis.json").read_text())
    return document


def named(document: dict[str, Any], least: float = 0.0) -> set[str]:
    return {c["effect"] for c in document["explanation"] if c["probability"] >= least}


@pytest.mark.parametrize("name", ["coloured_noise_1", "coloured_noise_2"])
def test_coloured_noise_is_no_gap(name: str, tmp_path: Path) -> None:
    assert diagnosed(name, tmp_path)["verdict"] == "no_gap"


@pytest.mark.parametrize("name", ["changed_left_gain_1", "changed_left_gain_2"])
def test_a_gain_that_changes_is_doubted(name: str, tmp_path: Path) -> None:
    document = diagnosed(name, tmp_path)
    assert document["verdict"] in ("unknown", "partial")
    assert named(document, 0.5) == set()


@pytest.mark.parametrize(
    ("name", "planted"),
    [
        ("slow_mismatch", {"wheel_radius_mismatch"}),
        ("delay_mismatch_limit", {"command_delay", "wheel_radius_mismatch", "saturation"}),
        ("mismatch_radius_bias", {"wheel_radius_mismatch", "wheel_radius", "sensor_bias"}),
        ("dead_zone_and_mounting", {"dead_zone", "sensor_mounting"}),
        ("limit_and_dead_zone_before_lag", {"saturation", "dead_zone", "actuator_lag"}),
    ],
)
def test_what_was_planted_is_named(name: str, planted: set[str], tmp_path: Path) -> None:
    assert planted <= named(diagnosed(name, tmp_path))


def test_a_faint_lag_of_the_actuators_is_not_said_to_be_the_sensors(tmp_path: Path) -> None:
    """21 ms in the background: a slow sensor or a delay leaves hardly more of the gap."""
    document = diagnosed("unequal_and_larger_wheels", tmp_path)
    late = {"command_delay", "sensor_delay", "sensor_lag"}
    assert not late & named(document, 0.5)
    groups = [{m["effect"] for m in group if isinstance(m, dict)} for group in document["confounded"]]
    assert not late & named(document) or any({"actuator_lag"} < group for group in groups)
