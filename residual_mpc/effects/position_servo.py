"""Effects of the law of a position servo: how it turns its position error into a force."""

from residual_mpc.effects.effect import Effect, Parameter, Values
from residual_mpc.effects.ops import Array, Ops, clip
from residual_mpc.effects.phrase import Noun, Phrase


def integral_step(ops: Ops, p: Values, x: Array, error: Array, dt: float) -> Array:
    """x + gain * error dt: what the integral part of a servo adds to its setpoint (Astrom and Hagglund, Advanced PID
    Control, 2006, chapter 3, with an integral time of 1 / gain)."""
    return x + p["gain"] * error * dt


def held_integral(ops: Ops, before: Array, after: Array, error: Array, damped: Array, low: Array, high: Array) -> Array:
    """The integral part after a step, which stops growing while the servo demands more than its limits (conditional
    integration; Astrom and Hagglund 2006, section 3.5).

    All in the unit of the setpoint. before, after: of the step; error: of the position; damped: the force of the
    servo's own damping over its stiffness; low, high: the limits of the force over the stiffness."""
    margin = damped - error
    return clip(ops, after, ops.minimum(low + margin, before), ops.maximum(high + margin, before))


SERVO_INTEGRAL = Effect(
    name="servo_integral",
    stage="actuator",
    port="servo",
    target="actuator",
    parameters=(Parameter("gain", "1/s", 0.0, 0.0, 30.0, (0.6, 3.0)),),
    summary="a position servo with an integral part that the model lacks",
    step=integral_step,
    site="servo",
    label="integral",
    lacking="no actuator is a position servo",
    unseen="no position error lasts long enough for an integral part to act",
    phrase=Phrase("{who} integrates its position error with a gain of {gain}"),
    nouns={"gain": Noun("integral gain", article="an", targeted="integral gain")},
    not_in_mjcf="MuJoCo's position servos have no integral part",
)

POSITION_GAIN = Effect(
    name="position_gain",
    listed=False,
    stage="actuator",
    port="model",
    target="actuator",
    parameters=(
        Parameter(
            "gain", "1", 1.0, 0.02, 10.0, (0.25, 0.6, 0.85, 1.2, 2.0), tolerance=0.01, quantity="servo stiffness"
        ),
    ),
    summary="a position servo's proportional gain is a multiple of the model's, with the same damping and limit",
    site="position gain",
    steady=True,
    lacking="no actuator is a position servo with damping of its own, whose gain could change without it",
    imitates=frozenset({"position", "load"}),
    phrase=Phrase(
        "the position gain of {who} is {gain} of the modelled value; its damping is unchanged", shares=("gain",)
    ),
    nouns={"gain": Noun("position gain", "factor", targeted="position gain")},
)

EFFECTS = (SERVO_INTEGRAL, POSITION_GAIN)
