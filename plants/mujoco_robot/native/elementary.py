"""The elementary functions of lanes, and the table of operations with which an effect's equation is compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from plants.mujoco_robot.native.lanes import (
    Condition,
    Lanes,
    Number,
    compared,
    lanes,
    larger,
    size_of,
    smaller,
    value,
    where,
)
from plants.mujoco_robot.native.program import INTEGERS, VECTOR, Program, Value, integer
from residual_mpc.effects.ops import Ops

# sin and cos on [-pi/4, pi/4]: polynomials of the least largest relative error, as in fdlibm (k_sin.c, k_cos.c)
SIN = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
       2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)  # fmt: skip
COS = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
       -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)  # fmt: skip
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # in three parts
TURN = 0.636619772367581343076  # 2 / pi

LOG_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)  # in two parts
PER_LOG_2 = 1.44269504088896338700
LARGEST = 708.0  # of an exponent
TAYLOR = tuple(1.0 / f for f in (1, 1, 2, 6, 24, 120, 720, 5040, 40320, 362880, 3628800, 39916800, 479001600))


def sine_and_cosine(p: Program, x: Lanes) -> tuple[Lanes, Lanes]:
    """Of angles up to some 1e5 rad, to the last digits; the quadrant is subtracted in three parts (Cody and Waite)."""
    k = _nearest(p, x * TURN)
    r: Any = x
    for part in HALF_PI:
        r = r - k * part
    z = r * r
    s = r + r * z * _polynomial(SIN, z)
    c = 1.0 - (0.5 * z - z * z * _polynomial(COS, z))
    quadrant = _whole(p, k)
    odd, second = _bit(p, quadrant, 1), _bit(p, quadrant, 2)
    swapped_s, swapped_c = where(p, odd, c, s), where(p, odd, s, c)
    third = odd ^ second
    return where(p, second, -swapped_s, swapped_s), where(p, third, -swapped_c, swapped_c)


def exponential(p: Program, x: Number) -> Lanes:
    """e^x = 2^k e^r with |r| <= ln(2) / 2, to the last digits."""
    x = smaller(p, larger(p, x, -LARGEST), LARGEST)
    k = _nearest(p, x * PER_LOG_2)
    r: Any = x
    for part in LOG_2:
        r = r - k * part
    power = p.pure(f"add {INTEGERS} {_whole(p, k)}, {integer(1023)}")
    bits = p.pure(f"shl {INTEGERS} {power}, {integer(52)}")
    scale = Lanes(p, p.pure(f"bitcast {INTEGERS} {bits} to {VECTOR}"))
    return lanes(p, scale * _polynomial(TAYLOR, r))


def operations(p: Program) -> Ops:
    """The table for an effect's equation."""

    def sign(x: Number) -> Lanes:
        return where(p, compared(p, "ogt", x, 0.0), 1.0, where(p, compared(p, "olt", x, 0.0), -1.0, 0.0))

    def of_an_angle(which: int) -> Any:
        return lambda x: sine_and_cosine(p, lanes(p, x))[which]

    def no_angle(y: Number, x: Number) -> Number:
        raise NotImplementedError("no effect between the steps of an arm needs arctan2")

    return Ops(
        where=lambda condition, yes, no: where(p, condition, yes, no),
        minimum=lambda a, b: smaller(p, a, b),
        maximum=lambda a, b: larger(p, a, b),
        exp=lambda x: exponential(p, x),
        absolute=lambda x: size_of(p, x),
        cos=of_an_angle(1),
        sin=of_an_angle(0),
        sign=sign,
        sqrt=lambda x: Lanes(p, p.call("sqrt", value(x))),
        arctan2=no_angle,
    )


def _polynomial(coefficients: Sequence[float], z: Any) -> Any:
    out: Any = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        out = c + z * out
    return out


def _nearest(p: Program, x: Number) -> Lanes:
    return Lanes(p, p.call("rint", value(x)))


def _whole(p: Program, x: Lanes) -> Value:
    """As integers."""
    return p.pure(f"fptosi {VECTOR} {x.value} to {INTEGERS}")


def _bit(p: Program, integers: Value, mask: int) -> Condition:
    """Whether a bit is set."""
    one = p.pure(f"and {INTEGERS} {integers}, {integer(mask)}")
    return Condition(p, p.pure(f"icmp ne {INTEGERS} {one}, zeroinitializer"))
