"""Effects between the wheels and the ground, and the one equation of the wheeled base that hosts them."""

import math
from collections.abc import Mapping

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops

GRAVITY = 9.81  # m/s^2


def ground_twist(
    ops: Ops,
    p: Mapping[str, Values],
    wheel_radius: Array,
    track_width: Array,
    w: tuple[Array, Array],
    a: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Body-frame velocity of a differential drive (paper, the equation labelled wheel_prop) with the contact
    effects in `p`.

    w: wheel speeds left, right, rad/s; a: their accelerations, rad/s^2.
    Returns forward m/s, sideways (to the left) m/s, yaw rate rad/s. An effect that is not in `p` is not computed.
    """
    r_left: Array = wheel_radius
    if "wheel_radius" in p:
        r_left = wheel_radius * p["wheel_radius"]["scale"]
    r_right = r_left
    if "wheel_radius_mismatch" in p:
        r_right = r_left * p["wheel_radius_mismatch"]["ratio"]
    rims = [r_left * w[0], r_right * w[1]]
    if "longitudinal_slip" in p:
        c = p["longitudinal_slip"]["coefficient"]
        # a slipping wheel never drives backwards: the factor stops at zero, which the contract's formula leaves open
        rims = [
            v * ops.maximum(1.0 - c * ops.absolute(r * acc) / GRAVITY, 0.0)
            for v, r, acc in zip(rims, (r_left, r_right), a, strict=True)
        ]
    track: Array = track_width
    if "track_width" in p:
        track = track_width * p["track_width"]["scale"]
    forward = 0.5 * (rims[0] + rims[1])
    yaw = (rims[1] - rims[0]) / track
    sideways = 0.0 * forward
    if "lateral_slip" in p:
        sideways = -p["lateral_slip"]["coefficient"] * forward * yaw  # outwards: away from the turn's centre
    return forward, sideways, yaw


def slope_drift(ops: Ops, p: Values) -> tuple[Array, Array]:
    """World-frame drift (m/s, m/s) of a robot on a slope."""
    return p["rate"] * ops.cos(p["heading"]), p["rate"] * ops.sin(p["heading"])


def _ground(name: str, parameters: tuple[Parameter, ...], summary: str) -> Effect:
    return Effect(name, "contact", "ground", "robot", parameters, summary)


WHEEL_RADIUS = _ground(
    "wheel_radius",
    (Parameter("scale", "1", 1.0, 0.05, 3.0, (0.85, 1.15), tolerance=0.01),),
    "both wheels larger or smaller",
)
WHEEL_RADIUS_MISMATCH = _ground(
    "wheel_radius_mismatch",
    (Parameter("ratio", "1", 1.0, 0.3, 3.0, (0.95, 1.05), tolerance=0.005),),
    "one wheel larger than the other",
)
TRACK_WIDTH = _ground(
    "track_width",
    (Parameter("scale", "1", 1.0, 0.1, 20.0, (0.8, 1.25, 2.0), tolerance=0.015),),
    "another effective track width",
)
LATERAL_SLIP = _ground(
    "lateral_slip",
    (Parameter("coefficient", "s", 0.0, -2.0, 2.0, (0.05, 0.3), tolerance=0.015),),
    "sideways drift in turns",
)
LONGITUDINAL_SLIP = _ground(
    "longitudinal_slip",
    (Parameter("coefficient", "1", 0.0, 0.0, 20.0, (0.3, 2.0), tolerance=0.05),),
    "wheels that slip when they accelerate",
)
SLOPE = _ground(
    "slope",
    (
        Parameter("rate", "m/s", 0.0, 0.0, 1.0, (0.02, 0.02, 0.02, 0.02), tolerance=0.002),
        Parameter("heading", "rad", 0.0, -math.inf, math.inf, (0.0, 1.5708, 3.1416, -1.5708), shape=True),
    ),
    "steady drift in one world direction",
)
