"""Effects of what surrounds the joints: springs, constant and rippling torques beside them, stops, the base's tilt, and
a controller that bears the robot's weight."""

import math

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase


def spring_torque(ops: Ops, p: Values, q: Array) -> Array:
    """stiffness (rest - q), N m."""
    return p["stiffness"] * (p["rest"] - q)


def constant_torque(ops: Ops, p: Values, q: Array) -> Array:
    """The same torque everywhere, N m."""
    return p["torque"] + 0.0 * q


def ripple_torque(ops: Ops, p: Values, q: Array, w: Array) -> Array:
    """amplitude (sin a + lead d(sin a)/dt), N m, with a = cycles q + phase: the first harmonic of a torque that repeats
    with the joint's angle q, rad; w: its speed, rad/s.

    A position servo that drives its joint through a gear with an error of e sin a gives this torque at the joint, to
    first order in e, with an amplitude of its stiffness times e and a lead of its damping over its stiffness.
    """
    angle = p["cycles"] * q + p["phase"]
    return p["amplitude"] * (ops.sin(angle) + p["lead"] * p["cycles"] * w * ops.cos(angle))


JOINT_SPRING = Effect(
    name="joint_spring",
    stage="body",
    port="torque",
    target="joint",
    parameters=(
        Parameter("stiffness", "N m/rad", 0.0, 0.0, math.inf, (0.3, 0.3, 0.3), "torque/motion"),
        Parameter("rest", "rad", 0.0, -6.3, 6.3, (1.5, -1.5, 0.0), "reach", shape=True),
    ),
    summary="a spring, cable or gravity compensation beside the joint",
    step=spring_torque,
    null_target=False,
    site="elastic",
    imitates=frozenset({"position"}),
    laws=(("torque", "position", "line"),),
    phrase=Phrase("a spring of {stiffness} pulls {who} towards {rest}"),
    nouns={"stiffness": Noun("stiffness", appears="spring", size="stiffness")},
)

TORQUE_OFFSET = Effect(
    name="torque_offset",
    stage="body",
    port="torque",
    target="joint",
    parameters=(Parameter("torque", "N m", 0.0, -math.inf, math.inf, (0.3,), "torque"),),
    summary="a constant torque on a joint",
    step=constant_torque,
    null_target=False,
    site="elastic",
    imitates=frozenset({"position"}),
    laws=(("torque", None, "constant"),),
    phrase=Phrase("{who} carries a constant torque of {torque} that the model lacks"),
    nouns={"torque": Noun("constant torque", "excess")},
)

TORQUE_RIPPLE = Effect(
    name="torque_ripple",
    stage="body",
    port="torque",
    target="joint",
    parameters=(
        Parameter("amplitude", "N m", 0.0, 0.0, math.inf, (0.3,), "torque"),
        Parameter("cycles", "1/turn", 12.0, 0.0, 120.0, (12.0,), shape=True, cover=0.75),
        Parameter("phase", "rad", 0.0, -math.inf, math.inf, (0.0,), shape=True),
        Parameter("lead", "s", 0.0, 0.0, 1.0, (0.02,), shape=True, optional=True, quantity="ripple lead"),
    ),
    summary="a torque that repeats with the joint's angle: cogging, an eccentric gear",
    step=ripple_torque,
    null_target=False,
    site="law",
    proposed=True,
    unseen="the joint turns through too little of a cycle, or a plausible ripple moves it by less than the noise",
    phrase=Phrase(
        "{who} has a torque ripple of {amplitude}, {cycles} (cogging or an eccentric gear)",
        located=", {where}",
        optional={"lead": "leading the angle by {value}, as from an error in the gear of a position servo"},
    ),
    nouns={"amplitude": Noun("torque ripple", size="amplitude")},
    not_in_mjcf="MuJoCo has no torque that repeats with a joint's angle",
)

END_STOP = Effect(
    name="end_stop",
    stage="body",
    port="model",
    target="joint",
    parameters=(
        Parameter(
            "position", "rad", math.inf, -math.inf, math.inf, (1.0, -1.0), "extremes", True, quantity="joint stop"
        ),
    ),
    summary="the joint meets a stop that the model lacks",
    null_target=False,
    site="stop",
    unseen="the model stays within the positions that the runs reach",
    phrase=Phrase("{who} meets a stop at {position}"),
    nouns={"position": Noun("stop", size="position")},
)

BASE_TILT = Effect(
    name="base_tilt",
    stage="body",
    port="model",
    target="robot",
    parameters=(
        # a little, on a wall, from the ceiling
        Parameter("roll", "rad", 0.0, -3.2, 3.2, (0.05, 0.0, 1.57, -1.57, 0.0, 0.0, 3.14), quantity="gravity roll"),
        Parameter("pitch", "rad", 0.0, -1.6, 1.6, (0.0, 0.05, 0.0, 0.0, 1.57, -1.57, 0.0), quantity="gravity pitch"),
    ),
    summary="the base is not upright, so gravity acts in another direction than modelled",
    site="gravity",
    imitates=frozenset({"position"}),
    phrase=Phrase("the base is tilted by {roll} about its x axis and by {pitch} about its y axis"),
    nouns={"roll": Noun("roll of the base", "excess"), "pitch": Noun("pitch of the base", "excess")},
)

GRAVITY_COMPENSATION = Effect(
    name="gravity_compensation",
    listed=False,
    stage="body",
    port="model",
    target="robot",
    parameters=(Parameter("share", "1", 0.0, 0.0, 1.5, (1.0, 0.5), quantity="compensated gravity"),),
    summary="the controller adds torques that bear the weight of the modelled robot",
    site="compensation",
    unseen="no motor of the model bears weight that shows in these runs",
    imitates=frozenset({"position"}),
    phrase=Phrase("the controller compensates {share} of the modelled gravity", shares=("share",)),
    nouns={"share": Noun("gravity compensation", appears="gravity compensation", article="", size="share")},
)

# the contract's table lists the efficiency of a gear between these two
TORQUES = (JOINT_SPRING, TORQUE_OFFSET, TORQUE_RIPPLE)
CONSTRAINTS = (END_STOP, BASE_TILT, GRAVITY_COMPENSATION)
