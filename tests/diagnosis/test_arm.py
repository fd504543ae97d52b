"""A servo swinging a mass: the friction that its model lacks is found from a log that another engine made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of
from scipy.integrate import solve_ivp

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.noise_errors import start_bias
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.search import pairs as search_pairs
from residual_mpc.diagnosis.search.pairs import pairs
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings, Term, Values

KP, KV, INERTIA, MASS, LENGTH = 12.0, 0.5, 0.02, 0.5, 0.2  # N m/rad, N m s/rad, kg m^2, kg, m
SIGMA = {"position.shoulder": 1e-3, "velocity.shoulder": 1e-2}  # rad, rad/s
OPTIONS = Options(only=("coulomb_friction", "viscous_friction"))  # for speed
XML = f"""
<mujoco>
  <option timestep="0.005" integrator="RK4"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0"/>
      <inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} 0.001"/>
    </body>
  </worldbody>
  <actuator><position name="shoulder" joint="shoulder" kp="{KP}" kv="{KV}"/></actuator>
</mujoco>"""


def swing(seed: int, coulomb: float = 0.0, viscous: float = 0.0, jump: float = 0.0) -> Run:
    """12 s at 50 Hz, by a high order between the commands, sgn smoothed over 2 mrad/s; jump, rad: of commands."""
    rng, dt, seconds = np.random.default_rng(seed), 0.02, 12.0
    t = dt * np.arange(int(seconds / dt) + 1)
    slow = sum(rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.4, 0.9, 1.7))
    u = slow + np.repeat(rng.uniform(-jump, jump, len(t) // 40 + 1), 40)[: len(t)]
    whole = INERTIA + MASS * LENGTH**2
    state, out = np.array([u[0], 0.0]), []

    def motion(_: float, x: np.ndarray, command: float) -> list[float]:
        gravity = -MASS * 9.81 * LENGTH * np.sin(x[0])
        friction = coulomb * np.tanh(x[1] / 2e-3) + viscous * x[1]
        return [x[1], (KP * (command - x[0]) - KV * x[1] + gravity - friction) / whole]

    for command in u:
        out.append(state)
        state = solve_ivp(motion, (0.0, dt), state, method="LSODA", args=(command,), rtol=1e-7, atol=1e-9).y[:, -1]
    noisy = np.array(out) + list(SIGMA.values()) * rng.standard_normal((len(t), 2))
    return Run(f"run{seed}", t, {"command.shoulder": u, **dict(zip(SIGMA, noisy.T, strict=True))})


@pytest.mark.parametrize(
    ("effect", "parameter", "truth", "friction"),
    [
        ("coulomb_friction", "torque", 0.12, (0.12, 0.0)),
        pytest.param("viscous_friction", "coefficient", 0.25, (0.0, 0.25), marks=pytest.mark.slow),
    ],
)
def test_a_friction_is_found(
    tmp_path: Path, effect: str, parameter: str, truth: float, friction: tuple[float, float]
) -> None:
    robot = robot_of(tmp_path, XML)
    made = diagnose([swing(1, *friction)], [robot], SIGMA, (), OPTIONS, np.random.default_rng(0))
    (cause,) = made.diagnosis.causes
    (estimate,) = cause.parameters
    assert made.diagnosis.verdict == "effects" and (cause.term.effect, estimate.name) == (effect, parameter)
    assert estimate.value == pytest.approx(truth, rel=0.05)


def test_a_weak_servo_that_friction_holds_is_found_as_a_pair(tmp_path: Path) -> None:
    stiff = XML.replace(f'kp="{KP}"', f'kp="{KP / 0.25}"').replace(f'kv="{KV}"', f'kv="{KV / 0.25}"')
    data = build_dataset([swing(1, 0.4)], [robot_of(tmp_path, stiff)], SIGMA)
    problem = build_problem(data, build_space(data, ()), data.sigma, np.ones(len(data.channels)))
    alone = fit_all(problem, [{}])[0]
    best, *others = pairs(problem, alone, blocks_of(data, settings=FitSettings()), settings=SearchSettings())
    assert {t.effect for t in best.terms} == {"actuator_gain", "coulomb_friction"}
    gain = next(v for k, v in best.values.items() if k.effect == "actuator_gain")
    assert gain == pytest.approx(0.25, rel=0.1)
    assert all(f.cost >= best.cost for f in others)


@pytest.mark.slow
def test_few_probes_go_into_every_pair_and_all_into_the_best(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stiff = XML.replace(f'kp="{KP}"', f'kp="{KP / 0.25}"').replace(f'kv="{KV}"', f'kv="{KV / 0.25}"')
    data = build_dataset([swing(1, 0.4)], [robot_of(tmp_path, stiff)], SIGMA)
    problem = build_problem(data, build_space(data, ()), data.sigma, np.ones(len(data.channels)))
    alone = fit_all(problem, [{}])[0]
    asked: list[frozenset[tuple[str, str, float]]] = []
    scores = search_pairs._scores

    def counted(problem: Problem, starts: list[Values]) -> list[tuple[float, float]]:
        asked.extend(frozenset((k.effect, k.parameter, v) for k, v in s.items()) for s in starts)
        return scores(problem, starts)

    monkeypatch.setattr(search_pairs, "_scores", counted)
    pairs(problem, alone, blocks_of(data, settings=FitSettings()), settings=SearchSettings())
    assert len(asked) == len(set(asked))
    every = [(t, p) for t in problem.space.candidates if t.target is None for p in problem.space.probes(t)]
    assert len(asked) < 0.7 * len(every) * (len(every) - 1) / 2
    named = [frozenset(effect for effect, _, _ in a) for a in asked]
    assert not any("sensor_delay" in n for n in named)
    probes = [problem.space.probes(Term(e, None)) for e in ("actuator_gain", "coulomb_friction")]
    grid = [len({frozenset(p.items()) for p in of_one}) for of_one in probes]
    assert named.count(frozenset({"actuator_gain", "coulomb_friction"})) == grid[0] * grid[1]


# with jumps between two samples the local quadratic is biased, and the floor has to know it
@pytest.mark.parametrize("jump", [0.0, 0.3])
def test_a_true_model_has_no_gap(tmp_path: Path, jump: float) -> None:
    robot = robot_of(tmp_path, XML)
    made = diagnose([swing(3, jump=jump)], [robot], SIGMA, (), OPTIONS, np.random.default_rng(0))
    assert made.diagnosis.verdict == "no_gap" and made.diagnosis.causes == ()


# the slope, of a quadratic through five samples of the fall, where it begins in the middle of them (a line's, weights
# (-2 .. 2) / 10 a period), and at their first where it begins at the second (weights (-54, 13, 40, 27, -26) / 70)
@pytest.mark.parametrize(
    ("off", "start", "expected"), [(2.0, 2.0, (0.5 + 2 * 2.0) / 10), (0.02, 0.0, (40 * 0.5 + 27 * 2.0 - 26 * 4.5) / 70)]
)
def test_the_floor_knows_a_motor_that_goes_off(tmp_path: Path, off: float, start: float, expected: float) -> None:
    """An arm that begins to fall at a window's start, or a sample after its run's: five samples around that corner
    start it too fast or backwards, and the floor says by how much."""
    rate, g = 50.0, 9.81  # Hz, m/s^2
    t = np.arange(201) / rate
    held = 1.0  # rad from hanging down
    pull = -MASS * g * LENGTH * np.sin(held) / (INERTIA + MASS * LENGTH**2)  # rad/s^2 as it lets go
    fall = np.maximum(t - off, 0.0)
    angle = held + 0.5 * pull * fall**2
    command = np.full_like(t, held + MASS * g * LENGTH * np.sin(held) / KP)
    run = Run(
        "drop",
        t,
        {"command.shoulder": command, "enabled.shoulder": np.where(t < off, 1.0, 0.0), "position.shoulder": angle},
    )
    data = build_dataset([run], [robot_of(tmp_path, XML)], {"position.shoulder": 1e-4})
    bias = start_bias(data, Settings(1))["velocity.shoulder"][np.searchsorted(data.start, start)]
    assert bias == pytest.approx(expected * pull / rate, rel=0.2)  # the replay starts from the measured state
