"""The differential drive against the paper's equation, integrated literally, with and without each effect."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS, simulate

from plants.diff_drive import DiffDrive, build
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, Settings, assemble

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
POSE = ("pose.x", "pose.y", "pose.theta")
LEAD = 0.4  # s
# every effect of the wheeled robot that its replay hosts, with a value that shows
FAULTS: dict[str, dict[str, float]] = {
    "command_delay": {"delay": 0.083},
    "dead_zone": {"width": 4.0},
    "rate_limit": {"rate": 20.0},
    "breakaway_loss": {"loss": 1.5},
    "actuator_lag": {"time_constant": 0.12},
    "actuator_gain": {"gain": 0.8},
    "saturation": {"limit": 7.0},
    "voltage_sag": {"rate": 0.05},
    "backlash": {"gap": 0.4},
    "turn_gain": {"gain": 0.6},
    "turn_limit": {"limit": 1.0},
    "shared_limit": {"limit": 6.0},
    "forward_rate_limit": {"rate": 12.0},
    "turn_rate_limit": {"rate": 8.0},
    "wheel_radius": {"scale": 1.1},
    "wheel_radius_mismatch": {"ratio": 1.05},
    "track_width": {"scale": 1.3},
    "lateral_slip": {"coefficient": 0.2},
    "longitudinal_slip": {"coefficient": 4.0},
    "wheel_eccentricity": {"amplitude": 0.2, "phase": 0.7},
    "slope": {"rate": 0.04, "heading": 2.0},
}


def waving(t: float) -> tuple[float, float]:
    """Wheel speeds, rad/s, that speed up, slow down, turn both ways and reverse."""
    return 4.0 + 6.0 * np.sin(5.0 * t), 3.0 + 7.0 * np.sin(4.0 * t + 1.0)


def drive_of(command: object, dt: float, length: float, clock: float = 0.0) -> Drive:
    """The mean of a command over each step, from LEAD before the window on."""
    assert callable(command)
    lead, steps = int(round(LEAD / dt)), int(round(length / dt))
    fine = 20
    t = dt * (np.arange((lead + steps) * fine) + 0.5) / fine - LEAD
    u = np.array([command(x) for x in t]).reshape(lead + steps, fine, 2).mean(axis=1)
    return Drive(dt, lead, u[None], None, np.array([clock]))


def replay(drive: Drive, settings: Settings, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(K + 1, 3)"""
    start = {c: np.array([v]) for c, v in zip(POSE, pose, strict=True)}
    return np.stack([ROVER.replay(start, drive, settings, POSE)[c][0] for c in POSE], axis=-1)


def settings_of(effect: str, parameters: dict[str, float]) -> Settings:
    hypothesis = {Knob(effect, None, p): v for p, v in parameters.items()}
    return assemble([hypothesis], {e.name: ROVER.slots(e.name) for e in LIBRARY})


def test_every_hosted_effect_is_tried() -> None:
    sensors = {e.name for e in LIBRARY if e.port == "sensor"}
    assert {e.name for e in LIBRARY if ROVER.slots(e.name)} - sensors == set(FAULTS)


@pytest.mark.parametrize("size", [1.0, 0.1])
def test_it_keeps_the_contract_in_small_motions(size: float) -> None:
    check_robot(ROVER, np.random.default_rng(1), size=size)


def test_a_straight_line() -> None:
    out = replay(drive_of(lambda t: (6.0, 6.0), 0.01, 1.0), Settings(1), (1.0, -2.0, 0.7))
    along = WHEEL_RADIUS * 6.0 * 0.01 * np.arange(101)
    wanted = np.stack([1.0 + along * np.cos(0.7), -2.0 + along * np.sin(0.7), np.full(101, 0.7)], axis=-1)
    np.testing.assert_allclose(out, wanted, rtol=0, atol=1e-13)


def test_a_spin_on_the_spot() -> None:
    out = replay(drive_of(lambda t: (-5.0, 5.0), 0.01, 1.0), Settings(1))
    np.testing.assert_allclose(out[:, :2], 0.0, atol=1e-15)
    np.testing.assert_allclose(out[:, 2], WHEEL_RADIUS * 10.0 / TRACK_WIDTH * 0.01 * np.arange(101), atol=1e-13)


def test_a_circle_converges_with_the_square_of_the_step() -> None:
    """A constant turn: the exact arc in closed form."""
    w = (4.0, 9.0)
    v, omega = WHEEL_RADIUS * sum(w) / 2, WHEEL_RADIUS * (w[1] - w[0]) / TRACK_WIDTH
    exact = np.array([v / omega * np.sin(omega), v / omega * (1 - np.cos(omega)), omega])
    errors = []
    for dt in (0.04, 0.02, 0.01):
        errors.append(np.abs(replay(drive_of(lambda t: w, dt, 1.0), Settings(1))[-1] - exact).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 2.0, atol=0.1)


def test_a_waving_drive_converges_with_the_square_of_the_step() -> None:
    times = np.array([1.0])
    coarse, finer = (simulate(waving, times, {}, fine=h)[0] for h in (2e-4, 1e-4))
    exact = 2 * finer - coarse  # Richardson: Euler's first order removed
    errors = [np.abs(replay(drive_of(waving, dt, 1.0), Settings(1))[-1] - exact).max() for dt in (0.05, 0.025, 0.0125)]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 2.0, atol=0.2)


@pytest.mark.parametrize("effect", FAULTS)
def test_an_effect_is_its_definition(effect: str) -> None:
    """What happened before the window warms the memory up; the sagging supply is young at its run's start, and the
    angle of a wheel counts from there. Each command is held for a step, as a controller does."""
    dt, times = 0.005, 0.25 * np.arange(5)
    faults = {effect: FAULTS[effect]}
    begin, clock = (0.0, 0.0) if effect in ("voltage_sag", "wheel_eccentricity") else (-LEAD, LEAD)
    drive = drive_of(waving, dt, 1.0, clock)

    def held(t: float) -> tuple[float, float]:
        k = int(np.floor((t + LEAD) / dt + 1e-9))
        left, right = drive.command[0, int(np.clip(k, 0, drive.command.shape[1] - 1))]
        return float(left), float(right)

    literal = simulate(held, times, faults, begin=begin)
    pose = tuple(literal[0])
    nominal = replay(drive, Settings(1), pose)[::50]
    came = replay(drive, settings_of(effect, FAULTS[effect]), pose)[::50]
    shown = np.abs(came - nominal).max()
    assert shown > 5e-3
    assert np.abs(came - literal).max() < 0.02 * shown + 2e-4


def test_one_wheels_gain_alone_turns_the_robot() -> None:
    slots = {"actuator_gain": ROVER.slots("actuator_gain")}
    weak = assemble([{Knob("actuator_gain", "left", "gain"): 0.5}], slots)
    out = replay(drive_of(lambda t: (6.0, 6.0), 0.01, 1.0), weak)
    assert out[-1, 2] == pytest.approx(WHEEL_RADIUS * 3.0 / TRACK_WIDTH, abs=1e-12)


def test_what_the_encoders_and_the_localisation_report() -> None:
    drive = drive_of(waving, 0.005, 1.0)
    start = {c: np.zeros(1) for c in POSE}
    wanted = (*POSE, "twist.x", "twist.y", "twist.theta", "velocity.left", "output.right")
    out = ROVER.replay(start, drive, settings_of("wheel_radius", {"scale": 1.2}), wanted)
    u = drive.command[0, drive.lead :]
    np.testing.assert_array_equal(out["velocity.left"][0, 1:], u[:, 0])  # an encoder reads what was before its stamp
    np.testing.assert_array_equal(out["output.right"][0, 1:], u[:, 1])
    for axis in ("x", "y", "theta"):
        slope = np.gradient(out[f"pose.{axis}"][0], drive.dt)
        np.testing.assert_allclose(out[f"twist.{axis}"][0, 1:-1], slope[1:-1], atol=1e-9)


def test_a_wheel_that_is_off_stands() -> None:
    drive = drive_of(lambda t: (6.0, 6.0), 0.01, 1.0)
    on = np.ones((1, 100, 2))
    on[:, 50:] = 0.0
    out = replay(Drive(drive.dt, drive.lead, drive.command, on, drive.clock), Settings(1))
    assert out[-1, 0] == out[50, 0] == pytest.approx(0.5 * 6.0 * WHEEL_RADIUS)


@pytest.mark.parametrize(("effect", "parameter", "value"), [("turn_gain", "gain", 0.5), ("turn_limit", "limit", 1.0)])
def test_a_wheel_that_is_off_is_not_driven_by_the_other(effect: str, parameter: str, value: float) -> None:
    drive = drive_of(lambda t: (5.0, 5.0), 0.01, 1.0)
    on = np.ones((1, 100, 2))
    on[..., 0] = 0.0
    start = {c: np.zeros(1) for c in POSE}
    late = Drive(drive.dt, drive.lead, drive.command, on, drive.clock)
    out = ROVER.replay(start, late, settings_of(effect, {parameter: value}), ("output.left", "output.right"))
    assert (out["output.left"][0, 1:] == 0.0).all() and (out["output.right"][0, 1:] > 1.0).all()


@pytest.mark.parametrize(("effect", "sides"), [("forward_rate_limit", (1.0, 1.0)), ("turn_rate_limit", (-1.0, 1.0))])
def test_a_base_that_only_drives_ahead_or_only_spins_is_as_if_each_wheel_were_limited(
    effect: str, sides: tuple[float, float]
) -> None:
    def alike(drive: Drive) -> float:
        wheels, base = (settings_of(name, {"rate": 15.0}) for name in ("rate_limit", effect))
        return float(np.abs(replay(drive, wheels) - replay(drive, base)).max())

    swing = drive_of(lambda t: (sides[0] * waving(t)[0], sides[1] * waving(t)[0]), 0.01, 1.0)
    assert alike(swing) < 1e-12 and alike(drive_of(waving, 0.01, 1.0)) > 0.05


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"wheel_radius": 0.03}, "track_width is missing"),
        ({"wheel_radius": 0.03, "track_width": -0.1}, "positive length"),
        ({"wheel_radius": 0.0, "track_width": 0.1}, "positive length"),
        ({"wheel_radius": 0.03, "track_with": 0.1}, "unknown parameter"),
    ],
)
def test_parameters_that_are_no_robot(parameters: dict[str, float], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        build(RobotFile("rover", "diff_drive", parameters=parameters))


def test_the_built_in_robot_is_the_burger() -> None:
    assert build(RobotFile("diff_drive", "diff_drive")) == DiffDrive("diff_drive", 0.033, 0.16)
