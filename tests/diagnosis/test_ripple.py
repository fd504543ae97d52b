"""A torque that ripples with the angle is named with its numbers, by whichever wave it ripples, and where no run shows
it that is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from oracles.hidden_laws import knocked, write_rotor

import residual_mpc as rm
from residual_mpc.diagnosis.laws.ripples import Wave, waves
from residual_mpc.diagnosis.laws.settings import RippleSettings
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate

W, INSTANTS, SAMPLES, DT = 80, 6, 40, 0.02
NAMED = ("torque_ripple", "fitted_law", "viscous_friction", "coulomb_friction", "torque_offset", "joint_spring")


def regressed(law: Callable[[np.ndarray, np.ndarray], np.ndarray], noise: float = 0.002) -> list[Wave]:
    """What the regression makes of a missing rate, seen as its integral at a few instants."""
    rng = np.random.default_rng(0)
    slow, begin = rng.uniform(0.3, 2.0, (W, 1)) * DT * 4, rng.uniform(0, 6.28, (W, 1))
    z, v = (2.0 * f(slow * np.arange(SAMPLES) + begin) for f in (np.sin, np.cos))
    at = np.linspace(5, SAMPLES - 1, INSTANTS).astype(int)
    integral = DT * (np.arange(SAMPLES)[None, :] < at[:, None])
    error = np.einsum("im,wm->wi", integral, law(z, v)) + noise * rng.standard_normal((W, INSTANTS))
    response = np.broadcast_to(integral, (W, INSTANTS, SAMPLES))
    m = MissingRate("position.j", "rad/s^2", error, noise**2, response, np.ones(W, dtype=bool))
    return waves(m, z, v, np.arange(W) // 4 % 5, np.linspace(1.2, 60.0, 160), RippleSettings())


@pytest.mark.parametrize("cycles", [1.5, 3.0, 11.4, 41.0])
def test_the_regression_finds_any_number_of_cycles(cycles: float) -> None:
    best = regressed(lambda z, v: 0.4 * np.sin(cycles * z + 0.7) + 0.3 - 0.2 * z)[0]
    assert best.cycles == pytest.approx(cycles, abs=0.4) and best.share > 0.4
    assert best.acceleration == pytest.approx(0.4, rel=0.2) and best.phase == pytest.approx(0.7, abs=0.4)


@pytest.mark.parametrize(
    "law",
    [lambda z, v: 0.0 * z, lambda z, v: 0.3 - 0.4 * z, lambda z, v: -0.3 * np.tanh(20.0 * v), lambda z, v: -0.2 * v],
    ids=["nothing", "spring", "coulomb", "viscous"],
)
def test_the_regression_takes_nothing_smooth_for_a_wave(law: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    assert regressed(law) == []


def rotor(folder: Path, **keys: object) -> rm.Diagnosis:
    robot = rm.load_robot(folder / "robot.toml")
    return rm.diagnose(robot, rm.read_runs(robot, sorted(folder.glob("run*.csv"))), **keys)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "only",
    [
        pytest.param(("torque_ripple",), id="alone"),
        pytest.param(NAMED, marks=pytest.mark.slow, id="among others"),
    ],
)
def test_a_trapezoidal_ripple_is_named_with_its_numbers(tmp_path: Path, only: tuple[str, ...]) -> None:
    """Its first harmonic is 4 / pi sinc of the flank's half width, times its height."""
    cycles, phase, height, flank = 8.6, -1.1, 0.2, 0.8
    write_rotor(
        tmp_path, lambda seed: lambda t, q, w: height * np.clip(np.sin(cycles * q + phase) / np.sin(flank), -1.0, 1.0)
    )
    turn = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    first = 2.0 * height * np.mean(np.clip(np.sin(turn) / np.sin(flank), -1.0, 1.0) * np.sin(turn))
    found = rotor(tmp_path, only=only)
    (named,) = found.explanation
    assert (named["effect"], named["target"]) == ("torque_ripple", None) and named["probability"] > 0.5
    numbers = {k: p["value"] for k, p in named["parameters"].items()}
    assert numbers["cycles"] == pytest.approx(cycles, abs=0.2)
    assert numbers["amplitude"] == pytest.approx(first, rel=0.1)
    assert numbers["phase"] == pytest.approx(phase, abs=0.1)
    assert [named["parameters"][k]["unit"] for k in ("amplitude", "cycles", "phase")] == ["N m", "1/turn", "rad"]
    low, high = named["parameters"]["cycles"]["ci95"]
    assert low < cycles < high and high - low < 2.0
    assert found.verdict in ("effects", "partial") and found.gap["after"] < 0.3 * found.gap["before"]


@pytest.mark.slow
@pytest.mark.parametrize("seed_of", [lambda seed: knocked(seed, 0.5), lambda seed: lambda t, q, w: 0.0])
def test_no_ripple_where_there_is_none(tmp_path: Path, seed_of: Callable[[int], Callable[..., float]]) -> None:
    write_rotor(tmp_path, seed_of)
    found = rotor(tmp_path, only=("torque_ripple", "viscous_friction"))
    assert found.verdict in ("no_gap", "unknown") and not found.explanation


def test_a_joint_that_hardly_turns_cannot_show_it(tmp_path: Path) -> None:
    write_rotor(tmp_path, lambda seed: lambda t, q, w: 0.0)
    for path in tmp_path.glob("run*.csv"):
        head, *rows = path.read_text().splitlines()
        small = [",".join([r.split(",")[0], *(f"{0.01 * float(x):.6g}" for x in r.split(",")[1:])]) for r in rows]
        path.write_text("\n".join([head, *small]) + "\n")
    (said,) = rotor(tmp_path, only=("torque_ripple",)).document["not_testable"]
    assert said["effect"] == "torque_ripple" and "turns by" in said["why"]


MOUNT = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="axis" axis="0 0 1" armature="3" damping="6"/><geom size="0.1" mass="1"/>
  </body></worldbody>
  <actuator><position name="axis" joint="axis" kp="6000" kv="330"/></actuator>
</mujoco>"""
ERROR, CYCLES, PHASE = 2.2e-3, 36.0, 0.8  # rad, 1/turn, rad: of the worm


def mount(folder: Path) -> None:
    """Runs of an axis behind a worm that errs, whose servo sees the motor: the worm turns as the servo's spring and
    damper let it, and the axis is off by the error (semi-implicit Euler at 0.1 ms)."""
    (folder / "mount.xml").write_text(MOUNT)
    (folder / "robot.toml").write_text('name = "mount"\nplant = "mujoco"\nmodel = "mount.xml"\n')
    h, inertia = 1e-4, 3.0 + 0.4 * 0.1**2
    for seed in range(4):
        rng = np.random.default_rng(seed)
        f, phase = rng.uniform(0.02, 0.15, 3), rng.uniform(0.0, 6.28, 3)
        q, w, u, rows = 0.0, 0.0, 0.0, ["t,command.axis,position.axis"]
        for k in range(int(20.0 / h)):
            if k % 500 == 0:
                u = 0.15 * float(np.sum(np.sin(6.28 * f * k * h + phase) - np.sin(phase)))
                rows.append(f"{k * h:.3f},{u:.7f},{q + 1e-4 * rng.standard_normal():.7f}")
            angle = CYCLES * q + PHASE
            motor, speed = q - ERROR * np.sin(angle), w * (1.0 - ERROR * CYCLES * np.cos(angle))
            w += h * (6000.0 * (u - motor) - 330.0 * speed - 6.0 * w) / inertia
            q += h * w
        (folder / f"run{seed}.csv").write_text("\n".join(rows) + "\n")


def test_an_error_of_a_servos_gear_is_a_ripple_that_leads(tmp_path: Path) -> None:
    mount(tmp_path)
    found = rotor(tmp_path, only=("torque_ripple", "viscous_friction", "coulomb_friction", "position_gain"))
    (named,) = found.explanation
    assert named["effect"] == "torque_ripple" and named["probability"] > 0.9
    numbers = {k: p["value"] for k, p in named["parameters"].items()}
    assert numbers["amplitude"] == pytest.approx(6000.0 * ERROR, rel=0.05)
    assert numbers["cycles"] == pytest.approx(CYCLES, abs=0.1) and numbers["phase"] == pytest.approx(PHASE, abs=0.1)
    low, high = named["parameters"]["lead"]["ci95"]
    assert low < 330.0 / 6000.0 < high < 0.08
    assert "leading the angle" in found.document["verdict_sentence"]
