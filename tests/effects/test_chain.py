"""The chain that is stepped is the chain that is replayed, whatever stands in it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import zip_longest
from typing import get_args

import numpy as np
import pytest

from residual_mpc.effects import chain as chain_module
from residual_mpc.effects.chain import chain_of, command_chain, filled, leaves, limits_of, on_errors
from residual_mpc.effects.effect import Effect, Parameter, Site
from residual_mpc.effects.library import BY_NAME, LIBRARY, changes, holder, present, slots_of
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.ramp import ENDLESS, missing
from residual_mpc.effects.speed_chain import speed_chain, speed_chains, speeds_and_ends
from residual_mpc.export.soften import kinks

DT, STEPS = 0.02, 60  # s
WHEELS = ("left", "right")
NUMBERS = {  # (1, 2) of each effect of the chain
    "command_delay": {"delay": np.array([[0.05, 0.033]])},
    "dead_zone": {"width": np.array([[0.4, 0.0]])},
    "actuator_lag": {"time_constant": np.array([[0.07, 0.2]])},
    "actuator_gain": {"gain": np.array([[0.8, 1.1]])},
    "voltage_sag": {"rate": np.array([[0.01, 0.02]])},
    "saturation": {"limit": np.array([[0.9, 0.5]])},
    "turn_gain": {"gain": np.array([[0.6]])},
    "turn_limit": {"limit": np.array([[0.5]])},
    "shared_limit": {"limit": np.array([[0.7]])},
    "forward_rate_limit": {"rate": np.array([[20.0]])},
    "turn_rate_limit": {"rate": np.array([[30.0]])},
}


def echo_start(ops, p, y):
    return (y, (y,))


def echo_step(ops, p, memory, y, clock, dt):
    """An output that its value of two steps ago is added to."""
    last, (before,) = memory
    return y + p["share"] * before, (y, (last,))


ECHO = Effect(
    name="echo", stage="actuator", port="output", target="actuator",
    parameters=(Parameter("share", "1", 0.0, 0.0, 1.0, (0.2,)),), summary="", start=echo_start, step=echo_step,
)  # fmt: skip


def stepped(effects: Mapping[str, Mapping[str, np.ndarray]], u: np.ndarray) -> np.ndarray:
    """(K, 2) commands through the chains of two motors, one step at a time as a controller's model does it."""
    chains, pairs = speed_chains(effects, WHEELS, DT)

    def values(effect: str, wheel: str) -> dict[str, float]:
        return {k: float(v[0, WHEELS.index(wheel)]) for k, v in effects[effect].items()}

    def through(y: list[float], now: Mapping[str, float], new: dict[str, float], clock: float) -> list[float]:
        for chain, pair in zip_longest(chains, pairs):
            y = [chain(kinks(NUMPY, 0.0), w, y[i], values, now, new, clock) for i, w in enumerate(WHEELS)]
            if pair is not None:
                y = pair(kinks(NUMPY, 0.0), y, values(pair.effect.name, "left"), now, new)
        return y

    now: dict[str, float] = {}
    arrived = list(u[0])
    for chain, pair in zip_longest(chains, pairs):
        now |= chain.resting(dict(zip(WHEELS, arrived, strict=True)), values)
        arrived = [chain(kinks(NUMPY, 0.0), w, arrived[i], values, now, {}, 0.0) for i, w in enumerate(WHEELS)]
        if pair is not None:
            now |= pair.resting(arrived, values(pair.effect.name, "left"))
            arrived = pair(kinks(NUMPY, 0.0), arrived, values(pair.effect.name, "left"), now, {})
    assert set(now) == {s for part in (*chains, *pairs) for s in part.states}
    out = np.empty_like(u)
    for k, row in enumerate(u):
        new: dict[str, float] = {}
        out[k] = through(list(row), now, new, k * DT)
        now = new
    return out


@pytest.mark.parametrize("names", [*((n,) for n in NUMBERS), tuple(NUMBERS), (*NUMBERS, "echo")], ids="+".join)
def test_a_chain_is_stepped_as_it_is_replayed(names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(BY_NAME, "echo", ECHO)
    monkeypatch.setattr(chain_module, "CHAINED", ordered := sorted((*LIBRARY, ECHO), key=lambda e: e.rank))
    ranked = {e.name: (rank, e.place, e) for rank, e in enumerate(ordered)}
    monkeypatch.setattr("residual_mpc.effects.library.PLACED", ranked)
    effects = {n: {**NUMBERS, "echo": {"share": np.array([[0.3, 0.6]])}}[n] for n in names}
    u = np.random.default_rng(3).standard_normal((1, STEPS, 2))
    clock = (DT * np.arange(STEPS))[None, :, None]  # a robot at rest knows no sag yet
    replayed = speed_chain(effects, u, None, clock, DT)
    np.testing.assert_allclose(stepped(effects, u[0]), replayed[0], rtol=0, atol=1e-12)
    assert np.abs(replayed - u).max() > 0.01


def test_a_motor_lags_behind_its_limit_and_not_behind_an_unlimited_speed() -> None:
    effects = {n: {k: v[:, :1] for k, v in NUMBERS[n].items()} for n in ("actuator_lag", "saturation")}
    tau, limit = (float(next(iter(effects[n].values()))[0, 0]) for n in effects)
    u = np.where(np.arange(STEPS) < 30, 5.0 * limit, 0.0)[None, :, None]
    speed = speed_chain(effects, np.concatenate([np.zeros((1, 1, 1)), u], axis=1), None, np.zeros((1, 1, 1)), DT)
    end = DT * np.arange(1, 31)  # s, of each step of the limited command; its mean is the way covered over the step
    way = limit * (end + tau * (np.exp(-end / tau) - 1.0))
    np.testing.assert_allclose(np.cumsum(DT * speed[0, 1:31, 0]), way, rtol=0, atol=1e-12)
    falls = speed[0, 31:, 0]  # at once, since nothing has wound up behind the limit
    assert falls[0] < 0.95 * speed[0, 30, 0]


def test_a_base_limits_its_commands_before_all_else_but_a_dead_time_which_may_follow() -> None:
    effects = {n: NUMBERS[n] for n in ("command_delay", "dead_zone", "forward_rate_limit", "turn_gain", "actuator_lag")}
    chains, pairs = speed_chains(effects, WHEELS, DT)
    assert [pair.effect.name for pair in pairs] == ["forward_rate_limit", "turn_gain"]
    assert [[e.name for e in c.effects] for c in chains] == [[], ["dead_zone", "command_delay"], ["actuator_lag"]]


def test_a_base_speeds_up_and_turns_at_rates_of_their_own() -> None:
    """A step of both commands: the mean climbs by one rate, half of the difference by the other, and both arrive."""
    effects = {n: NUMBERS[n] for n in ("forward_rate_limit", "turn_rate_limit")}
    u = np.zeros((1, STEPS, 2))
    u[:, 1:31] = [1.0, 5.0]
    y, end = (x[0] for x in speeds_and_ends(effects, u, None, np.zeros((1, 1, 1)), DT))
    up = np.arange(1, 31)  # the steps of the command

    def climbing(t: np.ndarray, rate: float, top: float) -> np.ndarray:
        return np.minimum(rate * t, top)

    def way(t: np.ndarray, rate: float, top: float) -> np.ndarray:
        """The integral of `climbing`."""
        arrived = top / rate
        return np.where(t < arrived, 0.5 * rate * t**2, top * (t - 0.5 * arrived))

    for sign, rate, top in ((1.0, 20.0, 3.0), (-1.0, 30.0, 2.0)):
        mean, last = (0.5 * (x[:, 1] + sign * x[:, 0]) for x in (y, end))
        np.testing.assert_allclose(last[up], climbing(DT * up, rate, top), atol=1e-12)
        covered = way(DT * up, rate, top) - way(DT * (up - 1), rate, top)
        np.testing.assert_allclose(DT * mean[up], covered, atol=1e-12)
    fallen = DT * np.arange(1, STEPS - 30)  # s
    np.testing.assert_allclose(end[31:].mean(axis=1), np.maximum(3.0 - 20.0 * fallen, 0.0), atol=1e-12)


def test_an_encoder_sees_the_end_of_a_step() -> None:
    """Behind a ramp and a lag, against both in steps a hundred times as short."""
    numbers = NUMBERS | {"rate_limit": {"rate": np.array([[20.0]])}}
    effects = {n: {k: v[:, :1] for k, v in numbers[n].items()} for n in ("rate_limit", "actuator_gain", "actuator_lag")}
    fine = 100
    u = np.repeat(np.random.default_rng(1).standard_normal(STEPS // 5), 5)[None, :, None]
    mean, end = speeds_and_ends(effects, u, None, np.zeros((1, 1, 1)), DT)
    finer = speed_chain(effects, np.repeat(u, fine, axis=1), None, np.zeros((1, 1, 1)), DT / fine)
    assert np.abs(end - mean).max() > 0.02
    np.testing.assert_allclose(end[0, :, 0], finer[0, fine - 1 :: fine, 0], atol=0.05 * np.abs(end - mean).max())
    np.testing.assert_allclose(mean[0, :, 0], finer[0, :, 0].reshape(-1, fine).mean(axis=1), atol=0.012)


@pytest.mark.parametrize(
    "beside",
    [
        {"rate_limit": {"rate": np.array([[50.0, np.inf]])}},
        {"actuator_lag": {"time_constant": np.array([[0.1, 0.0]])}},
        {"actuator_lag": {"time_constant": np.array([[0.1, 0.002]])}},
    ],
    ids=["ramp", "no lag", "short lag"],
)
def test_what_one_wheel_has_leaves_the_others_encoder_alone(beside: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    effects, fine = {"forward_rate_limit": {"rate": np.array([[10.0]])}, **beside}, 200
    u = np.zeros((1, STEPS, 2))
    u[:, 2:] = [1.0, 5.0]
    mean, end = speeds_and_ends(effects, u, None, np.zeros((1, 1, 1)), DT)
    finer = speed_chain(effects, np.repeat(u, fine, axis=1), None, np.zeros((1, 1, 1)), DT / fine)[0, fine - 1 :: fine]
    climbing = slice(3, 10)
    assert np.abs(end - mean)[0, climbing, 1].min() > 0.09
    np.testing.assert_allclose(end[0, climbing, 1], finer[climbing, 1], atol=0.01)


def test_no_limit_takes_nothing_even_as_a_large_number() -> None:
    """Steps of optimisers have no infinity; what stands for it is no limit either."""
    for rate in (np.inf, ENDLESS):
        mean, end = missing(NUMPY, np.array([100.0, -3.0]), np.array(rate), 0.001)
        np.testing.assert_array_equal(mean, 0.0)
        np.testing.assert_array_equal(end, 0.0)
    assert missing(NUMPY, np.array(2.0), np.array(0.0), 0.01) == (2.0, 2.0)


def test_memory_is_named_after_its_effect_and_target() -> None:
    effects = {n: NUMBERS[n] for n in ("command_delay", "actuator_lag")}
    chain = chain_of(effects, ("command",), WHEELS, DT)
    late = tuple(f"sent.{w}.{j}" for w in WHEELS for j in (1, 2, 3))  # as long as the larger delay needs
    assert chain.states == (*late, "lag.left", "lag.right")
    assert leaves((1, (2, [3]), ())) == [1, 2, 3] and filled((0, (0, [0]), ()), iter([1, 2, 3])) == (1, (2, (3,)), ())
    _, pairs = speed_chains({n: NUMBERS[n] for n in ("turn_limit", "turn_rate_limit")}, WHEELS, DT)
    assert [pair.states for pair in pairs] == [("ramp.turn",), ()]


def test_at_a_servo_a_dead_zone_acts_on_the_error_alone() -> None:
    effects, servo = {"dead_zone": NUMBERS["dead_zone"]}, np.array([True, False])
    u = np.full((1, 4, 2), 0.1)
    np.testing.assert_array_equal(command_chain(effects, u, 0, DT, ~servo), u)  # the wheel without a servo has none
    ((effect, p),) = on_errors(effects, servo)
    assert effect.name == "dead_zone" and p["width"].tolist() == [[0.4, 0.0]]
    assert on_errors(effects, ~np.array([True, True])) == []


def test_what_effects_make_of_a_quantity() -> None:
    """Factors multiply, everything else adds up; a quantity that nothing changes is None."""
    half = {"wheel_radius": {"scale": np.array([[0.5]])}}
    assert changes(half, "wheel radius").tolist() == [[0.5]] and changes(half, "track width") is None
    bias = {"sensor_bias": {"bias": np.array([[0.1]])}}
    assert changes(bias, "reading offset").tolist() == [[0.1]]
    assert limits_of({"saturation": NUMBERS["saturation"]})[1].tolist() == [[0.9, 0.5]] and limits_of({}) is None
    assert holder("dry friction") == ("coulomb_friction", "torque")


def test_a_robot_has_the_effects_of_its_sites() -> None:
    sites = {"command": WHEELS, "strength": ("left",)}
    assert slots_of("command_delay", sites) == WHEELS and slots_of("voltage_sag", sites) == ("left",)
    assert slots_of("payload", sites) == () and slots_of("no_such_effect", sites) == ()
    assert [e.name for e, _ in present(NUMBERS, "command")] == ["dead_zone", "command_delay", "actuator_lag"]


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda e: e.name)
def test_an_effect_says_all_that_others_ask_of_it(effect: Effect) -> None:
    assert effect.phrase is not None and effect.unseen and effect.place in get_args(Site)
    hosts_in_mjcf = not effect.not_in_mjcf
    assert hosts_in_mjcf or not effect.in_mjcf
    changed = [p for p in effect.parameters if p.quantity]
    assert effect.step is not None or changed or not effect.fitted  # an equation, or what it changes of the model
    assert set(effect.stalls) <= {p.name for p in effect.parameters}
