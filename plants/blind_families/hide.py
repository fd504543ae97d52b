"""What a case hides: effects at their strengths, faint ones, causes without a name, and what else the level wants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic

import numpy as np

from plants.blind_families.bench import Bench
from plants.blind_families.planting import D, R, background
from plants.blind_families.strength import tuned
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Planted
from residual_mpc.blind.suite import FIRST_TEST_SEED
from residual_mpc.effects.sensor import SENSOR_OUTLIERS

STRONG = 7.0  # ratio to the noise floor of a usual strong effect
AT_ONCE = 2.0  # most gap over one second, over the noise floor, that slow effects add
NEEDED = 1.0  # least gap, over the noise floor, that each of a pair leaves without the other
NOTICED = 0.06  # least gap that no constant effect closes: a diagnosis is content with 0.05
RARE = (0.01, 0.06)  # strengths of outliers that are rare: a few in a thousand samples
_TRIES = 7  # strengths at which a lone effect is tried in place of what is there


@dataclass(frozen=True)
class Hidden(Generic[R]):
    """The robot, and what is true of it; the rest as in ``Answer``."""

    robot: R
    effects: tuple[Planted, ...] = ()
    background: tuple[Planted, ...] = ()
    unknown: tuple[str, ...] = ()
    notes: Mapping[str, Any] = field(default_factory=dict)


def hide(bench: Bench[R, D], level: Level, seed: int, rng: np.random.Generator) -> Hidden[R] | None:
    """What the level wants; None where these runs cannot show it."""
    if level.changed:
        return _coming_and_going(bench, level, rng)
    if level.misspecified:
        return _beside_flaws(bench, level, rng)
    planted = _plant_all(bench, level, rng, bench.rest)
    if planted is None:
        return None
    robot, faint = _plant_background(bench, level, rng)
    for draw, strength, _ in planted:
        robot, _ = bench.plant(robot, draw, strength)
    effects = tuple(p for _, _, p in planted)
    if level.pairs:
        alone = [_least_left(bench, robot, draw, strength)[0] for draw, strength, _ in planted]
        return Hidden(robot, effects, notes={"alone": alone}) if min(alone) >= NEEDED else None
    if level.slow:
        at_once = bench.ratio(robot, 1.0)
        return Hidden(robot, effects, notes={"at_once": at_once}) if at_once <= AT_ONCE else None
    if not level.unknown:
        return Hidden(robot, effects, faint)
    habits = bench.habits
    cause = str(rng.choice(habits.unnamed if seed < FIRST_TEST_SEED else habits.unnamed_in_tests))
    found = _plant_unnamed(bench, cause, level, rng)
    return None if found is None else Hidden(found, effects, faint, (cause,))


def _coming_and_going(bench: Bench[R, D], level: Level, rng: np.random.Generator) -> Hidden[R] | None:
    """One effect that is not the same all the time; None where a constant one would do."""
    draw = bench.draw(bench.effects[0], rng)
    how, robot_at = bench.changing(draw, rng)
    found = _tuned(bench, robot_at, _within(level.wanted, rng), level)
    if found is None:
        return None
    strength, ratio = found
    robot = robot_at(strength)
    over_floor, gap = _least_left(bench, robot, draw, strength)
    if not (level.rest[0] <= over_floor <= level.rest[1] and gap >= NOTICED):
        return None
    _, parameters = bench.plant(bench.robot, draw, strength)
    effect = Planted(bench.effects[0], bench.target(draw), parameters, ratio)
    return Hidden(robot, (), (effect,), (f"{effect.effect} {how}",), {"rest": over_floor, "rest_gap": gap})


def _beside_flaws(bench: Bench[R, D], level: Level, rng: np.random.Generator) -> Hidden[R] | None:
    """Effects about as strong as what no effect describes; what describes a part of a flaw may be named as well."""
    flawed = bench.flawed(rng)
    low, high = level.rest
    strength, rest = tuned(
        lambda s: bench.ratio(flawed(s)[1]), _within((1.3 * low, 0.7 * high), rng), tries=bench.habits.tries
    )
    if not low <= rest <= high or bench.left(flawed(strength)[1])(bench.robot)[1] < NOTICED:
        return None
    planted = _plant_all(bench, level, rng, rest)
    if planted is None:
        return None
    robot, _ = flawed(strength)
    for draw, s, _ in planted:
        robot, _ = bench.plant(robot, draw, s)
    mimics = sorted({name for flaw in bench.flaws for name in bench.habits.flaws.get(flaw, ())})
    described = tuple(Planted(name, None, {}) for name in mimics)
    return Hidden(robot, tuple(p for _, _, p in planted), described, bench.flaws, {"rest": rest})


def _within(bounds: tuple[float, float], rng: np.random.Generator) -> float:
    """Evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]))))


def _plant_all(
    bench: Bench[R, D], level: Level, rng: np.random.Generator, rest: float
) -> list[tuple[D, float, Planted]] | None:
    """(draw, strength, effect) of each; None where these runs cannot show one.

    rest: ratio of what is wrong besides; effects are about as strong, so that they can be told.
    """
    if rest > 0.0:
        level = replace(level, ratio=(max(level.ratio[0], 0.7 * rest), max(level.ratio[1], 2.0 * rest)))
    wished = (max(0.9 * rest, level.wanted[0]), 1.8 * rest) if rest > level.wanted[0] else level.wanted
    planted: list[tuple[D, float, Planted]] = []
    for effect in bench.effects:
        draw = bench.draw(effect, rng)
        if level.pairs and planted:
            draw = bench.beside(draw, planted[0][0])
        wanted = _within(wished, rng)
        one = _plant_one(bench, effect, draw, wanted, float(rng.uniform(*bench.habits.first)), level)
        if one is None:
            return None
        planted.append((draw, *one))
    return planted


def _plant_one(
    bench: Bench[R, D], effect: str, draw: D, wanted: float, start: float, level: Level
) -> tuple[float, Planted] | None:
    """The strength that gives the wanted ratio and the effect at it."""
    if not bench.plantings[effect].tuned:
        found: tuple[float, float] | None = (float(np.clip(wanted / 15, 0.15, 1.0)), wanted)
    else:
        found = _tuned(bench, lambda s: bench.plant(bench.robot, draw, s)[0], wanted, level, start)
    if found is None:
        return None
    strength, ratio = found
    _, parameters = bench.plant(bench.robot, draw, strength)
    return strength, Planted(effect, bench.target(draw), parameters, ratio)


def _tuned(
    bench: Bench[R, D], robot_at: Callable[[float], R], wanted: float, level: Level, start: float = 0.3
) -> tuple[float, float] | None:
    """Strength and ratio, if the level allows that ratio."""
    strength, ratio = tuned(lambda s: bench.ratio(robot_at(s)), wanted, start, bench.habits.tries)
    return (strength, ratio) if level.ratio[0] <= ratio <= level.ratio[1] else None


def _least_left(bench: Bench[R, D], robot: R, draw: D, strength: float) -> tuple[float, float]:
    """(over the noise floor, gap) that the robot leaves of a model with this one effect, constant and as strong as fits
    best."""
    from scipy.optimize import minimize_scalar

    left = bench.left(robot)
    seen: list[tuple[float, float]] = [left(bench.robot)]

    def tried(logarithm: float) -> float:
        seen.append(left(bench.plant(bench.robot, draw, float(np.exp(logarithm)))[0]))
        return seen[-1][0]

    bounds = np.log(0.2 * strength), np.log(min(4.0 * strength, 1.0))
    minimize_scalar(tried, bounds=bounds, method="bounded", options={"maxiter": _TRIES})
    return min(seen)


def _plant_background(bench: Bench[R, D], level: Level, rng: np.random.Generator) -> tuple[R, tuple[Planted, ...]]:
    """The robot with the faint effects of the level, each about its share of a strong one; with a few outliers in half
    of the wild logs."""
    robot, planted = bench.robot, []
    if level.wild and rng.random() < 0.5:
        draw = bench.draw(SENSOR_OUTLIERS.name, rng)
        robot, parameters = bench.plant(robot, draw, float(rng.uniform(*RARE)))
        planted.append(Planted(SENSOR_OUTLIERS.name, bench.target(draw), parameters))
    for effect in background(bench.plantings, bench.effects) if level.background else ():
        draw = bench.draw(effect, rng)
        tried = 0.2 * bench.plantings[effect].typical
        shown_by_it = max(bench.ratio(bench.plant(bench.robot, draw, tried)[0]), 0.2)
        share = tried * level.background * STRONG * float(rng.uniform(0.5, 1.5)) / shown_by_it
        robot, parameters = bench.plant(robot, draw, min(share, bench.habits.most))
        planted.append(Planted(effect, bench.target(draw), parameters))
    return robot, tuple(planted)


def _plant_unnamed(bench: Bench[R, D], cause: str, level: Level, rng: np.random.Generator) -> R | None:
    """The robot with the cause as strong as a strong effect; None where these runs cannot show it."""
    wanted = _within((4, 12), rng)
    caused = bench.unnamed(cause, rng)
    found = _tuned(bench, caused, wanted, level)
    return None if found is None else caused(found[0])
